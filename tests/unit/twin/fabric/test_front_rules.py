"""What a front lets through: exact limits, without sockets and without a clock."""

from __future__ import annotations

import pytest

from twin.fabric.front.rules import (
    BURST_S,
    OTHERS,
    QUOTAS,
    SHAKING_MAX,
    SHAKING_PER_ADDRESS_MAX,
    Account,
    Batches,
    Bucket,
    HandshakeSlots,
    Quota,
    quota_of,
)
from twin.fabric.keys.roles import Role


def test_a_bucket_gives_its_burst_and_then_its_rate() -> None:
    bucket = Bucket(10.0)
    assert bucket.take(10.0 * BURST_S, 5.0) == 0.0
    assert bucket.take(1.0, 5.0) == pytest.approx(0.1)
    assert bucket.take(0.0, 5.1) == pytest.approx(0.0)
    assert bucket.take(5.0, 5.6) == pytest.approx(0.0)
    assert bucket.take(0.0, 1e9) == 0.0
    assert bucket.level == 10.0 * BURST_S, "no more than a burst is saved"


def test_what_is_not_there_is_not_taken() -> None:
    bucket = Bucket(1.0, burst_s=3.0)
    assert [bucket.has(1.0, 10.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.has(1.0, now_s) for now_s in (10.9, 11.0, 11.0)] == [False, True, False]


def test_time_that_runs_backwards_gives_nothing() -> None:
    bucket = Bucket(1.0)
    bucket.take(BURST_S, 100.0)
    assert bucket.take(1.0, 50.0) == pytest.approx(1.0)
    assert bucket.take(0.0, 100.0) == pytest.approx(1.0)


def test_an_account_waits_for_whichever_is_over() -> None:
    account = Account(Quota(1, messages_per_s=10.0, bytes_per_s=1000.0))
    assert account.take(1, 100, 0.0) == 0.0
    assert account.take(0, int(1000 * BURST_S), 0.0) == pytest.approx(0.1)
    assert account.take(int(10 * BURST_S), 0, 0.0) == pytest.approx(0.1)


def test_every_role_has_a_quota_and_viewers_have_the_least_bytes() -> None:
    assert quota_of(Role.admin) is OTHERS
    assert min(Role, key=lambda role: quota_of(role).bytes_per_s) is Role.viewer
    assert all(quota.connections > 0 for quota in [*QUOTAS.values(), OTHERS])


def stream(*sizes: int) -> bytes:
    return b"".join(size.to_bytes(2, "little") + bytes(size) for size in sizes)


@pytest.mark.parametrize("piece", [1, 2, 3, 7, 1000])
def test_batches_are_counted_however_the_stream_is_cut(piece: int) -> None:
    data = stream(1, 0, 5, 65535, 2, 300)
    batches = Batches()
    pieces = [data[at : at + piece] for at in range(0, len(data), piece)]
    assert sum(batches.count(each) for each in pieces) == 6
    assert batches.count(stream(4, 4)) == 2, "and it stands at the beginning of one"


def test_the_oldest_of_an_address_makes_room() -> None:
    slots = HandshakeSlots()
    for number in range(SHAKING_PER_ADDRESS_MAX):
        assert slots.take(number, "10.0.0.1") is None
    assert slots.take("other", "10.0.0.2") is None
    assert slots.take("one more", "10.0.0.1") == 0
    assert slots.take("and more", "10.0.0.1") == 1
    assert len(slots) == SHAKING_PER_ADDRESS_MAX + 1


def test_the_oldest_of_all_makes_room() -> None:
    slots = HandshakeSlots()
    for number in range(SHAKING_MAX):
        assert slots.take(number, f"10.0.0.{number}") is None
    assert slots.take("one more", "10.1.0.0") == 0
    assert len(slots) == SHAKING_MAX


def test_whoever_is_through_leaves_room() -> None:
    slots = HandshakeSlots()
    for number in range(3 * SHAKING_MAX):
        assert slots.take(number, "10.0.0.1") is None
        slots.free(number)
        slots.free(number)
    assert len(slots) == 0
