"""Why a case waits, runs or has ended."""

from __future__ import annotations

from conductor_bench import S, ended, hello, result, started

from conductor.core.decisions import worker_lost
from schemas import SCHEMA_VERSION
from schemas.wire.control import StatusRequest


def test_the_life_of_a_case_in_sentences() -> None:
    bench = started(cases=2, attempts_max=2)
    assert bench.explain("repeat_1") == [
        "waits: 1 case of its kind before it, priority 0; 1 worker may run it, holding 0 cases"
    ]
    (lease,) = bench.lease()
    bench.now_ns += 2 * S
    assert bench.explain("repeat_0") == [
        "leased to w1 since 2 s, attempt 1, at tick 0; the worker was heard 2 s ago and has until "
        "13 s from now"
    ]
    bench.next(k=0, ended=[ended(lease, "crash", "signal 11")])
    assert bench.explain("repeat_0") == [
        "waits for a worker whose rig is empty: it runs alone, because a rig died with it",
        "waits: 0 cases of its kind before it, priority 0; 1 worker may run it, holding 0 cases",
        "1 attempt so far",
        "charge 1: crash: signal 11 (worker w1)",
    ]
    (lease,) = bench.lease()
    bench.next(k=0, results=[result(lease)])
    assert bench.explain("repeat_0")[0] == "ended: verdict 'pass' (passed), attempt 2 on worker w1"


def test_suspects_and_losses() -> None:
    bench = started(cases=4)
    leases = bench.lease(k=4)
    bench.next(k=0, ended=[ended(lease, "suspect") for lease in leases])
    assert bench.explain("repeat_0")[0] == (
        "waits for a worker whose rig is empty: it shares its rig only with 1 other suspect of a "
        "rig that died"
    )
    bench.ask(hello("w2"))
    bench.lease("w2", k=1)
    worker_lost(bench.state, "w2", bench.now_ns)
    bench.now_ns += bench.config.vanished_ns
    bench.beat("w1")
    assert "worker w2 died with it while all others lived: its session vanished" in bench.explain(
        "repeat_0"
    )


def test_nobody_may() -> None:
    bench = started(cases=1)
    bench.control("drain", worker="w1")
    assert bench.explain("repeat_0") == ["waits: all of 1 worker that may run it are draining"]
    bench = started(cases=2)
    bench.lease()
    bench.bye()
    assert bench.explain("repeat_1")[0] == "waits: no worker is here"
    bench.ask(hello("w2", software="beef"))
    lines = bench.explain("repeat_1")
    assert lines[0] == "waits: none of 1 worker may run it"
    assert "software beef is not the f00d" in lines[1]
    bench.stop()
    assert bench.explain("repeat_1")[0] == "waits: the conductor is draining and grants nothing"
    bench.control("cancel", case="repeat_1")
    assert bench.explain("repeat_1")[0] == "ended: cancelled: cancelled on request"


def test_the_cases_that_run_are_listed_with_where_they_are() -> None:
    bench = started(cases=3)
    first, second = bench.lease(k=2)
    bench.now_ns += 3 * S
    plain = bench.ask(StatusRequest(v=SCHEMA_VERSION)).status
    assert "running" not in plain
    rows = bench.ask(StatusRequest(v=SCHEMA_VERSION, running=True)).status["running"]
    assert [(row["campaign"], row["case"]) for row in rows] == [
        (lease.case.variation.campaign, lease.case.id) for lease in (first, second)
    ]
    assert rows[0] | {"campaign": "", "case": ""} == {
        "campaign": "",
        "case": "",
        "worker": "w1",
        "host": "node",
        "attempt": 1,
        "tick": 0,
        "for_s": 3.0,
        "by_hand": "",
    }
    bench.bye()
    assert bench.ask(StatusRequest(v=SCHEMA_VERSION, running=True)).status["running"] == []
