"""The core at its exact limits: tokens, commits, idempotency, charges, pins."""

from __future__ import annotations

import msgspec
import pytest
from conductor_bench import Bench, campaign, ended, hello, result, started, submit

from conductor.core.decisions import UNKNOWN_WORKER
from conductor.core.facts import AttemptEnded, CaseEnded, Committed, LateAttempt, Leased, Pinned
from conductor.core.state import Config
from schemas import SCHEMA_VERSION as V
from schemas.case import CASE_VERSION
from schemas.sections.view_mode import ViewMode
from schemas.wire.codec import encode
from schemas.wire.control import Next, Submit
from schemas.wire.realtime import Realtime


def test_a_token_is_the_epoch_and_a_count() -> None:
    bench = started(cases=3)
    first, second = bench.lease(k=2)
    assert (first.token, second.token) == ((1 << 32) + 1, (1 << 32) + 2)
    bench.restart()
    assert bench.lease(held=[first.token, second.token], rig="x")[0].token == (2 << 32) + 1


def test_a_result_is_committed_once_and_acknowledged_again() -> None:
    bench = started()
    (lease,) = bench.lease()
    for _ in range(2):
        reply = bench.next(k=0, results=[result(lease)])
        assert (reply.acks, reply.fenced) == ([lease.token], [])
    assert len(bench.facts(Committed)) == 1
    assert not bench.facts(LateAttempt)


def test_another_digest_for_a_committed_token_is_fenced_and_kept() -> None:
    bench = started()
    (lease,) = bench.lease()
    bench.next(k=0, results=[result(lease)])
    for _ in range(2):
        reply = bench.next(k=0, results=[result(lease, kpi="other")])
        assert (reply.acks, reply.fenced) == ([lease.token], [lease.token])
    assert len(bench.facts(LateAttempt)) == 1
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == 1


PACED = Realtime(40, 0, 0, 50.0, 50.0, 50.0, 1.0)


@pytest.mark.parametrize(
    ("kpi", "realtime", "disagreements"),
    [("", None, 0), ("other", None, 1), ("other", PACED, 0)],
)
@pytest.mark.parametrize("late_first", [True, False])
def test_a_late_result_must_agree(
    kpi: str, realtime: Realtime | None, disagreements: int, late_first: bool
) -> None:
    bench = started(cases=1, workers=2)
    (old,) = bench.lease("w1")
    bench.now_ns += bench.config.ttl_ns
    (new,) = bench.lease("w2")
    results = [result(old, kpi=kpi), result(new)]
    results = [msgspec.structs.replace(each, realtime=realtime) for each in results]
    requests = list(zip(("w1", "w2"), results, strict=True))
    for worker, finished in requests if late_first else reversed(requests):
        bench.next(worker, k=0, results=[finished])
    assert [fact.result.token for fact in bench.facts(Committed)] == [new.token]
    assert [fact.result.token for fact in bench.facts(LateAttempt)] == [old.token]
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == disagreements


@pytest.mark.parametrize(
    "changes",
    [{"token": 12345}, {"case": "repeat_1"}, {"case": "nothing"}, {"campaign": "nothing"}],
)
def test_a_result_for_anything_but_its_own_lease_is_fenced(changes: dict[str, object]) -> None:
    bench = started()
    (lease,) = bench.lease()
    wrong = result(lease, **changes)
    reply = bench.next(k=0, results=[wrong], held=[lease.token])
    assert reply.fenced == [wrong.token]
    assert not bench.facts(Committed)
    assert not bench.facts(LateAttempt)


def test_the_same_seq_gets_the_same_bytes_also_after_a_restart() -> None:
    bench = started()
    request = Next(v=V, worker="w1", seq=1, k=2)
    first = encode(bench.ask(request))
    assert encode(bench.ask(request)) == first
    bench.restart()
    assert encode(bench.ask(request)) == first
    assert len(bench.facts(Leased)) == 2


def test_an_overtaken_seq_is_refused() -> None:
    bench = started()
    bench.ask(Next(v=V, worker="w1", seq=5, k=1))
    reply = bench.ask(Next(v=V, worker="w1", seq=4, k=1))
    assert reply.error == "seq 4 is older than 5, which has been answered"
    assert not reply.leases


def test_a_lease_lost_on_the_way_goes_back_uncharged() -> None:
    bench = started(cases=1)
    (lost,) = bench.lease()
    (again,) = bench.lease(held=[])
    assert again.case.id == lost.case.id
    assert again.attempt == 2
    (end,) = bench.facts(AttemptEnded)
    assert (end.reason, end.charged) == ("released", False)


def test_results_are_committed_before_missing_leases_are_released() -> None:
    bench = started(cases=2)
    first, second = bench.lease(k=2)
    bench.next(k=0, results=[result(first)], ended=[ended(second, "walltime")])
    assert len(bench.facts(Committed)) == 1
    assert [end.reason for end in bench.facts(AttemptEnded)] == ["walltime"]


@pytest.mark.parametrize("reason", ["released", "walltime", "lost"])
def test_uncharged_ends_never_end_the_case(reason: str) -> None:
    bench = started(cases=1, attempts_max=1)
    for _ in range(5):
        (lease,) = bench.lease()
        assert not lease.alone
        bench.next(k=0, ended=[ended(lease, reason)])
    assert not bench.facts(CaseEnded)
    assert len(bench.lease()) == 1


@pytest.mark.parametrize("reason", ["crash", "deadline", "out_of_memory"])
def test_the_last_charge_ends_the_case_exactly(reason: str) -> None:
    bench = started(cases=1, attempts_max=3)
    for count in range(1, 4):
        assert not bench.facts(CaseEnded)
        (lease,) = bench.lease()
        assert (lease.attempt, lease.alone) == (count, count > 1)
        bench.next(k=0, ended=[ended(lease, reason, "signal 11")])
    (end,) = bench.facts(CaseEnded)
    assert end.outcome == "unresolved"
    last = f"{reason}: signal 11 (worker w1)"
    assert end.reason == f"quarantined: 3 charged attempts on 1 worker, the last one: {last}"
    assert [str(charge) for charge in end.evidence] == [last] * 3
    assert bench.lease() == []
    assert bench.status()["campaigns"]["alpha"]["unresolved"] == 1


def test_a_suspect_is_leased_alone_and_not_charged() -> None:
    bench = started(cases=3, attempts_max=1)
    first, second = bench.lease(k=2)
    reply = bench.next(k=3, ended=[ended(first, "suspect"), ended(second, "suspect")])
    assert [(lease.case.id, lease.alone) for lease in reply.leases] == [("repeat_0", True)]
    # A worker that runs a case alone gets nothing beside it.
    assert bench.lease(k=3, held=[reply.leases[0].token]) == []
    # A worker that runs something gets no case that must be alone.
    bench.ask(hello("w2"))
    shared = bench.lease("w2", k=1, rig=_rig(bench))
    assert shared[0].case.id == "repeat_1"
    assert shared[0].alone
    assert not bench.facts(CaseEnded)


def test_a_case_that_must_run_alone_waits_for_an_empty_rig() -> None:
    bench = started(cases=2, workers=2)
    first, second = bench.lease(k=2)
    bench.next(k=0, ended=[ended(first, "suspect")], held=[second.token])
    assert bench.lease(k=2, held=[second.token]) == []
    (alone,) = bench.lease("w2", k=2)
    assert alone.alone


def _rig(bench: Bench) -> str:
    return bench.state.campaigns["alpha"].ordered[0].rig


def test_ended_needs_the_live_lease_of_the_asker() -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    bench.next("w2", k=0, ended=[ended(lease, "crash")])
    assert not bench.facts(AttemptEnded)
    wrong = msgspec.structs.replace(ended(lease, "crash"), case="repeat_9")
    bench.next("w1", k=0, ended=[wrong], held=[lease.token])
    assert not bench.facts(AttemptEnded)


def test_leases_of_a_reply_share_a_rig_and_the_running_rig_is_preferred() -> None:
    bench = Bench()
    bench.ask(hello())
    fields = {"matrix": {"repeat": [0, 1], "camera.width": [640, 320]}}
    bench.ask(Submit(v=V, campaign={"campaign": "alpha", **fields}))
    leases = bench.lease(k=4)
    widths = {lease.case.rig.camera.width for lease in leases}
    assert (len(leases), widths) == (2, {640})
    other = next(
        c.rig for c in bench.state.campaigns["alpha"].ordered if c.case.rig.camera.width == 320
    )
    held = [lease.token for lease in leases]
    # The rig that runs decides, whatever the worker calls it.
    assert bench.lease(k=4, held=held, rig=other) == []
    preferred = bench.lease(k=1, held=[], rig=other)
    assert preferred[0].case.rig.camera.width == 320


def test_a_rig_is_known_by_its_name_when_its_tokens_are_dead() -> None:
    bench = started(cases=2)
    assert bench.next(k=1, held=[99], rig="").lost == [99]
    assert bench.lease(k=1, held=[99], rig="") == []
    assert len(bench.lease(k=1, held=[99], rig=_rig(bench))) == 1


@pytest.mark.parametrize(("k", "count"), [(-1, 0), (0, 0), (1, 1), (4, 4), (5, 4), (10**9, 4)])
def test_k_is_a_limit(k: int, count: int) -> None:
    assert len(started(cases=4).lease(k=k)) == count


def test_leases_max_is_a_limit() -> None:
    bench = Bench(Config(folder="/state", leases_max=2))
    bench.ask(submit())
    bench.ask(hello())
    assert len(bench.lease(k=4)) == 2


def test_the_first_lease_pins_software_and_device() -> None:
    bench = started()
    bench.lease()
    assert bench.facts(Pinned)[0].software == "f00d"
    reply = bench.ask(hello("w2", software="beef"))
    assert not reply.error
    assert "software beef is not the f00d" in reply.status["notes"][0]
    assert bench.next("w2").leases == []
    reply = bench.ask(hello("w3", device_class="cuda:H200"))
    assert "device class cuda:H200 is not the cpu:avx2" in reply.status["notes"][0]
    assert bench.next("w3").leases == []
    assert len(bench.status()["notes"]) == 2
    # Another campaign is free to choose.
    bench.ask(submit("beta"))
    assert bench.lease("w3")[0].case.variation.campaign == "beta"


def test_device_any_pins_the_software_only() -> None:
    bench = started(device="any")
    bench.lease()
    bench.ask(hello("w2", device_class="cuda:H200"))
    bench.ask(hello("w3", software="beef"))
    assert len(bench.lease("w2")) == 1
    assert bench.lease("w3") == []


def test_a_hello_may_be_repeated_but_not_changed() -> None:
    bench = started()
    assert not bench.ask(hello("w1")).error
    assert "new id" in bench.ask(hello("w1", software="beef")).error
    bench.bye("w1")
    assert "has left" in bench.ask(hello("w1")).error
    assert not bench.bye("w1").error


@pytest.mark.parametrize("name", ["", "a/b", "a*", "$x", "a b", "x" * 201])
def test_a_worker_id_must_fit_keys_and_files(name: str) -> None:
    assert "worker id" in Bench().ask(hello(name)).error


def test_another_schema_version_is_refused() -> None:
    reply = Bench().ask(msgspec.structs.replace(hello(), v=V + 1))
    assert reply.error.startswith(f"schema version {V + 1} given, this conductor speaks {V}")


def test_a_worker_that_reads_other_cases_is_refused() -> None:
    reply = Bench().ask(msgspec.structs.replace(hello("w1"), case_version=CASE_VERSION + 1))
    assert reply.error == (
        f"worker w1 reads cases of version {CASE_VERSION + 1}, this conductor leases version "
        f"{CASE_VERSION}; install the same release on both sides"
    )


def test_unknown_workers_are_asked_to_say_hello() -> None:
    bench = started()
    assert bench.next("w9").error == UNKNOWN_WORKER
    assert bench.beat("w9").error == UNKNOWN_WORKER


def test_bye_gives_everything_back() -> None:
    bench = started(workers=2)
    bench.lease("w1", k=4)
    bench.bye("w1")
    assert len(bench.lease("w2", k=4)) == 4
    assert all(not end.charged for end in bench.facts(AttemptEnded))


def test_stop_drains_and_a_restart_does_not() -> None:
    bench = started()
    assert bench.stop().drain
    reply = bench.next(k=2)
    assert (reply.leases, reply.drain) == ([], True)
    bench.restart()
    assert len(bench.lease(k=2)) == 2


def test_submitting_again_resumes() -> None:
    bench = started()
    count = len(bench.journal)
    reply = bench.ask(submit())
    assert (reply.error, reply.status["resumed"], reply.status["cases"]) == ("", True, 4)
    assert len(bench.journal) == count
    reordered = {"campaign": "alpha", "matrix": {"repeat": [3, 2, 1, 0]}}
    assert bench.ask(Submit(v=V, campaign=reordered)).status["resumed"]


def test_the_same_name_with_other_cases_is_refused() -> None:
    reply = started().ask(submit(cases=5))
    assert reply.error.startswith("alpha: /state/alpha holds a campaign of this name")
    assert reply.error.endswith("give it another name or another out folder")


def test_two_campaigns_need_two_folders() -> None:
    bench = started(out="/results")
    assert "another out folder" in bench.ask(submit("beta", out="/results")).error
    assert "absolute path" in bench.ask(submit("beta", out="results")).error


def test_every_mistake_of_a_campaign_is_a_line() -> None:
    data = {**campaign(), "seeds": 1, "control_hz": 0, "matrix": {"repeat": [-1]}}
    lines = Bench().ask(Submit(v=V, campaign=data)).error.splitlines()
    assert [line.split(": ")[1] for line in lines] == ["seeds", "control_hz"]


def test_cases_are_granted_in_submission_order_and_campaigns_take_turns() -> None:
    bench = started(cases=2)
    bench.ask(submit("beta", cases=2))
    leases = bench.lease(k=3)
    assert [(x.case.variation.campaign, x.case.id) for x in leases] == [
        ("alpha", "repeat_0"),
        ("beta", "repeat_0"),
        ("alpha", "repeat_1"),
    ]


def test_by_batch_waits_for_the_batch_to_end() -> None:
    bench = Bench(Config(folder="/state", by_batch=True))
    bench.ask(submit(cases=5, batch={"size": 2}))
    bench.ask(hello())
    leases = bench.lease(k=5)
    assert [lease.case.variation.batch for lease in leases] == [1, 1]
    held = [leases[1].token]
    assert bench.lease(k=5, results=[result(leases[0])], held=held) == []
    # The last case of a batch and the first of the next one meet in one request.
    assert [x.case.variation.batch for x in bench.lease(k=5, results=[result(leases[1])])] == [2, 2]


def test_retry_after_tells_busy_from_idle() -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    assert bench.next("w2").retry_after_s == bench.config.retry_busy_s
    reply = bench.next("w1", results=[result(lease)])
    assert (reply.left, reply.retry_after_s) == (0, bench.config.retry_idle_s)


def test_status_counts() -> None:
    bench = started(cases=5, attempts_max=1)
    a, b, c, d, _ = bench.lease(k=5)
    failed = result(c, outcome="failed", verdict="nan", passed=False)
    bench.next(
        k=0,
        results=[result(a), result(b, passed=False), failed],
        ended=[ended(d, "crash")],
    )
    found = bench.status()
    counts = found["campaigns"]["alpha"]
    expected = {
        "cases": 5, "waiting": 1, "leased": 0, "committed": 3, "passed": 1, "not_passed": 1,
        "failed": 1, "unresolved": 1, "cancelled": 0, "attempts": 5, "left": 1,
    }  # fmt: skip
    assert {key: counts[key] for key in expected} == expected
    assert found["workers"][0]["id"] == "w1"


def test_a_conductor_told_what_to_show_tells_it_of_all_cases() -> None:
    bench = Bench(Config(folder="/state", view=ViewMode.record))
    bench.ask(submit(cases=1, view="none"))
    bench.ask(hello())
    assert [lease.case.rig.view for lease in bench.lease()] == ["record"]
    bench.ask(submit(cases=1, view="live"))
    assert len(bench.state.campaigns) == 1, "the same campaign, gone on with"
