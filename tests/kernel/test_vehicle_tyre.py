"""Tyre curves in the kernel against the formula in NumPy, and the command of the bench."""

import json

import numpy as np
import pytest
import warp as wp
from typer.testing import CliRunner

from twin.cli import app
from twin.vehicle.model import WheelModel, vehicle_model, wheel_models
from twin.vehicle.tyre import stiffnesses
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})
CAR = load_vehicle("opencav")
LOAD_N = 5000.0


@wp.kernel
def forces_kernel(
    wheels: wp.array(dtype=WheelModel),
    slips: wp.array2d(dtype=wp.float64),
    friction: wp.float64,
    load: wp.float64,
    forces: wp.array2d(dtype=wp.float64),
):
    i = wp.tid()
    k = stiffnesses(wheels[2], slips[i, 0], slips[i, 1], load, friction)
    forces[i, 0] = k[0] * slips[i, 0]
    forces[i, 1] = k[1] * slips[i, 1]


def forces(slips, friction):
    slips = np.ascontiguousarray(slips, float)
    out = wp.zeros(slips.shape, dtype=wp.float64, device="cpu")
    wheels = wp.array(wheel_models(vehicle_model(CAR)), dtype=WheelModel, device="cpu")
    given = wp.array(slips, dtype=wp.float64, device="cpu")
    wp.launch(
        forces_kernel,
        len(slips),
        inputs=[wheels, given, friction, LOAD_N],
        outputs=[out],
        device="cpu",
    )
    return out.numpy()


def formula(curve, s):
    """F over load by the two cubics, on friction 1."""
    s, k = abs(s), curve.shape
    if s <= curve.slip_extremum:
        t = s / curve.slip_extremum
        return curve.force_extremum * ((k - 2) * t**3 + (3 - 2 * k) * t**2 + k * t)
    t = min((s - curve.slip_extremum) / (curve.slip_asymptote - curve.slip_extremum), 1.0)
    drop = curve.force_asymptote - curve.force_extremum
    return curve.force_extremum + drop * (3 * t**2 - 2 * t**3)


@pytest.mark.parametrize("friction", [1.0, 0.5, 0.2])
@pytest.mark.parametrize("axis", [0, 1])
def test_pure_slip_follows_the_two_cubics(axis, friction):
    curve = CAR.rear_tyres.longitudinal if axis == 0 else CAR.rear_tyres.lateral
    s = np.concatenate([np.linspace(-1.2, 1.2, 301), [curve.slip_extremum, curve.slip_asymptote]])
    slips = np.zeros((len(s), 2))
    slips[:, axis] = s
    found = forces(slips, friction)
    expected = [friction * LOAD_N * np.sign(x) * formula(curve, x / friction) for x in s]
    np.testing.assert_allclose(found[:, axis], expected, atol=1e-9 * LOAD_N)
    assert (found[:, 1 - axis] == 0.0).all()
    stiff = curve.shape * curve.force_extremum / curve.slip_extremum
    tiny = np.zeros((1, 2))
    tiny[0, axis] = 1e-9
    assert forces(tiny, friction)[0, axis] == pytest.approx(LOAD_N * stiff * 1e-9, rel=1e-6)


def test_combined_slip_stays_in_the_friction_ellipse():
    rng = np.random.default_rng(1)
    slips = rng.uniform(-1.0, 1.0, (4000, 2)) * rng.uniform(0, 1, (4000, 1)) ** 3
    found = forces(slips, 0.7) / (0.7 * LOAD_N)
    tyres = CAR.rear_tyres
    share = np.hypot(
        found[:, 0] / tyres.longitudinal.force_extremum, found[:, 1] / tyres.lateral.force_extremum
    )
    assert share.max() <= 1.0 + 1e-12
    assert share.max() > 0.999
    assert (found * slips >= 0.0).all()


@pytest.mark.slow
def test_bench_prints_a_rate_and_the_ratio_to_the_oracle():
    done = CliRunner().invoke(app, ["bench", "vehicle", "--vehicles", "4", "--output", "json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["device"] == "cpu"
    assert found["substeps_per_s"] > 0
    assert found["ratio"] == pytest.approx(found["substeps_per_s"] / found["oracle_steps_per_s"])
    bad = CliRunner().invoke(app, ["bench", "vehicle", "--device", "cuda:99"])
    assert bad.exit_code != 0
    assert "not here" in str(bad.exception)
