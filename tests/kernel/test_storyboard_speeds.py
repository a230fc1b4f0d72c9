"""Speed actions against closed forms, on open ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    at,
    car,
    dynamics,
    from_time,
    played,
    program,
    speed_at_once,
    start_at,
    steps_of,
)

from twin.scenario.storyboard.program.actions import (
    DynamicsDimension,
    DynamicsShape,
    MotionLimits,
    SpeedAction,
    SpeedProfileAction,
    SpeedProfileEntry,
)

pytestmark = pytest.mark.slow

TIME, RATE, DISTANCE = DynamicsDimension.TIME, DynamicsDimension.RATE, DynamicsDimension.DISTANCE
LINEAR, CUBIC = DynamicsShape.LINEAR, DynamicsShape.CUBIC
SINUSOIDAL, STEP = DynamicsShape.SINUSOIDAL, DynamicsShape.STEP
CURVES = {
    LINEAR: lambda q: q,
    CUBIC: lambda q: 3 * q**2 - 2 * q**3,
    SINUSOIDAL: lambda q: (1 - np.cos(np.pi * q)) / 2,
    STEP: lambda q: np.ones_like(q),
}
PEAKS = {LINEAR: 1.0, CUBIC: 1.5, SINUSOIDAL: math.pi / 2}
BEGIN = 20
"""Step at which the action starts."""


def run(action, steps=600, speed_mps=10.0, others=(), **limits):
    entities = [car("a", **limits), *(car(f"o{k}") for k, _ in enumerate(others))]
    init = start_at(0, at(0.0), speed_mps)
    for number, (place, other_speed) in enumerate(others, 1):
        init += start_at(number, place, other_speed)
    events = [EventPlan(from_time(BEGIN * STEP_S), [action])]
    return played(program(entities, init, [GroupPlan((0,), events)]), steps)


@pytest.mark.parametrize("shape", [LINEAR, CUBIC, SINUSOIDAL])
@pytest.mark.parametrize(
    ("dimension", "value"), [(TIME, 2.0), (TIME, 1.234), (RATE, 4.0), (DISTANCE, 30.0)]
)
@pytest.mark.parametrize("target", [20.0, 4.0])
def test_shapes_and_dimensions(shape, dimension, value, target):
    done = run(SpeedAction(dynamics(shape, value, dimension), -1, target))
    span = {
        TIME: value,
        RATE: PEAKS.get(shape, 0.0) * abs(target - 10.0) / value,
        DISTANCE: 2.0 * value / (10.0 + target),
    }[dimension]
    after = np.maximum((np.arange(len(done.speed_mps)) - BEGIN) * STEP_S, 0.0)
    expected = 10.0 + (target - 10.0) * CURVES[shape](np.minimum(after / span, 1.0))
    np.testing.assert_allclose(done.speed_mps[:, 0], expected, atol=2e-6)
    np.testing.assert_allclose(np.diff(done.x_m[:, 0]), expected[1:] * STEP_S, atol=1e-9)
    steps = math.ceil(span / STEP_S - 1e-4)
    assert steps_of(done.events, "g0.e0", "end") == [BEGIN + steps - 1]
    way = done.x_m[BEGIN + steps, 0] - done.x_m[BEGIN, 0]
    if dimension == DISTANCE:
        assert way == pytest.approx(value, abs=0.2)


def test_step_is_at_once():
    done = run(speed_at_once(25.0))
    assert done.speed_mps[BEGIN, 0] == 10.0
    assert done.speed_mps[BEGIN + 1, 0] == 25.0
    assert steps_of(done.events, "g0.e0", "start") == [BEGIN]
    assert steps_of(done.events, "g0.e0", "end") == [BEGIN]


def test_through_standstill_by_distance():
    """Two parts about standstill, of ways as v0^2 to v1^2."""
    done = run(SpeedAction(dynamics(LINEAR, 20.0, DISTANCE), -1, -5.0))
    first = 20.0 * 100.0 / 125.0
    span = 2.0 * first / 10.0 + 2.0 * (20.0 - first) / 5.0
    after = (np.arange(len(done.speed_mps)) - BEGIN) * STEP_S
    expected = np.clip(10.0 - 15.0 * after / span, -5.0, 10.0)
    np.testing.assert_allclose(done.speed_mps[:, 0], expected, atol=1e-6)


@pytest.mark.parametrize("shape", [LINEAR, CUBIC, SINUSOIDAL])
def test_limits_stretch_the_transition(shape):
    """The peak of the acceleration is the actor's largest."""
    done = run(SpeedAction(dynamics(shape, 0.5), -1, 20.0), acceleration_max_mps2=5.0)
    span = PEAKS[shape] * 10.0 / 5.0
    after = np.maximum((np.arange(len(done.speed_mps)) - BEGIN) * STEP_S, 0.0)
    expected = 10.0 + 10.0 * CURVES[shape](np.minimum(after / span, 1.0))
    np.testing.assert_allclose(done.speed_mps[:, 0], expected, atol=1e-3)
    assert np.diff(done.speed_mps[:, 0]).max() <= 5.0 * STEP_S + 1e-9


def test_top_speed():
    done = run(speed_at_once(100.0), speed_max_mps=33.0)
    assert done.speed_mps[-1, 0] == 33.0


def test_relative_and_continuous():
    """Keeps the difference until something else begins; a factor ends when it is reached."""
    action = SpeedAction(dynamics(LINEAR, 1.0), 1, -5.0, continuous=True)
    done = run(action, others=[(at(50.0), 22.0)])
    assert done.speed_mps[BEGIN + 100, 0] == pytest.approx(17.0)
    assert done.speed_mps[-1, 0] == pytest.approx(17.0)
    assert steps_of(done.events, "g0.e0", "end") == []
    done = run(SpeedAction(dynamics(LINEAR, 1.0), 1, 0.5, factor=True), others=[(at(50.0), 22.0)])
    assert done.speed_mps[-1, 0] == pytest.approx(11.0)
    assert steps_of(done.events, "g0.e0", "end") == [BEGIN + 99]


def test_profile():
    """Straight lines from entry to entry; without a time as fast as allowed."""
    entries = (
        SpeedProfileEntry(14.0, 1.0),
        SpeedProfileEntry(8.0, 1.5),
        SpeedProfileEntry(20.0, -1.0),
    )
    done = run(SpeedProfileAction(-1, entries, False, MotionLimits(6.0, 6.0)))
    after = (np.arange(len(done.speed_mps)) - BEGIN) * STEP_S
    expected = np.interp(after, [0.0, 1.0, 2.5, 4.5], [10.0, 14.0, 8.0, 20.0])
    np.testing.assert_allclose(done.speed_mps[:, 0], expected, atol=1e-6)
    assert steps_of(done.events, "g0.e0", "end") == [BEGIN + 449]


@pytest.mark.parametrize(("follow", "span"), [(False, 1.0), (True, 2.0)])
def test_profile_within_its_limits(follow, span):
    """10 m/s more in 1 s are 10 m/s^2; within a limit of 5 they take 2 s."""
    entries = (SpeedProfileEntry(20.0, 1.0),)
    done = run(SpeedProfileAction(-1, entries, follow, MotionLimits(5.0, 5.0)))
    after = (np.arange(len(done.speed_mps)) - BEGIN) * STEP_S
    expected = np.interp(after, [0.0, span], [10.0, 20.0])
    np.testing.assert_allclose(done.speed_mps[:, 0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("start_mps", "target_mps", "limit", "rate", "given_s"),
    [
        (10.0, 20.0, 4.0, 2.0, -1.0),  # 4 m/s2 is reached: 10 / 4 + 4 / 2 s
        (10.0, 12.0, 4.0, 2.0, -1.0),  # it is not: 2 sqrt(2 / 2) s
        (20.0, 5.0, 6.0, 3.0, 6.0),  # slower than it must be
        (10.0, 20.0, 4.0, 2.0, 1.0),  # later than it should be
        (0.0, -6.0, 3.0, 1.5, -1.0),
    ],
)
def test_a_profile_with_limits_of_jerk(start_mps, target_mps, limit, rate, given_s):
    """Straight rise, plateau and fall of the acceleration; nothing above its limits."""
    change = abs(target_mps - start_mps)
    shortest = 2.0 * math.sqrt(change / rate)
    if limit**2 < change * rate:
        shortest = change / limit + limit / rate
    span = max(given_s, shortest)
    # The other direction has no limits: they must not be mixed up.
    open_end = float("inf")
    limits = MotionLimits(limit, open_end, open_end, rate, open_end)
    if target_mps < start_mps:
        limits = MotionLimits(open_end, limit, open_end, open_end, rate)
    entries = (SpeedProfileEntry(target_mps, given_s),)
    done = run(SpeedProfileAction(-1, entries, True, limits), 900, start_mps)
    speeds = done.speed_mps[:, 0]
    most = 0.5 * rate * (span - math.sqrt(max(span**2 - 4.0 * change / rate, 0.0)))
    assert most <= limit + 1e-9
    fine = np.linspace(0.0, span, 100_001)
    pull = np.minimum(np.minimum(rate * fine, rate * (span - fine)), most)
    gone = np.concatenate([[0.0], np.cumsum((pull[1:] + pull[:-1]) / 2.0 * np.diff(fine))])
    after = (np.arange(len(speeds)) - BEGIN) * STEP_S
    sign = math.copysign(1.0, target_mps - start_mps)
    np.testing.assert_allclose(
        speeds, start_mps + sign * np.interp(after, fine, gone), rtol=0.0, atol=1e-6
    )
    end = BEGIN + math.ceil(span / STEP_S - 1e-4) - 1
    assert steps_of(done.events, "g0.e0", "end") == [end]


def test_a_profile_that_is_exact_keeps_its_times():
    """Following mode position: whatever the limits."""
    limits = MotionLimits(1.0, 1.0, float("inf"), 0.5, 0.5)
    done = run(SpeedProfileAction(-1, (SpeedProfileEntry(20.0, 1.0),), False, limits))
    rise = done.speed_mps[:, 0]
    assert rise[BEGIN + 50] == pytest.approx((rise[BEGIN] + 20.0) / 2.0)
