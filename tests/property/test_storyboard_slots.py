"""Whatever runs beside a program, and whenever it was started, its states are the same bytes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from train_traffic import train_traffic

from twin.bench.storyboard_traffic import driver_traffic, reacting_traffic, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer

pytestmark = pytest.mark.slow

PROGRAMS = (
    *(reacting_traffic(32), reacting_traffic(5, 1), reacting_traffic(16, 2)),
    driver_traffic(20),
    train_traffic(16),
)
STEPS = 400


@cache
def ring():
    return road_tables(ring_network())


def bytes_of(player: StoryboardPlayer, slot: int, program: int) -> bytes:
    """States of a slot's own entities, its transitions and its clock."""
    count = len(PROGRAMS[program].entities)
    reals = player.bodies.reals.numpy()[slot, :count]
    wholes = player.bodies.wholes.numpy()[slot, :count]
    clock = player.steps(slot)
    return reals.tobytes() + wholes.tobytes() + repr((player.transitions(slot), clock)).encode()


@cache
def alone(program: int, steps: int = STEPS) -> bytes:
    player = StoryboardPlayer(PROGRAMS, ring(), 1)
    player.start(0, program)
    for _ in range(steps):
        player.step()
    return bytes_of(player, 0, program)


def test_programs_differ_and_react():
    assert len({alone(number) for number in range(len(PROGRAMS))}) == len(PROGRAMS)
    player = StoryboardPlayer(PROGRAMS, ring(), 1)
    player.start(0, 0)
    for _ in range(STEPS):
        player.step()
    assert len(player.transitions(0)) > 60
    assert player.overflows(0) == ()
    speeds = player.states().speed_mps[0]
    assert len(np.unique(speeds)) > 20


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_other_programs_of_the_player_do_not_matter(number):
    player = StoryboardPlayer(PROGRAMS[number : number + 1], ring(), 1)
    player.start(0, 0)
    for _ in range(STEPS):
        player.step()
    assert bytes_of(player, 0, number) == alone(number)


def test_drivers_change_lanes():
    player = StoryboardPlayer(PROGRAMS, ring(), 1)
    player.start(0, 3)
    before = player.states().lane[0, :20]
    for _ in range(1500):
        player.step()
    assert (player.states().lane[0, :20] != before).sum() > 5
    assert (player.states().lane[0, :20] != 0).all()


@pytest.mark.parametrize("slots", [1, 5, 64])
def test_any_number_of_slots(slots):
    player = StoryboardPlayer(PROGRAMS, ring(), slots)
    order = [(3 * slot + 1) % len(PROGRAMS) for slot in range(slots)]
    for slot, program in enumerate(order):
        player.start(slot, program)
    for _ in range(STEPS):
        player.step()
    for slot, program in enumerate(order):
        assert bytes_of(player, slot, program) == alone(program)


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    plan=st.lists(
        st.tuples(st.integers(0, 4), st.integers(0, 150), st.integers(0, 100)),
        min_size=2,
        max_size=5,
    )
)
def test_starts_and_restarts_at_any_step(plan):
    """Each slot is started at its own step, and once more; from there on it is as if alone."""
    player = StoryboardPlayer(PROGRAMS, ring(), len(plan))
    begun = {}
    for step in range(300):
        for slot, (program, first, again) in enumerate(plan):
            if step == first:
                player.start(slot, program)
                begun[slot] = step
            if step == first + again:
                player.start(slot, (program + 1) % len(PROGRAMS))
                begun[slot] = step
        player.step()
    for slot, (program, first, again) in enumerate(plan):
        steps = 300 - begun[slot]
        assert begun[slot] == first + again
        other = (program + 1) % len(PROGRAMS)
        assert bytes_of(player, slot, other) == alone(other, steps)


def test_slots_that_do_not_run_stay():
    player = StoryboardPlayer(PROGRAMS, ring(), 2)
    player.start(0, 1)
    for _ in range(20):
        player.step()
    assert not player.running(1)
    assert player.bodies.reals.numpy()[1].any() == np.False_
    assert player.steps(1) == 0
