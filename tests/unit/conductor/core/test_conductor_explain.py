"""Why a case waits, runs or has ended."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, S, ended, hello, result, started

from conductor.core import status as told
from conductor.core.decisions import worker_lost
from schemas import SCHEMA_VERSION
from schemas.wire.control import StatusRequest
from schemas.wire.status import CasePage


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


def page_of(bench: Bench, first: int) -> CasePage:
    request = StatusRequest(v=SCHEMA_VERSION, cases="alpha", first=first)
    return bench.ask(request).status["page"]


def test_cases_as_they_stand_come_in_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = started(cases=5, attempts_max=2)
    leases = bench.lease(k=3)
    kept = result(leases[0], passed=False, scalars={"dtc_min_m": 0.5}, reasons=["hit"], wall_s=2.0)
    bench.next(k=0, results=[kept], ended=[ended(leases[1], "crash", "signal 11")])
    bench.control("cancel", case="repeat_4")
    monkeypatch.setattr(told, "PAGE_CASES_MAX", 3)
    page = page_of(bench, 0)
    assert (page["campaign"], page["next"]) == ("alpha", 3)
    assert page["cases"] == [
        {
            "case": "repeat_0",
            "attempts": 1,
            "charges": [],
            "outcome": "verdict",
            "verdict": "collision",
            "reasons": ["hit"],
            "scalars": {"dtc_min_m": 0.5},
            "names": {},
            "attempt_dir": "cases/repeat_0/attempt-1",
            "attempt": 1,
            "worker": "w1",
            "wall_s": 2.0,
            "rig_wall_s": 0.0,
        },
        {
            "case": "repeat_1",
            "attempts": 1,
            "outcome": "",
            "charges": ["crash: signal 11 (worker w1)"],
        },
        {"case": "repeat_2", "attempts": 1, "charges": [], "outcome": ""},
    ]
    page = page_of(bench, 3)
    assert page["next"] is None
    assert [row["case"] for row in page["cases"]] == ["repeat_3", "repeat_4"]
    assert page["cases"][1]["outcome"] == "cancelled"
    assert page["cases"][1]["reasons"] == ["cancelled on request"]
    assert page_of(bench, 5) == page_of(bench, 2**31 - 1) == page | {"cases": []}


def test_a_page_ends_before_it_grows_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = started(cases=4)
    bench.next(k=0, results=[result(lease) for lease in bench.lease(k=3)])
    size = len(bench.state.campaigns["alpha"].cases["repeat_0"].sealed)
    monkeypatch.setattr(told, "PAGE_BYTES_MAX", 2 * size)
    assert page_of(bench, 0)["next"] == 2
    assert page_of(bench, 2)["next"] is None


def test_long_charges_fill_a_page_too(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = started(cases=3, attempts_max=9)
    (lease,) = bench.lease(k=1)
    bench.next(k=0, ended=[ended(lease, "crash", "x" * 500)])
    monkeypatch.setattr(told, "PAGE_BYTES_MAX", 400)
    assert page_of(bench, 0)["next"] == 1
    assert page_of(bench, 1)["next"] is None


def test_cases_of_a_campaign_that_is_not_here() -> None:
    bench = started(cases=1)
    reply = bench.ask(StatusRequest(v=SCHEMA_VERSION, cases="x" * 90))
    assert reply.error == f"no campaign '{'x' * 80}' here"
