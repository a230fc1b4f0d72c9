"""Expiry to the nanosecond."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, S, result, started

from conductor.core.decisions import worker_lost
from conductor.core.facts import AttemptEnded, Committed
from conductor.core.fold import apply
from conductor.core.lease import TOKENS_PER_EPOCH, next_expiry_ns, token_of
from conductor.core.state import FAR_NS


def test_a_lease_that_expires_now_has_expired() -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.now_ns += bench.config.ttl_ns - 1
    assert bench.tick() == []
    bench.now_ns += 1
    (end,) = bench.tick()
    assert isinstance(end, AttemptEnded)
    assert (end.token, end.reason, end.charged) == (lease.token, "lost", False)
    assert bench.tick() == []


@pytest.mark.parametrize(("early_ns", "committed"), [(1, True), (0, False)])
def test_a_result_counts_until_the_last_nanosecond(early_ns: int, committed: bool) -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.now_ns += bench.config.ttl_ns - early_ns
    reply = bench.next(k=0, results=[result(lease)])
    assert reply.fenced == ([] if committed else [lease.token])
    assert bool(bench.facts(Committed)) == committed


def test_a_beat_extends_what_it_names_only() -> None:
    bench = started(cases=2)
    first, second = bench.lease(k=2)
    bench.now_ns += 10 * S
    assert bench.beat("w1", first.token).lost == []
    bench.now_ns += 5 * S
    assert bench.beat("w1", first.token, second.token).lost == [second.token]
    bench.now_ns += bench.config.ttl_ns
    assert bench.beat("w1", first.token).lost == [first.token]


def test_a_beat_about_leases_of_others_does_not_extend_them() -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    bench.now_ns += 10 * S
    assert bench.beat("w2", lease.token).lost == [lease.token]
    bench.now_ns += 5 * S
    assert len(bench.tick()) == 1


def test_next_extends_what_is_held() -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.now_ns += 10 * S
    bench.next(held=[lease.token])
    bench.now_ns += bench.config.ttl_ns - 1
    assert bench.tick() == []
    bench.now_ns += 1
    assert len(bench.tick()) == 1


def test_a_restart_gives_every_lease_a_full_time() -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.now_ns += 10 * bench.config.ttl_ns
    bench.restart()
    bench.now_ns += bench.config.ttl_ns - 1
    assert bench.beat("w1", lease.token).lost == []  # no hello needed
    bench.restart()
    bench.now_ns += bench.config.ttl_ns
    assert len(bench.tick()) == 1


def _vanish(bench: Bench, worker: str) -> None:
    for fact in worker_lost(bench.state, worker, bench.now_ns):
        assert fact not in bench.journal


def test_a_vanished_session_shortens_but_never_lengthens() -> None:
    bench = started(cases=2, workers=2)
    bench.lease("w1")
    bench.now_ns += 1 * S
    bench.lease("w2")
    _vanish(bench, "w1")
    bench.now_ns += bench.config.vanished_ns - 1
    assert bench.tick() == []
    bench.now_ns += 1
    assert [end.case for end in bench.tick()] == ["repeat_0"]
    bench.now_ns += 11 * S  # w2 has one second left
    _vanish(bench, "w2")
    bench.now_ns += 1 * S
    assert [end.case for end in bench.tick()] == ["repeat_1"]
    _vanish(bench, "nobody")


def test_a_worker_that_speaks_again_after_the_hint_keeps_its_leases() -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    _vanish(bench, "w1")
    bench.now_ns += bench.config.vanished_ns - 1
    assert bench.beat("w1", lease.token).lost == []
    bench.now_ns += bench.config.ttl_ns - 1
    assert bench.tick() == []


def test_expiry_and_the_next_grant_meet_in_one_request() -> None:
    bench = started(cases=1, workers=2)
    bench.lease("w1")
    bench.now_ns += bench.config.ttl_ns
    assert len(bench.lease("w2")) == 1


def test_next_expiry() -> None:
    bench = started(cases=1)
    assert next_expiry_ns(bench.state) == FAR_NS
    bench.lease()
    assert next_expiry_ns(bench.state) == bench.now_ns + bench.config.ttl_ns


@pytest.mark.parametrize("count", [0, TOKENS_PER_EPOCH])
def test_tokens_of_an_epoch_are_limited(count: int) -> None:
    with pytest.raises(AssertionError):
        token_of(1, count)
    assert token_of(1, TOKENS_PER_EPOCH - 1) < token_of(2, 1)


def test_a_fact_that_contradicts_the_state_is_refused() -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.next(k=0, results=[result(lease)])
    with pytest.raises(AssertionError, match="contradicts"):
        apply(bench.state, bench.facts(Committed)[0])
