"""Latest-only slots and the bounded channel: limits, order, counters."""

from twin.base.channel import BoundedChannel
from twin.fabric.bus import Sample
from viewer.live.slots import LatestSlots


def sample(key, payload=b""):
    return Sample(key, payload, b"")


def test_the_latest_of_each_key_in_order_of_arrival():
    slots = LatestSlots()
    slots.put(sample("a", b"1"))
    slots.put(sample("b", b"1"))
    slots.put(sample("a", b"2"))
    assert [(s.key, s.payload) for s in slots.take()] == [("b", b"1"), ("a", b"2")]
    assert slots.take() == []
    assert (slots.counters.received, slots.counters.overwritten) == (3, 1)


def test_no_more_keys_than_allowed():
    slots = LatestSlots(keys_max=2)
    for key in "abc":
        slots.put(sample(key))
    slots.put(sample("a", b"new"))
    assert {s.key for s in slots.take()} == {"a", "b"}
    assert slots.counters.refused == 1
    slots.put(sample("c"))
    assert [s.key for s in slots.take()] == ["c"]


def test_the_channel_refuses_beyond_its_size_and_never_waits():
    channel = BoundedChannel(10)
    assert channel.offer("a", 6)
    assert channel.offer("b", 4)
    assert not channel.offer("c", 1)
    assert channel.offer("end", 0), "size 0 always fits"
    assert channel.refused == 1
    assert [channel.take(0) for _ in range(4)] == ["a", "b", "end", None]
    assert channel.offer("large", 99), "an empty channel takes anything"
    assert not channel.offer("d", 1)
    assert len(channel) == 1
