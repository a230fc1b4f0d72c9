"""What is held against a case, to the boundary and to the word."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, ended, hello, result, started, submit

from conductor.core.decisions import worker_lost
from conductor.core.facts import (
    AttemptEnded,
    CaseEnded,
    EpochRaised,
    Fact,
    Intervention,
    Leased,
    Paused,
    Submitted,
)
from conductor.core.fold import apply
from conductor.core.settle import LOSSES_ANYWAY
from conductor.core.state import Config


@pytest.mark.parametrize(("silent_ns", "storm"), [(0, False), (1, True)])
def test_another_worker_that_is_silent_for_half_its_time_makes_a_storm(
    silent_ns: int, storm: bool
) -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    half_ns = bench.config.ttl_ns // 2
    bench.now_ns += bench.config.ttl_ns - half_ns - silent_ns
    bench.beat("w2")
    bench.now_ns += half_ns + silent_ns
    bench.tick()
    (end,) = bench.facts(AttemptEnded)
    assert (end.token, end.evidence) == (lease.token, not storm)


@pytest.mark.parametrize(
    ("vanishes", "said"),
    [(True, "its session vanished"), (False, "no sign of life from the worker")],
)
def test_how_a_worker_was_lost_is_told(vanishes: bool, said: str) -> None:
    bench = started(cases=1)
    bench.lease("w1")
    if vanishes:
        worker_lost(bench.state, "w1", bench.now_ns)
    bench.now_ns += bench.config.ttl_ns
    bench.tick()
    assert [end.detail for end in bench.facts(AttemptEnded)] == [said]


def test_a_worker_that_drops_one_case_of_two_is_no_lost_worker() -> None:
    """However often: only who falls silent altogether speaks against a case."""
    bench = started(cases=2)
    kept, dropped = bench.lease("w1", k=2)
    for _ in range(3 * LOSSES_ANYWAY + 1):
        for _ in range(3):
            bench.now_ns += bench.config.ttl_ns // 3
            bench.beat("w1", kept.token)
        bench.tick()
        (dropped,) = bench.lease("w1", held=[kept.token])
        assert dropped.case.id == "repeat_1"
    assert not bench.facts(CaseEnded)


def test_one_loss_and_one_charge_are_told_in_the_singular() -> None:
    bench = Bench(Config(folder="/state", losses_min=1))
    bench.ask(submit(cases=2, attempts_max=1))
    bench.ask(hello("w1"))
    first, second = bench.lease("w1", k=2)
    bench.next("w1", k=0, ended=[ended(first, "crash", "signal 9")], held=[second.token])
    bench.now_ns += bench.config.ttl_ns
    bench.tick()
    assert [end.reason for end in bench.facts(CaseEnded)] == [
        "quarantined: 1 charged attempt on 1 worker, the last one: crash: signal 9 (worker w1)",
        "quarantined: 1 loss on 1 worker, the last one: "
        "lost: no sign of life from the worker (worker w1)",
    ]


@pytest.mark.parametrize(("remaining_s", "waited_for"), [(1000.0, True), (5.0, False)])
def test_a_second_worker_is_waited_for_if_its_walltime_allows_the_case(
    remaining_s: float, waited_for: bool
) -> None:
    bench = started(cases=2, workers=2, attempts_max=2)
    (other,) = bench.lease("w2", remaining_s=remaining_s) or [None]
    (lease,) = bench.lease("w1")
    bench.next("w1", k=0, ended=[ended(lease, "crash")])
    if other is not None:
        bench.next("w2", k=0, results=[result(other)], remaining_s=remaining_s)
    granted = [lease.case.id for lease in bench.lease("w1")]
    assert (lease.case.id in granted) is not waited_for


def test_a_repeated_request_gets_the_same_lone_lease() -> None:
    bench = started(cases=1)
    bench.next("w1", k=0, ended=[ended(bench.lease("w1")[0], "crash")])
    reply = bench.next("w1")
    assert [lease.alone for lease in reply.leases] == [True]
    bench.seqs["w1"] -= 1
    assert bench.next("w1") == reply


@pytest.mark.parametrize(
    "fact",
    [
        EpochRaised(epoch=1),
        Intervention(campaign="alpha", case="repeat_0", token=7, tick=1, what="x", changes=0),
        Paused(campaign="alpha", case="repeat_0", paused=False),
        Paused(campaign="alpha", case="repeat_1", paused=True),
        Leased("alpha", "repeat_0", token=2**32 + 1, attempt=2, worker="w1", alone=False),
        Leased("alpha", "repeat_0", token=2**32 + 1, attempt=1, worker="w1", alone=True),
        Leased("alpha", "repeat_0", token=2**32 + 2, attempt=1, worker="w1", alone=False),
    ],
)
def test_a_fact_that_contradicts_the_state_is_our_own_mistake(fact: Fact) -> None:
    bench = started(cases=2)
    bench.control("cancel", case="repeat_1")
    assert bench.state.epoch == 1
    with pytest.raises(AssertionError, match=r"contradicts the state: \w+\("):
        apply(bench.state, fact)


def test_a_campaign_is_submitted_once_and_says_where_it_lies() -> None:
    bench = started(cases=2)
    assert bench.ask(submit(cases=2)).status["out"] == "/state/alpha"
    (fact,) = bench.facts(Submitted)
    with pytest.raises(AssertionError, match=r"contradicts the state: Submitted\("):
        apply(bench.state, fact)


def _die(bench: Bench, times: int = 1) -> None:
    for _ in range(times):
        (lease,) = bench.lease("w1")
        bench.next("w1", k=0, ended=[ended(lease, "crash")])


def test_a_case_that_dies_often_is_one_death_of_its_host() -> None:
    bench = started(cases=1, attempts_max=4)
    _die(bench, 3)
    assert bench.state.deaths == {"node": (("alpha", "repeat_0"),)}


def test_a_quarantined_case_is_no_death_of_a_host_any_more() -> None:
    """It was the case that was bad; what others died of is not known yet."""
    bench = started(cases=3, attempts_max=2)
    first, second = bench.lease("w1", k=2)
    bench.next("w1", k=0, ended=[ended(first, "crash"), ended(second, "crash")])
    assert len(bench.state.deaths["node"]) == 2
    _die(bench)
    assert [end.case for end in bench.facts(CaseEnded)] == ["repeat_0"]
    assert bench.state.deaths == {"node": (("alpha", "repeat_1"),)}


def test_disagreements_add_up() -> None:
    bench = started(cases=3)
    leases = bench.lease("w1", k=3)
    bench.now_ns += bench.config.ttl_ns
    bench.tick()
    late = [result(lease, kpi="late") for lease in leases]
    assert bench.next("w1", k=0, results=late).fenced == [lease.token for lease in leases]
    while again := bench.lease("w1", k=3):
        bench.next("w1", k=0, results=[result(lease) for lease in again])
    assert bench.state.campaigns["alpha"].disagreements == 3
