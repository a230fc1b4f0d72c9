"""Slots of a rig, and the order in which listeners hear of them."""

import pytest

from conductor.run.source import load
from schemas.wire.control import Lease
from twin.rig.slot import RigTick, Slot, SlotEnd, Slots
from twin.rig.slot_listener import SlotListener, SlotListeners

CASES = load("chaos-16").cases


def slot_of(index, token):
    return Slot(index, Lease(token, 1, "", CASES[token]), 0.0)


def test_a_slot_that_stands_still_is_taken_and_not_in_the_tick():
    slots, one, two = Slots(3), slot_of(0, 1), slot_of(2, 2)
    slots.take(two)
    slots.take(one)
    two.held = True
    assert (list(slots), slots.running, slots.held) == ([one, two], [one], [two])
    assert (slots.by_index, slots.free) == ([one, None, None], [1])
    assert (slots.of_token(2), slots.of_token(3), slots[2]) == (two, None, two)
    slots.leave(two)
    assert (slots.held, slots.free, len(slots)) == ([], [1, 2], 3)
    with pytest.raises(AssertionError, match="slot 0 is taken"):
        slots.take(slot_of(0, 3))


def test_listeners_hear_of_everything_in_their_order():
    heard = []

    class Listener(SlotListener):
        def __init__(self, name):
            self.name = name

        def __getattribute__(self, event):
            name = object.__getattribute__(self, "name") if event != "name" else ""
            known = event in ("built", "started", "sensed", "commanded", "ended", "withdrawn")
            if not known:
                return object.__getattribute__(self, event)
            return lambda *_: heard.append(event + name)

    both, slot = SlotListeners([Listener("1"), Listener("2")]), slot_of(0, 1)
    tick, end = RigTick(None, {}, {}, []), SlotEnd(None, 1.0)
    both.built(None)
    both.started(slot)
    both.sensed(tick)
    both.commanded(tick)
    both.ended(slot, end)
    both.withdrawn(slot)
    events = ("built", "started", "sensed", "commanded", "ended", "withdrawn")
    assert heard == [event + name for event in events for name in "12"]


def test_who_listens_to_nothing_changes_nothing():
    listener, slot = SlotListener(), slot_of(0, 1)
    end = SlotEnd(None, 1.0)
    listener.started(slot)
    listener.ended(slot, end)
    assert end == SlotEnd(None, 1.0)
    assert slot.fresh
    assert not slot.held
