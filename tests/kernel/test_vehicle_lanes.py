"""Wheels in lanes: their constants, and sums in the order of the wheels on every device."""

import numpy as np
import pytest
import warp as wp

from twin.vehicle import lanes
from twin.vehicle.fleet import Fleet
from twin.vehicle.lanes import PART, VALUES, add_wheel, wheel_part, wheel_sum
from twin.vehicle.masses import Load
from twin.vehicle.model import WheelModel, vehicle_model, wheel_models
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})
CAR = load_vehicle("opencav")
SIZES = np.array([[1e16], [-1e16], [1.0], [1e-3]])
PARTS = np.random.default_rng(3).uniform(1.0, 2.0, (4, len(PART))) * SIZES
"""Large and small: another order has other sums."""


@wp.kernel
def add_kernel(parts: wp.array(dtype=wheel_part), out: wp.array(dtype=wheel_sum)):
    total = wheel_sum()
    for i in range(parts.shape[0]):
        total = add_wheel(total, parts[i], i)
    out[0] = total


def on_cpu():
    parts = wp.array(PARTS, dtype=wheel_part, device="cpu")
    out = wp.zeros(1, dtype=wheel_sum, device="cpu")
    wp.launch(add_kernel, 1, inputs=[parts], outputs=[out], device="cpu")
    return out.numpy()[0]


def test_sums_are_in_the_order_of_the_wheels_and_values_stand_by_name():
    found = on_cpu()
    up = down = lift = moment = 0.0
    for part, last in zip(PARTS, PARTS[::-1], strict=True):
        up += part[PART.index("up_y")]
        down += last[PART.index("up_y")]
        lift += part[PART.index("lift")]
        moment = (moment + part[PART.index("moment_z")]) - part[PART.index("back_z")]
    assert found[lanes.UP + 1] == up != down
    assert found[lanes.LIFT] == lift
    assert found[lanes.TORQUE + 2] == moment
    assert found[lanes.FORCE + 2] == 0.0
    assert (found[VALUES:].reshape(7, 4) == PARTS[:, 12:].T).all()


def test_what_lanes_of_a_gpu_add_from_their_board_are_the_same_sums_in_the_same_order():
    # Lines of sums are Python, too.
    total = np.zeros(len(on_cpu()))
    exec(lanes.BOARD.replace(";", ""), {"total": total, "board": PARTS})
    assert (total == on_cpu()).all()


@pytest.mark.parametrize("wheel", range(4))
def test_a_wheel_has_its_own_constants(wheel):
    model = vehicle_model(CAR)
    row = wheel_models(model)[wheel]
    assert row["x"] == model.wheel_x[wheel]
    assert row["other_y"] == model.wheel_y[wheel ^ 1] - model.wheel_y[wheel]
    same = set(WheelModel.vars) - {"x", "y", "other_y"}
    assert {name: row[name] for name in same} == {
        name: getattr(model, name)[wheel] for name in same
    }


def test_a_loaded_slot_has_wheels_of_its_own():
    fleet = Fleet([CAR], 3, wp.get_device("cpu"))
    load = Load(mass_kg=200.0, x_m=0.4, y_m=0.3, z_m=0.5)
    fleet.load(1, load)
    rows = fleet.wheel_models.numpy()
    empty, loaded = wheel_models(vehicle_model(CAR)), wheel_models(vehicle_model(CAR, load))
    assert (rows[2] == loaded).all()
    assert (rows[[0, 1, 3]] == empty).all()
    assert (loaded["mount_z"] != empty["mount_z"]).all()
