"""Rows of many slots at once are those of each alone; cases end at exact limits."""

import numpy as np
import pytest

from schemas.campaign import Scenario
from schemas.messages import Command, Detection, Lights
from twin.kpi.recorder import CLOSING_MIN_MPS, KpiRecorder
from twin.kpi.verdict import Limits, have_ended
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.state import COLUMN


def drive(slots, ticks, case_of_slot, recorder=None):
    """Rows of made-up cases; a case's numbers follow from its number and tick alone."""
    recorder = recorder or KpiRecorder(slots)
    state = np.zeros((slots, len(COLUMN)))
    for tick in range(ticks):
        commands, lateral = [], []
        for slot, case in case_of_slot.items():
            rng = np.random.default_rng([case, tick])
            state[slot] = rng.normal(size=len(COLUMN))
            seen = [Detection("car", *rng.random(5).tolist()) for _ in range(rng.integers(3))]
            lights = Lights(high=bool(rng.integers(2)), fog=True, indicators=3)
            command = Command(slot, 0, tick, *rng.random(3).tolist(), True, lights, seen)
            commands.append(None if tick == ticks - 1 else command)
            lateral.append({"lateral_error_m": float(rng.random())} if case % 2 else {})
        now = np.full(slots, tick)
        recorder.add(list(case_of_slot), now, now * 50, state, commands, lateral)
    return recorder


def test_rows_do_not_depend_on_slot_neighbours_or_what_was_there_before():
    together = drive(5, 300, {3: 1, 0: 2, 4: 3})
    for slot, case in {3: 1, 0: 2, 4: 3}.items():
        alone = drive(1, 300, {0: case}).of(0).table().to_lists()
        assert repr(together.of(slot).table().to_lists()) == repr(alone)
    together.begin(3)
    drive(5, 7, {3: 8}, together)
    assert repr(together.of(3).table().to_lists()) == repr(
        drive(1, 7, {0: 8}).of(0).table().to_lists()
    )
    assert together.of(0).rows == 300, "others keep theirs"


def test_a_time_to_collision_exists_only_while_closing():
    recorder = KpiRecorder(2)
    state = np.zeros((2, len(COLUMN)))
    state[:, COLUMN["dtc_m"]] = 10.0
    state[:, COLUMN["closing_mps"]] = CLOSING_MIN_MPS, 2.0
    recorder.add([0, 1], np.zeros(2), np.zeros(2), state, [None, None], [{}, {}])
    assert recorder.of(0).table().to_lists()["ttc_s"] == [None]
    assert recorder.of(1).table().to_lists()["ttc_s"] == [5.0]


@pytest.mark.parametrize(
    ("time_ns", "rest_step", "collisions", "ends"),
    [
        (3_999_999_999, -1, 0, False),
        (4_000_000_000, -1, 0, True),
        (1_000_000_000, -1, 1, True),
        (2_000_000_000, 0, 0, True),
        (1_999_999_999, 0, 0, False),
        (2_200_000_000, 100, 0, True),
        (2_199_999_999, 100, 0, False),
    ],
)
def test_the_limits_are_exact(time_ns, rest_step, collisions, ends):
    assert PHYSICS_STEP_NS == 2_000_000
    limits = Limits.of(2)
    limits.begin(1, Scenario(duration_s=4.0, standstill_s=2.0))
    state = np.zeros((2, len(COLUMN)))
    state[1, COLUMN["rest_step"]] = rest_step
    state[1, COLUMN["collisions"]] = collisions
    assert bool(have_ended(limits, np.array([0, time_ns]), state)[1]) is ends


def test_what_is_not_valid_is_zero():
    """Scalars are made from the values, and a digest holds them."""
    recorder = KpiRecorder(1)
    state = np.zeros((1, len(COLUMN)))
    state[:, COLUMN["dtc_m"]], state[:, COLUMN["closing_mps"]] = 10.0, 0.5 * CLOSING_MIN_MPS
    recorder.add([0], np.zeros(1), np.zeros(1), state, [None], [{}])
    rows = recorder.of(0)
    for name in ("ttc_s", "throttle", "brake", "lateral_error_m"):
        assert (rows.column(name).tolist(), rows.valid(name).tolist()) == ([0], [False]), name
