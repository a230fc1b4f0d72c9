"""Vehicle files: mistakes in one line, and what follows from their values."""

import re

import numpy as np
import pytest
from msgspec.structs import replace

from twin.vehicle.model import brake_force_n, gain, vehicle_model
from twin.vehicle.state import COLUMN, TELEMETRY, VehicleState, columns
from twin.vehicle.vehicle_file import _MODELS, MPH_60_MPS, load_vehicle

TEXT = (_MODELS / "opencav.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("wheelbase_m: 3.09", "wheelbase_m: -3", r"wheelbase_m: given -3, allowed: a number > 0"),
        ("schema: 3", "schema: 1", r"schema"),
        ("driven: front", "driven: both", r"driven"),
        ("[1000, 240]", "[500, 240]", r"engine speeds must rise from row to row"),
        ("2.84, 1.91", "1.91, 2.84", r"every gear's ratio must be below"),
        (
            "shift_down_rpm: [1050, 3200]",
            "shift_down_rpm: [1050, 5000]",
            r"5000 hunts with .* 6300",
        ),
        ("slip_asymptote: 0.7 ", "slip_asymptote: 0.1 ", r"slip_asymptote 0.1 must be above"),
        ("corner_mass_kg: [523.0, 523.0,", "corner_mass_kg: [523.0,", r"corner_mass_kg"),
        ("  mass_kg: 42.0", "  weight_kg: 42.0", r"weight_kg"),
        ("com_height_m: 0.69", "com_height_m: 0.1", r"too low for wheels of radius 0.36"),
        ("gyration_y: 0.76", "gyration_y: 1.0e-200", r"body: its inertia is not positive"),
        ("523.0, 412.5, 412.5", "1.0e-9, 1.0e-9, 412.5", r"its inertia is not .* spread corner_"),
        ("_60mph_m: 46.5", "_60mph_m: 2.0", r"60mph_m 2 is passed while the pedal's lag of 0.1 s"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, old, new, expected):
    assert old in TEXT
    path = tmp_path / "car.yaml"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(ValueError, match=expected) as error:
        load_vehicle(str(path))
    assert "\n" not in str(error.value)
    assert "car.yaml" in str(error.value)


@pytest.mark.parametrize(
    "masses", [[523.0, 523.0, 412.5, 412.5], [900.0, 300.0, 200.0, 700.0], [1.0, 2.0, 3.0, 4.0]]
)
def test_moments_that_a_file_is_judged_by_are_those_of_the_kernels(masses):
    car = load_vehicle("opencav")
    car = replace(car, body=replace(car.body, corner_mass_kg=masses))
    tensor = np.array(vehicle_model(car).inertia).reshape(3, 3)
    roll, pitch, product = car.moments()
    assert (roll, pitch, product) == pytest.approx((tensor[0, 0], tensor[1, 1], -tensor[0, 1]))


def test_a_lidar_profile_that_a_vehicle_file_names_is_looked_at(tmp_path):
    path = tmp_path / "car.yaml"
    own = "lidars:\n  roof: {position_m: [1, 0, 2], profile: ./own.yaml}\n"
    path.write_text(TEXT[: TEXT.index("lidars:")] + own + TEXT[TEXT.index("headlamps_m:") :])
    with pytest.raises(ValueError, match=r"car\.yaml: lidars\.roof: .*own\.yaml: No such file"):
        load_vehicle(str(path))


def test_brake_force_is_that_of_the_distance():
    car = load_vehicle("opencav")
    accel = brake_force_n(car) / car.mass_kg
    plain = MPH_60_MPS**2 / 2 / (car.brakes.distance_60mph_m - 0.1 * MPH_60_MPS)
    assert accel == pytest.approx(plain, rel=0.03)


def test_every_value_of_opencav_has_a_source():
    sources = ("original", "maker", "edmunds", "bosch", "inferred", "fitted")
    values = [line for line in TEXT.splitlines() if re.match(r"\s*\w+:.*\d", line)]
    assert len(values) > 60
    bare = [line for line in values if not any(s in line.partition("#")[2] for s in sources)]
    assert [line.partition(":")[0] for line in bare] == ["schema"]


def test_columns_name_the_struct_s_memory():
    assert TELEMETRY[:3] == ("x_m", "y_m", "yaw_rad")
    assert len(set(TELEMETRY)) == len(TELEMETRY)
    assert columns("orientation").start == COLUMN["orientation_x"]
    assert TELEMETRY[columns("wheel_speed")] == (
        "wheel_speed_fl_radps",
        "wheel_speed_fr_radps",
        "wheel_speed_rl_radps",
        "wheel_speed_rr_radps",
    )
    widths = [columns(f).stop - columns(f).start for f in VehicleState.vars]
    assert sum(widths) == len(TELEMETRY)
    with pytest.raises(KeyError):
        columns("wings")


def test_gain_of_a_lag():
    assert gain(0.0) == 1.0
    assert gain(0.25) == pytest.approx(0.002 / 0.25, rel=0.01)
