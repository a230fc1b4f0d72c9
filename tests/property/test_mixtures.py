"""Mixtures of a backlog's lanes, held against a look at all that waits."""

import heapq

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conductor.core import backlog as lanes
from conductor.core.backlog import GOLDEN, SPREAD_MAX, Backlog, LaneMixture

RIG, GROUP = "rig", 0
WINDOW = 12

STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("lease"), st.integers(1, 6)),
        st.tuples(st.just("remove"), st.integers(0, 10**6)),
        st.tuples(st.just("again"), st.integers(0, 10**6)),
        st.tuples(st.just("grow"), st.integers(1, 30)),
        st.tuples(st.just("look"), st.integers(1, 40)),
    ),
    min_size=1,
    max_size=40,
)


def by_looking(waiting: list[int], count: int, window: int) -> list[int]:
    """The same cases, found by looking at all of the window."""
    return sorted(heapq.nsmallest(count, waiting[:window], key=lambda p: p * GOLDEN % 1.0))


@settings(deadline=None)
@given(STEPS)
def test_a_mixture_is_what_a_look_at_all_of_the_lane_would_give(steps):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes, "SPREAD_MAX", WINDOW)
        backlog = Backlog()
        backlog.extend(RIG, list(range(20)), GROUP)
        waiting, gone, end = list(range(20)), [], 20
        for what, number in steps:
            match what:
                case "lease":
                    leased = backlog.mixed(RIG, GROUP, number)
                    assert leased == by_looking(waiting, number, WINDOW)
                    for position in leased:
                        backlog.remove(RIG, position, GROUP)
                        waiting.remove(position)
                        gone.append(position)
                case "remove" if waiting:
                    gone.append(waiting.pop(number % len(waiting)))
                    backlog.remove(RIG, gone[-1], GROUP)
                case "again" if gone:
                    position = gone.pop(number % len(gone))
                    backlog.add(RIG, position, GROUP)
                    waiting = sorted([*waiting, position])
                case "grow":
                    further = list(range(end, end + number))
                    backlog.extend(RIG, further, GROUP)
                    waiting, end = waiting + further, end + number
                case "look":
                    assert backlog.mixed(RIG, GROUP, number) == by_looking(waiting, number, WINDOW)
            assert len(backlog) == len(waiting)


def test_so_many_cases_are_looked_at_and_no_more():
    """A conductor has one thread: what waits behind is not looked at until those before leave."""
    lane = [-position for position in reversed(range(3 * SPREAD_MAX))]
    made = LaneMixture()
    first = made.take(lane, 16)
    assert first == by_looking(list(range(3 * SPREAD_MAX)), 16, SPREAD_MAX)
    assert len(made) == SPREAD_MAX
    assert made.take(lane, 16) == first  # taking changes nothing
    assert len(made) == SPREAD_MAX


@pytest.mark.parametrize("leaving", [100, SPREAD_MAX])
def test_what_has_left_is_not_kept_for_ever(leaving):
    """Rigs that are filled up take the first cases, and leave the mixture's alone."""
    lane = [-position for position in reversed(range(24_000 + SPREAD_MAX))]
    made = LaneMixture()
    while len(lane) > SPREAD_MAX:
        waiting = [-negated for negated in reversed(lane[-SPREAD_MAX:])]
        assert made.take(lane, 2) == by_looking(waiting, 2, SPREAD_MAX)
        assert len(made) <= 2 * SPREAD_MAX
        del lane[-leaving:]


def test_a_lane_that_is_gone_has_no_mixture():
    backlog = Backlog()
    assert backlog.mixed(RIG, GROUP, 3) == []
    backlog.extend(RIG, [3, 7], GROUP)
    assert backlog.mixed(RIG, GROUP, 16) == [3, 7]
    backlog.remove(RIG, 3, GROUP)
    backlog.remove(RIG, 7, GROUP)
    assert backlog.mixed(RIG, GROUP, 16) == []
    backlog.extend(RIG, [1, 2], GROUP)  # whatever was looked at before
    assert backlog.mixed(RIG, GROUP, 16) == [1, 2]
