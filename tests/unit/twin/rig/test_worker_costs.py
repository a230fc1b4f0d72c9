"""What perception cost, as the simulator sums it: foreign numbers never end a case."""

import pytest

from conductor.run.source import load
from schemas.messages import PerceptionCost
from schemas.wire.control import Lease
from twin.rig.slot import Slot

LEASE = Lease(1, 1, "", load("chaos-16").cases[0])


def summed(total, cost):
    slot = Slot(0, LEASE, 0.0, perception=total)
    slot.perceived(cost)
    return slot.perception


COST = PerceptionCost("opencv cpu", 2, 0.5)


def test_costs_are_added():
    assert summed(None, None) is None
    assert summed(None, COST) == COST
    assert summed(COST, None) == COST
    assert summed(COST, COST) == PerceptionCost("opencv cpu", 4, 1.0)


@pytest.mark.parametrize(
    ("frames", "wall_s"),
    [(-1, 0.1), (1, -0.1), (1, float("nan")), (1, float("inf")), (10**9, 0.1)],
)
def test_what_can_be_no_cost_is_left_out(frames, wall_s):
    wrong = PerceptionCost("x", frames, wall_s)
    assert summed(None, wrong) is None
    assert summed(COST, wrong) == COST


def test_times_by_name_are_added_and_what_can_be_none_is_left_out():
    one = PerceptionCost("x", 1, 0.1, {"tracks": 0.5, "bad": float("nan")}, {"lidar blocked": 2.0})
    two = PerceptionCost("x", 1, 0.1, {"tracks": 0.25, "less": -1.0}, {"a" * 81: 1.0})
    total = summed(summed(None, one), two)
    assert (total.stages, total.limited) == ({"tracks": 0.75}, {"lidar blocked": 2.0})
    many = PerceptionCost("x", 1, 0.1, {f"stage {n}": 1.0 for n in range(40)})
    assert list(summed(None, many).stages) == [f"stage {n}" for n in range(16)]
