"""Latency, jitter, rate and losses between a command and its effect."""

from collections import deque

import numpy as np
import pytest

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.command_delay import Delays

STEP_MS = 2
PERIOD_STEPS = 25  # 20 Hz


def case(seed=3, matrix=None, **autonomy):
    campaign, mistakes = parse_campaign(
        {
            "campaign": "c",
            "seed": seed,
            "autonomy": autonomy,
            "matrix": matrix or {"weather": ["clear"]},
        }
    )
    assert not mistakes, mistakes
    return expand(campaign)


def arrivals(one, ticks):
    """Tick -> step of arrival of what was not lost; each alone, so that none overtakes."""
    delays = Delays(one)
    found = {}
    for tick in range(ticks):
        pending = deque()
        delays.send(pending, tick * PERIOD_STEPS, tick, Command(0, 1, tick, 0.0, 0.0, 0.0))
        if pending:
            found[tick] = pending[0][0]
    return found


@pytest.mark.parametrize(("latency_ms", "steps"), [(0, 0), (1, 1), (2, 1), (3, 2), (400, 200)])
def test_a_constant_latency_is_rounded_up_to_physics_steps(latency_ms, steps):
    found = arrivals(case(latency_ms=latency_ms)[0], 4)
    assert found == {tick: tick * PERIOD_STEPS + steps for tick in range(4)}


def test_jitter_is_even_and_the_case_s_own():
    (one,) = case(latency_ms=100, latency_jitter_ms=200)
    found = arrivals(one, 4000)
    delays_ms = np.array([STEP_MS * (step - t * PERIOD_STEPS) for t, step in found.items()])
    assert delays_ms.min() >= 100
    assert delays_ms.max() <= 300
    assert abs(delays_ms.mean() - 201) < 4
    assert len(set(delays_ms)) == 100  # rounded up to physics steps
    assert arrivals(one, 50) == arrivals(one, 50)
    (other,) = case(seed=4, latency_ms=100, latency_jitter_ms=200)
    assert arrivals(other, 50) != arrivals(one, 50)


def test_a_slow_stack_and_losses():
    (one,) = case(rate_hz=5)
    assert list(arrivals(one, 12)) == [0, 4, 8]
    (one,) = case(drop=0.25)
    assert abs(len(arrivals(one, 4000)) / 4000 - 0.75) < 0.02
    (one,) = case(drop=1.0)
    assert arrivals(one, 20) == {}
    (one,) = case(drop=0.0)
    assert len(arrivals(one, 20)) == 20


def test_nobody_obeys_an_old_command_after_a_newer_one():
    delays = Delays(case(latency_jitter_ms=500)[0])
    pending = deque()
    overtaken = 0
    for tick in range(200):
        before = len(pending)
        delays.send(pending, tick * PERIOD_STEPS, tick, Command(0, 1, tick, 0.0, 0.0, 0.0))
        overtaken += before + 1 - len(pending)
        steps = [step for step, _ in pending]
        assert steps == sorted(set(steps))
        assert [c.tick for _, c in pending] == sorted(c.tick for _, c in pending)
    assert overtaken > 20


def test_delays_are_axes_and_the_stack_is_none():
    cases = case(matrix={"autonomy.latency_ms": [0, 800], "autonomy.drop": [0.0, 0.5]})
    assert [(c.variation.latency_ms, c.variation.drop) for c in cases] == [
        (0, 0.0),
        (0, 0.5),
        (800, 0.0),
        (800, 0.5),
    ]
    assert cases[3].id == "drop_0.5-latency_ms_800"
    for axis, words in (
        ({"autonomy.stack": ["a:B"]}, "unknown axis"),
        ({"autonomy.rate_hz": [3]}, "given 3, allowed: a divisor of control_hz 20"),
        ({"autonomy.latency_ms": [-1]}, "-1"),
    ):
        _, mistakes = parse_campaign({"campaign": "c", "matrix": axis})
        assert words in mistakes[0].line("c.yaml")


def test_what_gets_lost_says_nothing_about_delays():
    """Of commands that arrive, the delays are as even as without losses."""
    (one,) = case(latency_jitter_ms=200, drop=0.5)
    found = arrivals(one, 4000)
    delays_ms = np.array([STEP_MS * (step - t * PERIOD_STEPS) for t, step in found.items()])
    assert 1800 < len(found) < 2200
    assert abs(delays_ms.mean() - 101) < 5
