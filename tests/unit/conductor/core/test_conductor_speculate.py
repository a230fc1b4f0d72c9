"""Second leases of cases that take too long, to the nanosecond."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, S, ended, hello, result, started

from conductor.core.facts import CaseEnded, Committed, LateAttempt, Leased
from schemas.wire.control import Lease


def _racing() -> tuple[Bench, Lease, Lease]:
    """w1 and w2 run the same case; who is first commits."""
    bench = started(cases=1, workers=3)
    (first,) = bench.lease("w1")
    bench.now_ns += bench.config.ttl_ns // 2 + 1
    (second,) = bench.lease("w2")
    assert second.case == first.case
    assert (second.attempt, second.alone) == (2, False)
    return bench, first, second


@pytest.mark.parametrize(("silent_ns", "granted"), [(0, False), (1, True)])
def test_the_worker_is_silent_for_half_its_time(silent_ns: int, granted: bool) -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    bench.beat("w1", lease.token)
    bench.now_ns += bench.config.ttl_ns // 2 + silent_ns
    assert bool(bench.lease("w2")) == granted


@pytest.mark.parametrize(("extra_ns", "granted"), [(0, False), (1, True)])
def test_the_case_takes_twice_the_estimate(extra_ns: int, granted: bool) -> None:
    bench = started(cases=2, workers=2)
    done, late = bench.lease("w1", k=2)
    wall_s = 0.001 * 2.0**12
    bench.next("w1", k=0, results=[result(done, wall_s=wall_s)], held=[late.token])
    bench.now_ns += int(2 * wall_s * S) + extra_ns
    bench.beat("w1", late.token)
    assert bool(bench.lease("w2")) == granted


@pytest.mark.parametrize(("extra_ns", "granted"), [(0, False), (1, True)])
def test_short_cases_are_given_some_time(extra_ns: int, granted: bool) -> None:
    bench = started(cases=2, workers=2)
    done, late = bench.lease("w1", k=2)
    bench.next("w1", k=0, results=[result(done)], held=[late.token])
    bench.now_ns += bench.config.speculate_min_ns + extra_ns
    bench.beat("w1", late.token)
    assert bool(bench.lease("w2")) == granted


def test_the_longest_running_case_is_raced() -> None:
    bench = started(cases=2, workers=3)
    bench.lease("w1")
    bench.now_ns += S
    bench.lease("w2")
    bench.now_ns += bench.config.ttl_ns // 2 + 1
    assert bench.lease("w3", k=4)[0].case.id == "repeat_0"


@pytest.mark.parametrize("winner", [0, 1])
def test_a_commit_by_either_closes_both(winner: int) -> None:
    bench, *leases = _racing()
    workers = ["w1", "w2"]
    assert bench.next(workers[winner], k=0, results=[result(leases[winner])]).fenced == []
    loser = 1 - winner
    token = leases[loser].token
    assert bench.beat(workers[loser], token).lost == [token]
    reply = bench.next(workers[loser], k=0, results=[result(leases[loser])])
    assert reply.fenced == [token]
    assert [fact.result.token for fact in bench.facts(Committed)] == [leases[winner].token]
    assert len(bench.facts(LateAttempt)) == 1
    assert bench.status()["campaigns"]["alpha"]["leased"] == 0


@pytest.mark.parametrize("loser", [0, 1])
def test_if_one_ends_without_a_result_the_other_goes_on(loser: int) -> None:
    bench, *leases = _racing()
    bench.next(f"w{loser + 1}", k=0, ended=[ended(leases[loser], "walltime")])
    assert bench.status()["campaigns"]["alpha"]["leased"] == 1
    other = 1 - loser
    assert bench.next(f"w{other + 1}", k=0, results=[result(leases[other])]).fenced == []


def test_at_most_two() -> None:
    bench, first, second = _racing()
    bench.now_ns += bench.config.ttl_ns // 2 - 2
    assert bench.lease("w3") == []
    assert bench.state.case(("alpha", "repeat_0")).live == (first.token, second.token)


def test_both_may_be_charged_and_the_second_charge_ends_the_case() -> None:
    bench, first, second = _racing()
    bench.next("w1", k=0, ended=[ended(first, "crash")])
    bench.next("w2", k=0, ended=[ended(second, "crash")])
    assert not bench.facts(CaseEnded)
    (third,) = bench.lease("w3")
    assert third.alone
    bench.next("w3", k=0, ended=[ended(third, "crash")])
    assert len(bench.facts(CaseEnded)) == 1


def test_the_last_charge_waits_for_the_race_to_end() -> None:
    bench = started(cases=1, workers=2, attempts_max=1)
    (first,) = bench.lease("w1")
    bench.now_ns += bench.config.ttl_ns // 2 + 1
    (second,) = bench.lease("w2")
    bench.next("w1", k=0, ended=[ended(first, "crash")])
    assert not bench.facts(CaseEnded)
    bench.next("w2", k=0, ended=[ended(second, "walltime")])
    assert len(bench.facts(CaseEnded)) == 1


@pytest.mark.parametrize("why", ["waiting", "charged", "paused", "busy", "other software", "k"])
def test_nobody_races(why: str) -> None:
    bench = started(cases=2 if why in ("waiting", "busy") else 1)
    leases = bench.lease("w1", k=2 if why == "busy" else 1)
    if why == "charged":
        bench.next("w1", k=0, ended=[ended(leases[0], "crash")])
        leases = bench.lease("w1")
    if why == "paused":
        bench.control("pause")
    bench.ask(hello("w2", software="beef" if why == "other software" else "f00d"))
    bench.now_ns += bench.config.ttl_ns // 2 + 1
    if why == "waiting":
        assert [x.case.id for x in bench.lease("w2")] == ["repeat_1"]
    held = [99] if why == "busy" else []
    assert not [
        x
        for x in bench.lease("w2", k=0 if why == "k" else 1, held=held)
        if x.case.id == leases[0].case.id and why != "waiting"
    ]
    assert not any(fact.speculative for fact in bench.facts(Leased)) or why == "waiting"


def test_a_race_survives_a_restart_of_the_conductor() -> None:
    bench, first, second = _racing()
    bench.restart()
    assert bench.beat("w1", first.token).lost == []
    assert bench.next("w2", k=0, results=[result(second)]).fenced == []
    assert bench.beat("w1", first.token).lost == [first.token]


def test_a_restart_is_no_reason_to_race_what_has_just_been_leased() -> None:
    """After a restart a case has run since then, as far as the conductor knows."""
    bench = started(cases=2, workers=2)
    done, running = bench.lease("w1", k=2)
    bench.next("w1", k=0, results=[result(done)], held=[running.token])
    bench.restart()
    assert bench.lease("w2") == []
    bench.now_ns += bench.config.speculate_min_ns
    bench.beat("w1", running.token)
    assert bench.lease("w2") == []
    bench.now_ns += 1
    bench.beat("w1", running.token)
    assert [lease.case.id for lease in bench.lease("w2")] == [running.case.id]
