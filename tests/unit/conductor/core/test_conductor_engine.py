"""The engine's order: decide, commit, reply; and what it does when one of them fails."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import msgpack
import pytest
from conductor_bench import CONFIG, S, hello, result, shown, submit

import conductor.serve.engine
from conductor.core.facts import Committed, Fact, Leased, is_durable
from conductor.core.fold import fold
from conductor.journal.store import JournalError
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Beat, Next, Reply, Request, Stop


class Store:
    """A journal in memory that refuses while ``full``."""

    def __init__(self) -> None:
        self.facts: list[Fact] = []
        self.full = False
        self.commits = 0

    def append(self, facts: Sequence[Fact]) -> None:
        durable = [fact for fact in facts if is_durable(fact)]
        if durable and self.full:
            raise JournalError("storage: no space left; free some space, then retry")
        self.commits += bool(durable)
        self.facts += durable

    def probe(self) -> None:
        if self.full:
            raise JournalError("storage: still no space left")

    def fold(self) -> list[Fact]:
        return self.facts


def messages(*requests: Request, now_ns: int = S) -> list[IncomingRequest]:
    return [IncomingRequest(encode(shown(request)), now_ns) for request in requests]


def ask(engine: ConductorEngine, *requests: Request, now_ns: int = S) -> list[Reply]:
    return [
        decode(r or b"", Reply) for r in engine.turn(messages(*requests, now_ns=now_ns)).replies
    ]


@pytest.fixture
def store() -> Store:
    return Store()


@pytest.fixture
def engine(store: Store) -> ConductorEngine:
    engine = ConductorEngine(store, CONFIG, 0)
    ask(engine, submit(), hello())
    return engine


def test_a_group_is_one_commit(engine: ConductorEngine, store: Store) -> None:
    before = store.commits
    replies = ask(engine, *(Next(v=V, worker="w1", seq=s, k=1) for s in (1, 2)), hello("w2"))
    assert [reply.error for reply in replies] == ["", "", ""]
    assert store.commits == before + 1


@pytest.mark.parametrize(
    ("payload", "error"),
    [
        (b"", "not MessagePack"),
        (b"\xc1", "not MessagePack"),
        (msgpack.packb({"v": V}), "not a valid message"),
        (msgpack.packb({"v": V, "verb": "dance"}), "not a valid message"),
        (msgpack.packb({"v": V + 1, "verb": "status"}), f"schema version {V + 1} given"),
        (b"x" * ((16 << 20) + 1), "bytes, at most"),
        (msgpack.packb([1, 2]), "not a valid message"),
    ],
)
def test_rubbish_is_answered_and_counted(
    engine: ConductorEngine, payload: bytes, error: str
) -> None:
    turn = engine.turn([IncomingRequest(payload, S), *messages(hello("w2"))])
    first, second = (decode(reply or b"", Reply) for reply in turn.replies)
    assert error in first.error
    assert not second.error
    assert engine.counters.refused == 1


def test_no_space_refuses_the_group_and_forgets_it(engine: ConductorEngine, store: Store) -> None:
    request = Next(v=V, worker="w1", seq=1, k=2)
    store.full = True
    for _ in range(2):
        (reply,) = ask(engine, request)
        assert reply.error.startswith("storage: ")
        assert (reply.leases, reply.retry_after_s) == ([], 1.0)
        assert engine.state == fold(store.facts)
    store.full = False
    (reply,) = ask(engine, request)
    assert len(reply.leases) == 2
    assert not engine.storage_error
    assert engine.state == fold(store.facts)


def test_no_lease_expires_while_the_storage_refuses(engine: ConductorEngine, store: Store) -> None:
    (reply,) = ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    lease = reply.leases[0]
    store.full = True
    for second in (17, 40, 80):
        assert engine.tick(second * S).facts == []
    store.full = False
    done = Next(v=V, worker="w1", seq=2, k=0, results=[result(lease)])
    (reply,) = ask(engine, done, now_ns=100 * S)
    assert (reply.error, reply.fenced) == ("", [])
    assert any(isinstance(fact, Committed) for fact in store.facts)


def test_messages_count_from_their_arrival(engine: ConductorEngine) -> None:
    """A stalled disk lets heartbeats pile up; they must not find their leases expired."""
    (reply,) = ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    token = reply.leases[0].token
    beat = encode(shown(Beat(v=V, worker="w1", held={str(token): 1})))
    turn = engine.turn([IncomingRequest(beat, second * S) for second in (10, 20, 30)])
    assert [decode(r or b"", Reply).lost for r in turn.replies] == [[], [], []]
    engine.tick((30 + 15) * S - 1)
    assert token in engine.state.leases
    engine.tick((30 + 15) * S)
    assert token not in engine.state.leases


def test_time_never_runs_backwards(engine: ConductorEngine) -> None:
    ask(engine, Next(v=V, worker="w1", seq=1, k=1), now_ns=50 * S)
    ask(engine, hello("w2"), now_ns=1 * S)
    assert engine.next_expiry_ns() == 65 * S
    assert engine.state.workers["w2"].seen_ns == 50 * S


def test_a_mistake_of_ours_costs_one_request_only(
    engine: ConductorEngine,
    store: Store,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    decide = conductor.serve.engine.decide

    def mistaken(state: object, request: Request, now_ns: int) -> object:
        answer = decide(state, request, now_ns)  # type: ignore[arg-type]
        if isinstance(request, Beat):
            raise ZeroDivisionError
        return answer

    monkeypatch.setattr(conductor.serve.engine, "decide", mistaken)
    with caplog.at_level(logging.CRITICAL):
        replies = ask(
            engine,
            Next(v=V, worker="w1", seq=1, k=1),
            Beat(v=V, worker="w1", held={}),
            hello("w2"),
        )
    assert [reply.error for reply in replies] == [
        "",
        "internal error of the conductor; see its log",
        "",
    ]
    assert sum(isinstance(fact, Leased) for fact in store.facts) == 1
    assert engine.counters.faults == 1
    assert engine.state == fold(store.facts)


def test_a_group_that_is_decided_one_by_one_still_tells_all_its_facts(
    engine: ConductorEngine,
    store: Store,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The timeline and the metrics are made from a turn's facts, not from the journal."""
    decide = conductor.serve.engine.decide

    def mistaken(state: object, request: Request, now_ns: int) -> object:
        if isinstance(request, Beat):
            raise ZeroDivisionError
        return decide(state, request, now_ns)  # type: ignore[arg-type]

    monkeypatch.setattr(conductor.serve.engine, "decide", mistaken)
    before = len(store.facts)
    asked = (hello("w2"), Beat(v=V, worker="w1", held={}), Next(v=V, worker="w2", seq=1, k=1))
    with caplog.at_level(logging.CRITICAL):
        turn = engine.turn(messages(*asked))
    assert [fact for fact in turn.facts if is_durable(fact)] == store.facts[before:]
    assert any(isinstance(fact, Leased) for fact in turn.facts)


def test_a_restart_raises_the_epoch_and_keeps_drain_out(
    engine: ConductorEngine, store: Store
) -> None:
    """Draining is of the process that was told to: the next one grants again."""
    ask(engine, Stop(v=V))
    (reply,) = ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    assert (reply.drain, reply.leases) == (True, [])
    restarted = ConductorEngine(store, CONFIG, 0)
    assert restarted.state.epoch == engine.state.epoch + 1
    (reply,) = ask(restarted, Next(v=V, worker="w1", seq=2, k=1))
    assert not reply.drain
    assert len(reply.leases) == 1


def test_a_full_disk_does_not_make_the_conductor_forget_that_it_drains(
    engine: ConductorEngine, store: Store
) -> None:
    ask(engine, Stop(v=V))
    store.full = True
    (reply,) = ask(engine, hello("w2"))
    assert reply.error.startswith("storage: ")
    store.full = False
    (reply,) = ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    assert (reply.error, reply.drain, reply.leases) == ("", True, [])


def test_a_hint_gets_no_reply(engine: ConductorEngine) -> None:
    ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    assert engine.turn([IncomingRequest(b"", 2 * S, vanished="w1")]).replies == [None]
    assert engine.next_expiry_ns() == 5 * S


def test_a_request_that_comes_by_another_key_is_refused(
    engine: ConductorEngine, store: Store
) -> None:
    """The access list knows keys: who may only ask for the status must not submit there."""
    before = len(store.facts)
    for request, key, accepted in (
        (submit("beta"), "conductor/rpc/status", False),
        (submit("beta"), "conductor/rpc/admin", False),
        (Stop(v=V), "conductor/rpc/submit", False),
        (hello("w3"), "conductor/rpc/admin", False),
        (hello("w3"), "conductor/rpc/worker", True),
    ):
        (data,) = engine.turn([IncomingRequest(encode(request), S, route=key)]).replies
        error = decode(data or b"", Reply).error
        assert (error == "") is accepted
        assert accepted or error.startswith(f"{type(request).__name__} came on {key}; send it to ")
    assert [type(fact).__name__ for fact in store.facts[before:]] == ["WorkerJoined"]
    assert engine.counters.refused == 4
