"""What protects a verdict: a commit is bound to lease, session, attempt folder and KPI digest."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from conductor_bench import (
    CONFIG,
    Bench,
    S,
    V,
    ended,
    hello,
    result,
    secret,
    started,
    submit,
)

from conductor.core.facts import (
    AttemptEnded,
    CaseEnded,
    Committed,
    Fact,
    LateAttempt,
    WorkerJoined,
    WorkerLeft,
)
from conductor.core.fold import fold
from conductor.core.session import folder_for
from conductor.core.snapshot import restore, take
from conductor.core.state import Issued, State
from schemas.wire.codec import encode
from schemas.wire.control import Beat, Bye, Hello, Lease, Next, Request, Result, Sealed
from schemas.wire.delivery import AttemptFiles, SeenFolder
from twin.fabric.session import (
    SECRET_BYTES,
    hash_of,
    is_sealed,
    new_secret,
    proves,
    seal,
    signer_of,
)

THIEF = b"t" * SECRET_BYTES


def sealed(finished: Result, by: str, key: bytes | None = None, **fields: Any) -> Sealed:
    """A result out of the spool of the worker ``by``."""
    data = encode(finished)
    made = Sealed(finished.token, by, data, seal(key or secret(by), data))
    return msgspec.structs.replace(made, **fields)


def commits(bench: Bench) -> list[tuple[str, str, int]]:
    return [(c.worker, c.result.verdict, c.attempt) for c in bench.facts(Committed)]


def test_a_secret_is_proved_and_kept_as_a_hash() -> None:
    one, other = new_secret(), new_secret()
    assert len(one) == SECRET_BYTES
    assert one != other
    assert proves(one, hash_of(one))
    for kept in (hash_of(other), b"", one, hash_of(one)[:-1]):
        assert not proves(one, kept)
    assert not proves(b"", b"")
    mark = seal(one, b"data")
    assert is_sealed(signer_of(one), b"data", mark)
    for signer, data, given in (
        (signer_of(other), b"data", mark),
        (signer_of(one), b"date", mark),
        (signer_of(one), b"data", mark[:-1]),
        (signer_of(one), b"data", b""),
        (b"", b"data", mark),
        (b"\xff" * 32, b"data", mark),
    ):
        assert not is_sealed(signer, data, given)


def test_the_journal_knows_no_secret() -> None:
    bench = started(workers=3)
    bench.lease()
    written = b"".join(encode(fact) for fact in [*bench.journal, take(bench.state)])
    for worker in ("w1", "w2", "w3"):
        assert secret(worker) not in written
        assert hash_of(secret(worker)) in written
    assert bench.facts(WorkerJoined)[0].signer == signer_of(secret("w1"))


@pytest.mark.parametrize("given", [b"", b"x", b"x" * 31, b"x" * 33])
def test_no_worker_joins_without_a_secret(given: bytes) -> None:
    bench = Bench()
    reply = bench.ask(msgspec.structs.replace(hello(), session=given))
    assert "32 are needed; install the same version on both sides" in reply.error
    assert not bench.facts(WorkerJoined)


@pytest.mark.parametrize("session", [THIEF, hash_of(secret("w1")), secret("w2"), b"x"])
def test_nobody_speaks_for_a_worker_without_its_secret(session: bytes) -> None:
    bench = started(workers=2)
    first, second = bench.lease("w1", k=2)
    forged = result(first, passed=False)
    before, journal = bench.status(), list(bench.journal)
    requests: list[Request] = [
        Next(V, "w1", 2, 1, results=[forged], session=session),
        Next(V, "w1", 1, 1, session=session),
        Next(V, "w1", 2**40, 0, session=session),
        Next(V, "w1", 2, 0, ended=[ended(first, "crash")], session=session),
        Beat(V, "w1", {str(first.token): 9}, session=session),
        Bye(V, "w1", session=session),
        msgspec.structs.replace(hello("w1"), session=session.ljust(32, b"x")),
    ]
    for request in requests:
        reply = bench.ask(request)
        assert "secret is not that of the process that joined" in reply.error
        assert len(reply.error.splitlines()) == 1
        assert not reply.leases
    assert bench.journal == journal
    assert bench.status() == before
    reply = bench.next("w1", k=0, results=[result(first), result(second)])
    assert (reply.error, reply.fenced) == ("", [])
    assert commits(bench) == [("w1", "pass", 1)] * 2


def test_another_workers_token_is_worth_nothing() -> None:
    """Somebody with a session of his own commits, beats and gives back what is not his."""
    bench = started(cases=2, workers=2)
    first, second = bench.lease("w1", k=2)
    forged = [result(first, passed=False), result(second, verdict="pass", kpi="forged")]
    reply = bench.next("w2", k=0, results=forged, ended=[ended(first, "crash")])
    assert (reply.error, reply.acks, reply.fenced) == (
        "",
        [first.token, second.token],
        [first.token, second.token],
    )
    assert bench.beat("w2", first.token).lost == [first.token]
    assert not bench.facts(Committed)
    assert not bench.facts(LateAttempt)
    assert not bench.facts(AttemptEnded)
    assert not bench.next("w1", k=0, results=[result(first), result(second)]).fenced
    assert commits(bench) == [("w1", "pass", 1)] * 2
    # What is settled is so for its worker alone, and nobody's word against it is evidence.
    assert bench.next("w1", k=0, results=[result(first)]).fenced == []
    assert bench.next("w2", k=0, results=[result(first)]).fenced == [first.token]
    assert bench.next("w2", k=0, results=forged[:1]).fenced == [first.token]
    assert not bench.facts(LateAttempt)
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == 0


def test_two_leases_of_one_case_are_two_workers_own() -> None:
    bench = started(cases=2, workers=2)
    first, other = bench.lease("w1", k=2)
    bench.next("w1", k=0, results=[result(other, wall_s=0.1)], held=[first.token])
    bench.now_ns += bench.config.speculate_min_ns + S
    bench.beat("w1", first.token)
    (again,) = bench.lease("w2")
    assert again.case == first.case
    swapped = [("w2", first), ("w1", again)]
    for worker, lease in swapped:
        held = [again.token if worker == "w2" else first.token]
        assert bench.next(worker, k=0, results=[result(lease)], held=held).fenced == [lease.token]
    assert not bench.next("w2", k=0, results=[result(again)]).fenced
    assert commits(bench)[-1] == ("w2", "pass", 2)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"attempt_dir": "cases/repeat_0/attempt-2"}, "its attempt has cases/repeat_0/attempt-1"),
        ({"attempt_dir": "cases/repeat_1/attempt-1"}, "its attempt has cases/repeat_0/attempt-1"),
        ({"attempt_dir": ""}, "it has KPIs and names no folder"),
        ({"kpi_sha256": ""}, "a verdict without a digest of its KPIs"),
        ({"kpi_sha256": "", "attempt_dir": ""}, "a verdict without a digest of its KPIs"),
        ({"outcome": "failed", "verdict": "", "attempt_dir": ""}, "KPIs and names no folder"),
    ],
)
def test_a_result_that_does_not_fit_its_attempt_is_charged(
    changes: dict[str, Any], why: str
) -> None:
    bench = started(cases=1, attempts_max=2)
    for number in (1, 2):
        (lease,) = bench.lease()
        fitted = {k: v.replace("attempt-1", f"attempt-{number}") for k, v in changes.items()}
        if "attempt-2" in changes.get("attempt_dir", ""):
            fitted = {"attempt_dir": f"cases/repeat_0/attempt-{number + 1}"}
        reply = bench.next(k=0, results=[result(lease, **fitted)])
        assert (reply.error, reply.fenced) == ("", [lease.token])
    assert not bench.facts(Committed)
    assert [(e.reason, e.charged) for e in bench.facts(AttemptEnded)] == [("crash", True)] * 2
    (end,) = bench.facts(CaseEnded)
    assert end.outcome == "unresolved"
    assert "its result is refused: it" in end.reason
    assert why.replace("attempt-1", "attempt-2") in end.reason


@pytest.mark.parametrize(
    ("simulator", "changes"),
    [
        ("noop", {"kpi_sha256": "", "attempt_dir": ""}),
        ("noop", {"kpi_sha256": ""}),
        ("warp", {"outcome": "failed", "verdict": "", "kpi_sha256": ""}),
        ("warp", {"outcome": "failed", "verdict": "", "kpi_sha256": "", "attempt_dir": ""}),
        ("warp", {"outcome": "failed", "verdict": ""}),
        ("warp", {}),
    ],
)
def test_what_has_no_kpis_needs_no_digest(simulator: str, changes: dict[str, Any]) -> None:
    bench = started(cases=1, simulator=simulator)
    (lease,) = bench.lease()
    assert bench.next(k=0, results=[result(lease, **changes)]).fenced == []
    assert len(bench.facts(Committed)) == 1


def expired(bench: Bench, worker: str = "w1") -> Lease:
    (lease,) = bench.lease(worker)
    bench.now_ns += bench.config.ttl_ns
    bench.tick()
    return lease


def test_a_late_result_is_evidence_of_its_own_worker_only() -> None:
    bench = started(cases=1, workers=2, attempts_max=9)
    late = expired(bench)
    for worker, finished in (
        ("w2", result(late)),
        ("w1", result(late, attempt_dir="cases/repeat_0/attempt-2")),
        ("w1", result(late, kpi_sha256="")),
    ):
        assert bench.next(worker, k=0, results=[finished]).fenced == [late.token]
    assert not bench.facts(LateAttempt)
    assert bench.next("w1", k=0, results=[result(late)]).fenced == [late.token]
    (fact,) = bench.facts(LateAttempt)
    assert (fact.worker, fact.result) == ("w1", result(late))


@pytest.mark.parametrize("how", ["alive", "restart", "snapshot"])
def test_sessions_outlive_the_conductor(how: str) -> None:
    bench = started(cases=3, workers=2)
    first, second, third = bench.lease("w1", k=3)
    if how == "snapshot":
        bench.journal = [take(bench.state)]
    if how != "alive":
        bench.restart()
    held = [second.token, third.token]
    stolen = Next(V, "w1", 9, 0, results=[result(second, passed=False)], session=THIEF)
    assert "secret" in bench.ask(stolen).error
    assert bench.next("w2", k=0, results=[result(second, passed=False)]).fenced
    assert bench.next("w1", k=0, results=[result(first)], held=held).fenced == []
    assert not bench.ask(hello("w1")).error, "it may say hello again"
    assert bench.next("w2", k=0, sealed=[sealed(result(second), "w1")]).fenced == []
    assert bench.next("w1", k=0, results=[result(third)]).fenced == []
    assert commits(bench) == [("w1", "pass", 1)] * 3


def test_a_successor_delivers_what_its_predecessor_sealed() -> None:
    bench = started(cases=2, workers=2)
    first, second = bench.lease("w1", k=2)
    found = [sealed(result(first), "w1"), sealed(result(second), "w1")]
    reply = bench.next("w2", k=0, sealed=found)
    assert (reply.error, reply.acks, reply.fenced) == ("", [first.token, second.token], [])
    assert commits(bench) == [("w1", "pass", 1)] * 2
    for worker in ("w1", "w2"):
        assert bench.next(worker, k=0, sealed=found).fenced == [], "it is settled already"
    assert bench.next("w1", k=0, results=[result(first)]).fenced == []
    assert len(bench.facts(Committed)) == 2


def test_a_sealed_result_that_comes_late_is_evidence() -> None:
    bench = started(cases=1, workers=2)
    late = expired(bench)
    assert bench.next("w2", k=0, sealed=[sealed(result(late), "w1")]).fenced == [late.token]
    (fact,) = bench.facts(LateAttempt)
    assert fact.worker == "w1"


@pytest.mark.parametrize(
    "changes",
    [
        {"key": THIEF},
        {"key": secret("w2")},
        {"worker": "w2"},
        {"worker": "w2", "key": secret("w2")},
        {"worker": "nobody"},
        {"worker": ""},
        {"token": 1},
        {"seal": b""},
        {"seal": bytes(64)},
        {"result": b""},
        {"result": b"\xc1", "seal": seal(secret("w1"), b"\xc1")},
    ],
)
def test_a_seal_of_anybody_else_is_worth_nothing(changes: dict[str, Any]) -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    key = changes.pop("key", None)
    wrong = sealed(result(lease, passed=False), "w1", key, **changes)
    reply = bench.next("w2", k=0, sealed=[wrong])
    assert (reply.error, reply.acks, reply.fenced) == ("", [wrong.token], [wrong.token])
    assert not bench.facts(Committed)
    assert not bench.facts(LateAttempt)
    assert not bench.facts(AttemptEnded)
    assert bench.next("w1", k=0, results=[result(lease)]).fenced == []


def test_a_sealed_result_fits_its_attempt_as_any_other() -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    bad = sealed(result(lease, kpi_sha256=""), "w1")
    assert bench.next("w2", k=0, sealed=[bad]).fenced == [lease.token]
    (end,) = bench.facts(AttemptEnded)
    assert (end.reason, end.charged) == ("crash", True)


def test_an_id_that_was_forgotten_brings_no_rights_of_the_former_one() -> None:
    bench = started(cases=1, workers=2, attempts_max=9)
    late = expired(bench)
    bench.now_ns += bench.config.forget_ns
    bench.tick()
    assert "w1" in [fact.worker for fact in bench.facts(WorkerLeft)]
    taken = msgspec.structs.replace(hello("w1"), session=THIEF)
    assert not bench.ask(taken).error, "the id is free"
    forged = Next(V, "w1", 1, 0, results=[result(late, passed=False)], session=THIEF)
    assert bench.ask(forged).fenced == [late.token]
    assert not bench.facts(LateAttempt)
    assert "secret" in bench.ask(hello("w1")).error, "the former one hears why it cannot go on"
    files = delivery(late, "w1", session=THIEF)
    assert "is not one of worker w1" in folder_for(bench.state, files)[1]


def delivery(lease: Lease, worker: str, **fields: Any) -> AttemptFiles:
    made = AttemptFiles(
        V, lease.case.variation.campaign, lease.case.id, lease.attempt, b"", b"", ""
    )
    return msgspec.structs.replace(made, worker=worker, **{"session": secret(worker), **fields})


def test_files_come_from_the_worker_that_runs_the_attempt_or_ran_it() -> None:
    bench = started(cases=1, workers=2, attempts_max=9)
    late = expired(bench)
    (lease,) = bench.lease("w2")
    assert lease.attempt == 2
    for worker, of in (("w1", late), ("w2", lease)):
        assert folder_for(bench.state, delivery(of, worker)) == ("/state/alpha", "")
    for wrong, why in (
        (delivery(lease, "w1"), "attempt 2 of case 'repeat_0' is not one of worker w1"),
        (delivery(late, "w2"), "attempt 1 of case 'repeat_0' is not one of worker w2"),
        (delivery(lease, "w2", session=THIEF), "secret is not that of the process"),
        (delivery(lease, "w2", session=b""), "secret is not that of the process"),
        (delivery(lease, "w3"), "unknown worker"),
        (delivery(lease, "w2", attempt=3), "attempt 3"),
        (delivery(lease, "w2", case="../../etc"), "'../../etc' is not one of"),
        (delivery(lease, "w2", campaign="beta"), "beta: no such campaign here"),
    ):
        folder, error = folder_for(bench.state, wrong)
        assert not folder
        assert why in error
        assert len(error.splitlines()) == 1
    seen = SeenFolder(V, "alpha", "0" * 64, "w1", secret("w1"))
    assert folder_for(bench.state, seen) == ("/state/alpha", "")
    for worker, session in (("w1", THIEF), ("w3", THIEF), ("", b"")):
        stranger = msgspec.structs.replace(seen, worker=worker, session=session)
        assert folder_for(bench.state, stranger)[1]
    bench.next("w2", k=0, results=[result(lease)])
    assert folder_for(bench.state, delivery(lease, "w2")) == ("/state/alpha", ""), "sent again"


def test_journals_and_snapshots_of_earlier_versions_are_read() -> None:
    """Their workers have no secret: nobody speaks for them, and their cases are leased again."""
    bench = started(cases=1, workers=1)
    bench.lease()
    image = take(bench.state)
    old: list[Fact] = [
        msgspec.structs.replace(fact, session=b"", signer=b"")
        if isinstance(fact, WorkerJoined)
        else fact
        for fact in bench.journal
    ]
    state = fold(old, CONFIG)
    (case,) = state.campaigns["alpha"].ordered
    assert [(each.attempt, each.session) for each in case.issued] == [(1, b"")]
    cases = next(each for each in image.images if each.key.startswith("2/"))
    rows = msgspec.msgpack.decode(cases.data)
    rows["rows"][0][3] = [each[0] for each in rows["rows"][0][3]]
    images = [each for each in image.images if each is not cases]
    images.append(msgspec.structs.replace(cases, data=msgspec.msgpack.encode(rows)))
    restored = fold([msgspec.structs.replace(image, images=images)], CONFIG)
    (case,) = restored.campaigns["alpha"].ordered
    assert case.issued == (Issued(case.live[0], 0, b""),)


def test_a_hello_again_is_the_same_worker() -> None:
    bench = started()
    (lease,) = bench.lease()
    same = hello("w1")
    assert isinstance(same, Hello)
    assert not bench.ask(same).error
    assert "other properties" in bench.ask(msgspec.structs.replace(same, slots=9)).error
    bench.ask(submit("beta"))
    assert bench.next(k=0, results=[result(lease)]).fenced == []
    assert len(bench.facts(WorkerJoined)) == 1


def test_restore_is_what_fold_uses() -> None:
    """A snapshot is folded as the first fact of a journal."""
    bench = started(cases=1)
    bench.lease()
    state = State(config=CONFIG)
    images = take(bench.state)
    assert fold([images], CONFIG).leases == bench.state.leases
    with pytest.raises(AssertionError, match="without its head"):
        restore(state, msgspec.structs.replace(images, images=[]), lambda *_: None)
