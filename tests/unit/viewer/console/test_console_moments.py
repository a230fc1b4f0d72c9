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


def test_a_case_without_a_tick_has_ended_at_its_start():
    assert decisive([], [], [], [], []) == DecisiveMoment(0, "end")
    assert DecisiveMoment(1_500_000_000, "end").as_json() == {"t": 1.5, "what": "end"}
