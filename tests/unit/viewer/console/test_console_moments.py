"""The decisive moment: impact, closest approach, trigger, end, in this order."""

import pytest

from viewer.console.moments import DecisiveMoment, decisive

TIMES = [0, 10, 20, 30]
NONE = [None] * 4


@pytest.mark.parametrize(
    ("collisions", "dtc_m", "nearest_m", "aeb", "moment"),
    [
        ([0, 0, 1, 2], [9.0, 8.0, 1.0, 0.5], NONE, [False, True, True, True], (20, "impact")),
        ([0] * 4, [9.0, 4.0, 4.0, 6.0], [0.1, 1.0, 1.0, 1.0], NONE, (10, "closest")),
        ([0] * 4, NONE, [3.0, None, 2.0, 2.5], [True] * 4, (20, "closest")),
        (NONE, NONE, NONE, [None, False, True, True], (20, "trigger")),
        (NONE, NONE, NONE, NONE, (30, "end")),
        ([0] * 4, [None, 0.0, 5.0, None], NONE, NONE, (10, "closest")),
    ],
)
def test_what_decides(collisions, dtc_m, nearest_m, aeb, moment):
    assert decisive(TIMES, collisions, dtc_m, nearest_m, aeb) == DecisiveMoment(*moment)


@pytest.mark.parametrize("verdict", ["false_braking", "false_reaction"])
def test_a_false_braking_is_decided_by_its_trigger(verdict):
    nearer = [9.0, 8.0, 7.0, 6.0]
    braked = [False, True, True, False]
    assert decisive(TIMES, [0] * 4, nearer, NONE, braked, verdict).as_json()["what"] == "trigger"
    assert decisive(TIMES, [0] * 4, nearer, NONE, braked, verdict).sim_time_ns == 10
    assert decisive(TIMES, [0] * 4, nearer, NONE, braked, "pass") == DecisiveMoment(30, "closest")
    # It braked for no reason and was hit, or only the brake pedal stopped it.
    hit = DecisiveMoment(30, "impact")
    assert decisive(TIMES, [0, 0, 0, 1], nearer, NONE, braked, verdict) == hit
    assert decisive(TIMES, [0] * 4, nearer, NONE, NONE, verdict) == DecisiveMoment(30, "closest")


def test_a_case_without_a_tick_has_ended_at_its_start():
    assert decisive([], [], [], [], []) == DecisiveMoment(0, "end")
    assert DecisiveMoment(1_500_000_000, "end").as_json() == {"t": 1.5, "what": "end"}
