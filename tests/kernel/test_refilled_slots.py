"""A rig's storyboards are the same bytes whatever runs in the slots beside them.

Rows of Euro NCAP's campaign go through a few slots, one after the other as in a run, and each goes
through a slot of its own. Their programs differ in trajectories, events and entities, so tables
change with nearly every begin.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from conductor.run.source import load
from schemas.kinds.scenarios.storyboard import KIND
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.vehicle.vehicle_file import load_vehicle

if TYPE_CHECKING:
    from twin.scenario.storyboard.program.program import Program

pytestmark = pytest.mark.slow

SLOTS = 6
EVERY = 40
"""Steps between two looks."""
CASES = 36
Looks = dict[tuple[int, int], bytes]
"""Poses and speeds of the bodies of a case, by case and step."""


def steps_of(case: int) -> int:
    """How many steps a case runs: slots become free one by one."""
    return 600 + case * 389 % 10 * EVERY


def looked(player: StoryboardPlayer, programs: list[Program], case: int, slot: int) -> bytes:
    states = player.states()
    count = len(programs[case].entities)
    names = ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "visible")
    rows = [getattr(states, name)[slot, :count].tobytes() for name in names]
    return b"".join(rows) + repr(player.transitions(slot)).encode()


def refilled(programs: list[Program], roads) -> Looks:
    looks: Looks = {}
    player = RigPlayer(programs[0], roads, SLOTS, 0.01, "cpu")
    todo = iter(range(len(programs)))
    runs: dict[int, tuple[int, int]] = dict.fromkeys(range(SLOTS), (-1, 0))
    while runs:
        for slot, (case, step) in list(runs.items()):
            if case < 0 or step == steps_of(case):
                player.end(slot)
                case, step = next(todo, -1), 0
                if case < 0:
                    del runs[slot]
                    continue
                player.begin(slot, programs[case], -1)
            runs[slot] = (case, step + 1)
        player.step()
        for slot, (case, step) in runs.items():
            if step % EVERY == 0:
                looks[case, step] = looked(player, programs, case, slot)
    return looks


def in_slots_of_their_own(programs: list[Program], roads) -> Looks:
    looks: Looks = {}
    for case, program in enumerate(programs):
        player = StoryboardPlayer([program], roads, 1)
        player.start(0, 0)
        for step in range(1, steps_of(case) + 1):
            player.step()
            if step % EVERY == 0:
                looks[case, step] = looked(player, programs, case, 0)
    return looks


@pytest.mark.parametrize("road", ["track", "crossroads"])
def test_no_slot_depends_on_its_neighbours(road):
    vehicle = load_vehicle("opencav")
    loaded = []
    for case in load("euro-ncap-2026").cases:
        config = KIND.config_of(case.variation.scenario)
        loaded.append(load_storyboard(config.storyboard, config.numbers, vehicle))
    here = [one for one in loaded if road in one.road]
    programs = [one.program for one in here[:: max(1, len(here) // CASES)]]
    assert len(Counter(len(program.trajectories) for program in programs)) > 1
    assert len(programs) >= CASES
    roads = road_tables(programs[0].network)
    assert refilled(programs, roads) == in_slots_of_their_own(programs, roads)
