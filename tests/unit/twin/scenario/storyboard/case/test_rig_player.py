"""Programs that join a rig's player late: what they need of a step is done from then on."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    at,
    car,
    program,
    speed_at_once,
    speed_over,
    start_at,
    trigger,
    when,
)

from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.program.actions import ControllerAction
from twin.scenario.storyboard.program.conditions import CollisionCondition
from twin.scenario.storyboard.program.program import DriverModel, InitAction, Program

STEPS = 120
PLAIN = program([car()], start_at(0, at(0.0), 10.0))
"""One car that keeps its speed: no phase of a step is needed for it but that of stories."""
LATE = {
    "an action of Init that lasts": program(
        [car()],
        [*start_at(0, at(0.0), 10.0), InitAction(speed_over(3.0, 20.0), 0)],
    ),
    "a driver model": program(
        [car(), car("ahead")],
        [
            *start_at(0, at(0.0), 20.0),
            *start_at(1, at(40.0), 10.0),
            InitAction(ControllerAction(True, True, 0), 0),
        ],
        models=[DriverModel(33.0, politeness=-1.0)],
    ),
    "a collision": program(
        [car(), car("wall")],
        [*start_at(0, at(0.0), 20.0), *start_at(1, at(15.0), 0.0)],
        [
            GroupPlan(
                (0,), [EventPlan(trigger(when(CollisionCondition(1, -1), 0)), [speed_at_once(3.0)])]
            )
        ],
    ),
}
SPEEDS_MPS = {
    "an action of Init that lasts": (13.9, 14.1),
    "a driver model": (12.0, 19.0),
    "a collision": (3.0, 3.0),
}
"""Of the first car at the end: each has done by then what the plain program never does."""


def rows_of(
    slots: int, begins: Sequence[tuple[int, int, Program]], slot: int
) -> tuple[list[bytes], float]:
    """What a slot does from the last begin in it on: states after each step and transitions, with
    the speed of its first entity at the end [m/s].

    ``begins``: step, slot and program; the first is that of which the player is made.
    """
    player = RigPlayer(begins[0][2], None, slots, STEP_S, "cpu")
    count, rows = 0, list[bytes]()
    for step in range(begins[-1][0] + STEPS):
        for at_step, number, begins_now in begins:
            if at_step == step:
                player.begin(number, begins_now, -1)
                if number == slot:
                    count = len(begins_now.entities)
                    rows.clear()
        player.step()
        reals = player.bodies.reals.numpy()[slot, :count]
        wholes = player.bodies.wholes.numpy()[slot, :count]
        rows.append(reals.tobytes() + wholes.tobytes())
    assert len(rows) == STEPS
    assert player.steps(slot) == STEPS
    rows.append(repr(player.transitions(slot)).encode())
    return rows, float(player.states().speed_mps[slot, 0])


@pytest.mark.parametrize("late", LATE)
def test_what_joins_late_is_as_alone(late):
    alone, speed_mps = rows_of(1, [(0, 0, LATE[late])], 0)
    low_mps, high_mps = SPEEDS_MPS[late]
    assert low_mps <= speed_mps <= high_mps
    joined = rows_of(2, [(0, 0, PLAIN), (25, 1, LATE[late])], 1)
    assert joined == (alone, speed_mps), "in a slot of its own"
    replacing = rows_of(1, [(0, 0, PLAIN), (25, 0, LATE[late])], 0)
    assert replacing == (alone, speed_mps), "in the place of a program that no slot runs any more"


@pytest.mark.parametrize("late", LATE)
def test_what_was_there_first_does_not_change(late):
    alone, speed_mps = rows_of(1, [(0, 0, PLAIN)], 0)
    assert speed_mps == 10.0
    both = rows_of(2, [(0, 1, LATE[late]), (20, 0, PLAIN)], 0)
    assert both == (alone, speed_mps)
