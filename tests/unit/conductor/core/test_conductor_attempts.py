"""Cases that are leased again and again: what is kept has a limit, what is said has none."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, S, ended, hello, result, started

from conductor.core import fold as folding
from conductor.core.facts import CaseEnded, Committed, LateAttempt
from conductor.core.fold import fold
from conductor.core.snapshot import take
from conductor.core.state import CaseState
from conductor.records.outcomes import outcomes_of
from schemas.wire.control import Lease

LIMIT = 4


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ISSUED_MAX", "LATE_MAX", "LOST_WORKERS_MAX"):
        monkeypatch.setattr(folding, name, LIMIT)


def _case(bench: Bench) -> CaseState:
    return bench.state.campaigns["alpha"].cases["repeat_0"]


def _expired(bench: Bench, count: int) -> list[Lease]:
    """Attempts whose time was over before a word of them came."""
    found = []
    for _ in range(count):
        bench.ask(hello("w1"))
        found += bench.lease("w1")
        bench.now_ns += 60 * S
        bench.tick()
    assert len(found) == count
    return found


def _late(bench: Bench, lease: Lease, kpi: str = "") -> None:
    """Every late result is answered alike, whether it is evidence or not."""
    for _ in range(2):
        reply = bench.next("w1", k=0, results=[result(lease, kpi=kpi)])
        assert (reply.acks, reply.fenced) == ([lease.token], [lease.token])


def test_attempts_without_end_leave_a_bounded_case() -> None:
    bench = started(cases=1, workers=2)
    for number in range(1, 10 * LIMIT):
        (lease,) = bench.lease()
        assert lease.attempt == number
        bench.next(k=0, ended=[ended(lease, "released", "no rig")])
        assert len(_case(bench).issued) <= LIMIT
    assert f"{10 * LIMIT - 1} attempts so far" in bench.explain("repeat_0")
    (last,) = bench.lease()
    bench.journal = [take(bench.state)]
    bench.restart()
    bench.next(k=0, results=[result(last)])
    assert [fact.attempt for fact in bench.facts(Committed)] == [10 * LIMIT]
    campaign = bench.state.campaigns["alpha"]
    assert campaign.attempts == 10 * LIMIT
    assert outcomes_of(campaign).cases["repeat_0"].attempts == 10 * LIMIT


def test_a_live_token_is_never_forgotten() -> None:
    """The first attempt runs on, and a second one is given back again and again."""
    bench = started(cases=2, workers=2, attempts_max=1)
    first, other = bench.lease("w1", k=2)
    bench.next("w1", k=0, results=[result(other, wall_s=0.1)], held=[first.token])
    for _ in range(3 * LIMIT):
        bench.now_ns += bench.config.speculate_min_ns + S
        bench.beat("w1", first.token)
        (again,) = bench.lease("w2")
        assert again.case == first.case
        bench.next("w2", k=0, ended=[ended(again, "released")])
    case = bench.state.campaigns["alpha"].cases[first.case.id]
    assert first.token in [each.token for each in case.issued]
    assert len(case.issued) == LIMIT
    assert bench.next("w1", k=0, results=[result(first)]).fenced == []
    assert len(bench.facts(Committed)) == 2


def test_late_results_are_compared_however_many_there_are() -> None:
    bench = started(cases=1, workers=2, attempts_max=100)
    late = _expired(bench, 3 * LIMIT)
    for lease in late:
        _late(bench, lease)
    (last,) = bench.lease("w2")
    bench.next("w2", k=0, results=[result(last)])
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == 0
    assert len(bench.facts(LateAttempt)) == LIMIT, "older tokens are fenced, and no evidence"
    assert len(_case(bench).late) == LIMIT
    # Every further attempt that is still known counts once, though none is kept.
    bench = started(cases=1, workers=2, attempts_max=100)
    for lease in _expired(bench, LIMIT):
        _late(bench, lease)
    more = _expired(bench, LIMIT - 1)
    (last,) = bench.lease("w2")
    bench.next("w2", k=0, results=[result(last)])
    for lease in more:
        _late(bench, lease, kpi="other")
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == LIMIT - 1
    assert len(_case(bench).late) == LIMIT
    row = outcomes_of(bench.state.campaigns["alpha"]).cases["repeat_0"]
    assert [each.agrees for each in row.late] == [True] * (LIMIT - 1) + [False]


def test_a_late_result_that_says_something_new_is_never_left_out() -> None:
    bench = started(cases=1, workers=2, attempts_max=100)
    for lease in _expired(bench, LIMIT):
        _late(bench, lease)
    (odd,) = _expired(bench, 1)
    _late(bench, odd, kpi="other")
    assert len(bench.facts(LateAttempt)) == LIMIT + 1
    assert len(_case(bench).late) == LIMIT
    (last,) = bench.lease("w2")
    bench.next("w2", k=0, results=[result(last)])
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == 1


def test_losses_are_counted_and_the_latest_workers_named() -> None:
    bench = started(cases=1, workers=1, attempts_max=1)
    for number in range(2, 3 * LIMIT):
        assert len(_case(bench).lost) == min(number - 2, LIMIT)
        worker = f"w{number}"
        bench.ask(hello(worker))
        bench.ask(hello("w1"))
        assert bench.lease(worker)
        bench.now_ns += 20 * S
        bench.tick()  # with w1: a storm, which proves nothing against the case
    assert _case(bench).lost_times == 3 * LIMIT - 2
    assert _case(bench).lost == tuple(f"w{3 * LIMIT - k}" for k in range(LIMIT, 0, -1))
    images = take(bench.state)
    assert fold([images], bench.config).campaigns == bench.state.campaigns
    bench.ask(hello("w99"))
    assert bench.lease("w99")
    bench.now_ns += 20 * S
    bench.tick()
    bench.ask(hello("w98"))
    assert bench.lease("w98")
    bench.now_ns += 20 * S
    bench.tick()
    (end,) = bench.facts(CaseEnded)
    assert end.reason == f"quarantined: lost with its worker {3 * LIMIT} times"
