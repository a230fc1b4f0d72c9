"""Which workers are fit for a campaign: what it requires, hosts that break cases, the forgotten."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from conductor_bench import Bench, S, ended, hello, result, started, submit

from conductor.core.facts import CaseEnded, WorkerLeft
from conductor.core.snapshot import take
from conductor.serve.folders import Folders


@pytest.mark.parametrize(
    ("requires", "offers", "missing"),
    [
        ({}, {}, ""),
        ({"device": "cpu"}, {}, ""),
        ({"device": "cuda"}, {"device_class": "cuda:H200"}, ""),
        ({"device": "cuda"}, {}, "simulates on cpu, required is cuda"),
        ({"memory_gb": 4.0}, {}, ""),
        ({"memory_gb": 4.0}, {"memory_bytes": 4_000_000_000}, ""),
        (
            {"memory_gb": 4.0},
            {"memory_bytes": 3_999_999_999},
            "allows a rig 4 GB of memory, required are 4 GB",
        ),
        ({"tags": ["a100", "ib"]}, {"tags": ["ib", "a100", "x"]}, ""),
        ({"tags": ["a100", "ib"]}, {"tags": ["a100"]}, "has not the tag ib"),
    ],
)
def test_a_worker_offers_what_is_required(
    requires: dict[str, Any], offers: dict[str, Any], missing: str
) -> None:
    bench = Bench()
    bench.ask(submit(cases=1, requires=requires))
    reply = bench.ask(hello(**offers))
    expected = [f"w1: {missing}; it gets no case of campaign 'alpha'"] if missing else []
    assert reply.status.get("notes", []) == expected
    assert bool(bench.lease()) == (not missing)
    if missing:
        assert expected[0] in bench.explain("repeat_0")


@pytest.mark.parametrize(
    ("bridge", "placement", "runs"),
    [("none", "worker", True), ("autodrive", "node", True), ("autodrive", "worker", False)],
)
def test_a_worker_without_the_package_of_a_bridge_gets_no_case_of_it(
    bridge: str, placement: str, runs: bool
) -> None:
    """Said once, before anything is leased; nobody is charged."""
    bench = Bench()
    front_left = {"name": "front_left", "width": 64, "height": 36, "hz": 10}
    bench.ask(
        submit(
            cases=1,
            autonomy={"bridge": bridge, "command": ["./script.py"], "placement": placement},
            camera={**front_left, "name": "front_right"},
            cameras=[front_left],
            sensors={"encoders": {}, "imu": {}, "pose": {}},
        )
    )
    reply = bench.ask(hello(lacks={"autodrive": "no package websockets: pip install it"}))
    line = "w1: cannot run the bridge 'autodrive', no package websockets: pip install it; it gets "
    notes = [] if runs else [f"{line}no case of campaign 'alpha'"]
    assert reply.status.get("notes", []) == notes
    assert bool(bench.lease()) is runs
    assert bench.ask(hello("w2")).error == ""
    assert bool(bench.lease("w2")) is not runs


@pytest.mark.parametrize(
    ("view", "keep", "records"),
    [
        ("none", "all", False),
        ("live", "all", False),
        ("record", "none", False),
        ("record", "failed", True),
        ("record+live", "all", True),
    ],
)
def test_a_worker_without_a_recorder_gets_no_case_of_which_a_recording_is_asked(
    view: str, keep: str, records: bool
) -> None:
    bench = Bench()
    bench.ask(submit(cases=1, view=view, recording={"keep": keep}))
    reply = bench.ask(hello(lacks={"recorder": "no package viewer: install it"}))
    line = (
        f"w1: writes no recordings (view: {view}), no package viewer: install it; it gets no case "
        "of campaign 'alpha'"
    )
    assert reply.status.get("notes", []) == ([line] if records else [])
    assert bool(bench.lease()) is not records
    if records:
        assert line in bench.explain("repeat_0")
        bench.ask(hello("w2"))
        assert bench.lease("w2")


TRUTH, NETWORK = {"type": "ground_truth"}, {"type": "network", "model": "yolov3-w25"}


@pytest.mark.parametrize(
    ("perception", "placement", "runs"),
    [
        ({"truth": TRUTH}, "worker", True),
        ({"net": NETWORK}, "worker", False),
        ({"truth": TRUTH, "net": NETWORK}, "worker", False),
        ({"net": NETWORK}, "inline", False),
        ({"net": NETWORK}, "node", True),
    ],
)
def test_a_worker_that_runs_no_network_gets_no_case_of_one(
    perception: dict[str, Any], placement: str, runs: bool
) -> None:
    bench = Bench()
    autonomy = {"perception": perception, "placement": placement}
    bench.ask(submit(autonomy=autonomy, matrix={"model": list(perception)}))
    reply = bench.ask(hello(lacks={"perception network": "no package cv2: install it"}))
    line = (
        "w1: cannot run the perception 'net', no package cv2: install it; it gets no case of "
        "campaign 'alpha'"
    )
    assert reply.status.get("notes", []) == ([] if runs else [line])
    assert bool(bench.lease()) is runs
    if not runs:
        bench.ask(hello("w2"))
        assert bench.lease("w2")


def test_a_requirement_that_nobody_knows_is_refused() -> None:
    reply = Bench().ask(submit(requires={"device": "tpu"}))
    assert "requires.device" in reply.error
    assert "cuda" in reply.error


def _two_hosts(cases: int = 8) -> Bench:
    bench = Bench()
    bench.ask(submit(cases=cases))
    bench.ask(hello("bad", host="n1"))
    bench.ask(hello("good", host="n2"))
    return bench


def _die(bench: Bench, count: int) -> None:
    """So many different cases die on n1, one at a time."""
    for _ in range(count):
        (lease,) = bench.lease("bad")
        bench.next("bad", k=0, ended=[ended(lease, "crash")])
        # The next one is another: this one waits for its second try somewhere else.
        bench.control("pause", case=lease.case.id)
        bench.beat("good")


@pytest.mark.parametrize(("deaths", "avoided"), [(2, False), (3, True)])
def test_a_host_on_which_different_cases_die_is_avoided(deaths: int, avoided: bool) -> None:
    bench = _two_hosts()
    _die(bench, deaths)
    bench.restart()
    assert (bench.lease("bad") == []) == avoided
    assert bool(bench.status()["broken_hosts"]) == avoided
    if avoided:
        assert bench.status()["broken_hosts"] == [
            "host n1: 3 different cases died on it and none was committed in between, the last one "
            "alpha/repeat_2; workers of other hosts are preferred"
        ]
        assert "not on bad: too many different cases died on its host" in bench.explain("repeat_7")
        assert len(bench.lease("good")) == 1


def test_one_case_that_dies_three_times_says_nothing_of_its_host() -> None:
    bench = _two_hosts()
    for _ in range(2):
        (lease,) = bench.lease("bad")
        bench.next("bad", k=0, ended=[ended(lease, "crash")])
    assert len(bench.lease("bad")) == 1


def test_a_commit_clears_a_host() -> None:
    bench = _two_hosts()
    _die(bench, 2)
    (lease,) = bench.lease("bad")
    bench.next("bad", k=0, results=[result(lease)])
    _die(bench, 2)
    assert len(bench.lease("bad")) == 1


def test_a_broken_host_works_on_while_there_is_no_other() -> None:
    bench = _two_hosts()
    _die(bench, 3)
    bench.bye("good")
    assert len(bench.lease("bad")) == 1


def test_two_broken_hosts_work_on() -> None:
    bench = _two_hosts(cases=12)
    _die(bench, 3)
    for _ in range(3):
        (lease,) = bench.lease("good")
        bench.next("good", k=0, ended=[ended(lease, "deadline")])
        bench.control("pause", case=lease.case.id)
        bench.beat("bad")
    assert len(bench.lease("bad")) == 1


def test_a_case_that_is_bad_everywhere_is_held_against_no_host() -> None:
    bench = Bench()
    bench.ask(submit(cases=3, attempts_max=1))
    bench.ask(hello("bad", host="n1"))
    bench.ask(hello("good", host="n2"))
    for _ in range(3):
        (lease,) = bench.lease("bad")
        bench.next("bad", k=0, ended=[ended(lease, "crash")])
    assert len(bench.facts(CaseEnded)) == 3
    assert bench.status()["broken_hosts"] == []


def test_the_last_charge_need_not_come_from_a_host_that_is_avoided() -> None:
    bench = _two_hosts()
    _die(bench, 3)
    (lease,) = bench.lease("good")
    for _ in range(2):
        bench.next("good", k=0, ended=[ended(lease, "crash")])
        bench.beat("bad")
        (lease,) = bench.lease("good")
    assert lease.attempt == 3


def test_released_and_lost_leases_say_nothing_of_a_host() -> None:
    bench = _two_hosts()
    for reason in ("released", "walltime", "lost"):
        (lease,) = bench.lease("bad")
        bench.next("bad", k=0, ended=[ended(lease, reason)])
    assert bench.state.deaths == {}


def test_deaths_are_in_the_snapshot() -> None:
    bench = _two_hosts()
    _die(bench, 3)
    bench.journal = [take(bench.state)]
    bench.restart()
    assert len(bench.status()["broken_hosts"]) == 1


@pytest.mark.parametrize(("early_ns", "forgotten"), [(1, False), (0, True)])
def test_a_worker_that_was_silent_for_an_hour_is_forgotten(early_ns: int, forgotten: bool) -> None:
    bench = started(workers=1)
    bench.now_ns += bench.config.forget_ns - early_ns
    bench.tick()
    assert (bench.facts(WorkerLeft) != []) == forgotten
    assert ("w1" in bench.state.workers) != forgotten
    if forgotten:  # the link was down, and is back
        assert not bench.ask(hello("w1")).error
        assert len(bench.lease()) == 1


def test_a_worker_with_a_lease_is_not_forgotten_before_the_lease() -> None:
    bench = started(workers=1)
    bench.lease()
    bench.now_ns += 2 * bench.config.forget_ns
    bench.tick()
    assert bench.state.workers == {}
    assert bench.state.leases == {}


def test_folders_of_attempts_that_no_fact_names_are_removed(tmp_path: Path) -> None:
    bench = started(cases=2, out=str(tmp_path), attempts_max=1)
    (failed,) = bench.lease()
    bench.next(k=0, ended=[ended(failed, "crash")])
    assert len(bench.facts(CaseEnded)) == 1
    (lease,) = bench.lease()
    bench.now_ns += 60 * S
    bench.tick()  # expired: the case is leased again, and its first result comes too late
    bench.next(k=0, results=[result(lease, kpi="other")])
    (second,) = bench.lease()
    bench.now_ns += 60 * S
    bench.tick()
    (third,) = bench.lease()
    bench.next(k=0, results=[result(third)])
    for case, attempts in (("repeat_0", 1), ("repeat_1", 3)):
        for attempt in range(1, attempts + 1):
            (tmp_path / f"cases/{case}/attempt-{attempt}").mkdir(parents=True)
            (tmp_path / f"cases/{case}/attempt-{attempt}/recording.rrd").write_bytes(b"x")
    Folders(tmp_path).sweep(bench.state.campaigns["alpha"])
    left = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.glob("cases/*/*"))
    assert second.attempt == 2
    assert left == [
        "cases/repeat_0/attempt-1",  # unresolved: kept for whoever looks into it
        "cases/repeat_1/attempt-1",  # evidence of a late result
        "cases/repeat_1/attempt-3",
    ]
