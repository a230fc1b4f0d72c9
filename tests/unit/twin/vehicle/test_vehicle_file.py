"""Vehicle files: mistakes in one line, and what follows from their values."""

import re

import pytest

from twin.vehicle.model import MPH_60_MPS, brake_force_n, gain, vehicle_model
from twin.vehicle.state import COLUMN, TELEMETRY, VehicleState, columns
from twin.vehicle.vehicle_file import _MODELS, load_vehicle

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


def test_a_distance_shorter_than_the_pedal_s_lag_is_refused(tmp_path):
    path = tmp_path / "car.yaml"
    path.write_text(TEXT.replace("distance_60mph_m: 46.5", "distance_60mph_m: 2.0"))
    with pytest.raises(ValueError, match=r"distance_60mph_m 2 is passed while the pedal's lag"):
        vehicle_model(load_vehicle(str(path)))


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
