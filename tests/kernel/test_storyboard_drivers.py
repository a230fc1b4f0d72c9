"""Driver models against their equations: IDM on open ground, MOBIL on a road."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from storyboard_programs import STEP_S, at, car, played, program, start_at

from twin.bench.storyboard_traffic import on_ring, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.program.actions import ControllerAction
from twin.scenario.storyboard.program.program import DriverModel, InitAction

pytestmark = pytest.mark.slow

MODEL = DriverModel(33.0, politeness=-1.0)
LENGTH_M = 5.0


def drive(bodies, models, steps, *, roads=None, lateral=True):
    """Bodies by place, speed and model (-1: none)."""
    init = []
    for number, (place, speed_mps, model) in enumerate(bodies):
        init += start_at(number, place, speed_mps)
        if model >= 0:
            init.append(InitAction(ControllerAction(lateral, True, model), number))
    entities = [car(f"car{number}") for number in range(len(bodies))]
    return played(program(entities, init, models=models), steps, roads)


def pull(model, speed, gap, ahead):
    free = 1.0 - (speed / model.desired_speed_mps) ** model.exponent
    if gap is None:
        return model.acceleration_mps2 * free
    closing = (
        speed
        * (speed - ahead)
        / (2.0 * math.sqrt(model.acceleration_mps2 * model.deceleration_mps2))
    )
    wanted = model.gap_min_m + max(0.0, speed * model.time_gap_s + closing)
    return model.acceleration_mps2 * (free - (wanted / max(gap, 0.1)) ** 2)


def test_free_drive():
    done = drive([(at(0.0), 5.0, 0)], [MODEL], 3000)
    speed, x = 5.0, 0.0
    for row in range(1, 3001):
        speed += pull(MODEL, speed, None, 0.0) * STEP_S
        x += speed * STEP_S
        if row % 500 == 0:
            assert done.speed_mps[row, 0] == pytest.approx(speed, abs=1e-9)
            assert done.x_m[row, 0] == pytest.approx(x, abs=1e-6)
    assert 31.9 < done.speed_mps[-1, 0] < 33.0


def test_queue_against_the_equations():
    """Three cars behind one of 15 m/s; all see the others as they were before the step."""
    bodies = [(at(0.0), 25.0, 0), (at(40.0), 20.0, 0), (at(70.0), 20.0, 0), (at(100.0), 15.0, -1)]
    done = drive(bodies, [MODEL], 6000)
    x = np.array([0.0, 40.0, 70.0, 100.0])
    v = np.array([25.0, 20.0, 20.0, 15.0])
    for row in range(1, 6001):
        gaps = np.diff(x) - LENGTH_M
        new = [max(v[k] + pull(MODEL, v[k], gaps[k], v[k + 1]) * STEP_S, 0.0) for k in range(3)]
        v = np.array([*new, 15.0])
        x = x + v * STEP_S
        if row % 500 == 0:
            np.testing.assert_allclose(done.x_m[row], x, atol=1e-6)
    # In equilibrium the gap is (s0 + v T) / sqrt(1 - (v / v0)^4).
    steady = (2.0 + 15.0 * 1.5) / math.sqrt(1.0 - (15.0 / 33.0) ** 4)
    np.testing.assert_allclose(np.diff(done.x_m[-1]) - LENGTH_M, steady, atol=0.3)


def test_stops_behind_an_obstacle():
    done = drive([(at(0.0), 20.0, 0), (at(200.0), 0.0, -1)], [MODEL], 6000)
    assert done.speed_mps[-1, 0] == pytest.approx(0.0, abs=0.01)
    assert 200.0 - done.x_m[-1, 0] - LENGTH_M == pytest.approx(2.0, abs=0.2)


@pytest.fixture(scope="module")
def ring():
    return road_tables(ring_network())


@pytest.mark.parametrize(
    ("politeness", "lateral", "beside", "final"),
    [
        (0.3, True, (), -2),
        (-1.0, True, (), -3),
        (0.3, False, (), -3),
        (0.3, True, ((4.0, -2),), -4),
        (0.3, True, ((4.0, -2), (4.0, -4)), -3),
        (0.3, True, ((-12.0, -2), (-12.0, -4)), -3),
    ],
)
def test_overtaking(ring, politeness, lateral, beside, final):
    """A slow car ahead; whoever is beside, or fast and close behind, blocks a lane."""
    model = msgspec.structs.replace(MODEL, politeness=politeness)
    bodies = [(on_ring(100.0, -3), 22.0, 0), (on_ring(150.0, -3), 12.0, -1)]
    for ahead, lane in beside:
        speed = 22.0 if ahead > 0 else 33.0
        bodies.append((on_ring(100.0 + ahead, lane), speed, -1))
    done = drive(bodies, [model], 60 if len(beside) == 2 else 800, roads=ring, lateral=lateral)
    assert done.lane[-1, 0] == final
    if len(beside) < 2 and final != -3:
        sideways = np.abs(np.diff(np.hypot(done.x_m[:, 0], done.y_m[:, 0])))
        assert sideways.max() <= 1.5 * 3.5 / model.change_duration_s * STEP_S + 1e-6


def test_change_takes_its_time_and_ends_in_the_middle(ring):
    model = msgspec.structs.replace(MODEL, politeness=0.0)
    bodies = [(on_ring(100.0, -3), 22.0, 0), (on_ring(150.0, -3), 12.0, -1)]
    done = drive(bodies, [model], 900, roads=ring)
    radius = np.hypot(done.x_m[:, 0], done.y_m[:, 0])
    moving = np.flatnonzero(np.abs(np.diff(radius)) > 1e-6)
    assert len(moving) == pytest.approx(model.change_duration_s / STEP_S, abs=30)
    assert radius[-1] == pytest.approx(400.0 + 1.5 * 3.5, abs=2e-3)


def test_nobody_without_a_model_changes(ring):
    bodies = [(on_ring(100.0, -3), 22.0, -1), (on_ring(150.0, -3), 22.0, 0)]
    done = drive(bodies, [MODEL], 200, roads=ring)
    assert done.speed_mps[-1, 0] == 22.0
    assert done.speed_mps[-1, 1] > 22.0
