"""Bad clients against a live conductor: refused with a reason and counted; the loop goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
from conductor_bench import beat_of, hello, next_of, result, submit
from unit.conductor.ops_bench import running_hub, serving
from waiting import PATIENCE_S

import conductor.serve.inbox
from conductor.serve.shell import Conductor
from schemas import SCHEMA_VERSION as V
from schemas.wire import topics
from schemas.wire.codec import MESSAGE_BYTES_MAX, WireError, decode, encode
from schemas.wire.control import Reply, Request, StatusRequest, Stop
from schemas.wire.rpc_routes import COMMAND_BYTES_MAX, route_key

Ask = Callable[..., Reply]


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Conductor, Ask]]:
    with running_hub() as hub, serving(tmp_path / "state", hub) as conductor:
        bus = hub.open()

        def ask(payload: bytes, at: str = "") -> Reply:
            return decode(bus.request(at or _route(payload), payload, PATIENCE_S) or b"", Reply)

        assert not ask(encode(submit())).error
        assert not ask(encode(hello())).error
        yield conductor, ask
        assert ask(encode(StatusRequest(v=V))).status["left"] == 4, "a good client is still served"


def _route(payload: bytes) -> str:
    """Where a good client sends it; what is no request comes where large ones may."""
    try:
        return route_key(decode(payload, Request))
    except WireError:
        return topics.RPC_SUBMIT.key


def test_a_request_by_another_door_is_refused(served: tuple[Conductor, Ask]) -> None:
    """Access lists know keys only: a viewer must not cancel through the route for questions."""
    conductor, ask = served
    before = conductor.snapshot()["campaigns"]
    requests = [submit(), hello("w2"), Stop(v=V), next_of(worker="w1", seq=1, k=1)]
    tries = [
        (request, topic.key)
        for request in requests
        for topic in (topics.RPC_STATUS, topics.RPC_WORKER, topics.RPC_ADMIN, topics.RPC_SUBMIT)
        if topic.key != route_key(request)
    ]
    for request, at in tries:
        assert f"came on {at}; send it to {route_key(request)}" in ask(encode(request), at).error
    assert counters(conductor)["refused"] == len(tries) == 12
    assert conductor.snapshot()["campaigns"] == before
    assert [worker["id"] for worker in conductor.snapshot()["workers"]] == ["w1"]


def counters(conductor: Conductor) -> dict[str, Any]:
    found: dict[str, Any] = conductor.snapshot()["counters"]
    return found


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (msgpack.packb({"v": V + 1, "verb": "status"}), f"schema version {V + 1} given"),
        (msgpack.packb({"v": V + 1, "verb": "new", "x": 1}), f"schema version {V + 1} given"),
        (msgpack.packb({"v": V, "verb": "dance"}), "dance"),
        (msgpack.packb({"v": V}), "not a valid message"),
        (msgpack.packb({"v": V, "verb": "beat", "worker": "w1"}), "held"),
        (msgpack.packb("status"), "not a valid message"),
        (b"", "not MessagePack"),
        (b"\xc1" * 40, "not MessagePack"),
        (b"GET / HTTP/1.1\r\n\r\n", "not MessagePack"),
        (b"\xdd\xff\xff\xff\xff", "not MessagePack"),
        (b"\x91" * 100_000, "not MessagePack"),
    ],
)
def test_refused_with_a_reason(served: tuple[Conductor, Ask], payload: bytes, reason: str) -> None:
    conductor, ask = served
    fits_a_question = b"beat" not in payload and len(payload) <= COMMAND_BYTES_MAX
    reply = ask(payload, (topics.RPC_STATUS if fits_a_question else topics.RPC_WORKER).key)
    assert reason in reply.error
    assert len(reply.error.splitlines()) == 1
    assert counters(conductor)["refused"] == 1


@pytest.mark.parametrize("size", [MESSAGE_BYTES_MAX + 1, 100_000_000])
def test_a_huge_payload_is_turned_away_unread(served: tuple[Conductor, Ask], size: int) -> None:
    conductor, ask = served
    assert f"message of {size} bytes, at most" in ask(bytes(size)).error
    assert counters(conductor)["turned_away"] == 1
    assert counters(conductor)["refused"] == 0


def test_the_largest_payload_is_read(served: tuple[Conductor, Ask]) -> None:
    conductor, ask = served
    assert "not MessagePack" in ask(bytes(MESSAGE_BYTES_MAX)).error
    assert counters(conductor)["turned_away"] == 0


def test_waiting_bytes_are_bounded(
    served: tuple[Conductor, Ask], monkeypatch: pytest.MonkeyPatch
) -> None:
    conductor_, ask = served
    monkeypatch.setattr(conductor.serve.inbox, "WAITING_BYTES_MAX", 10)
    reply = ask(encode(StatusRequest(v=V)))
    assert reply.error.startswith("busy")
    assert reply.retry_after_s == 1.0
    monkeypatch.undo()
    assert counters(conductor_)["turned_away"] == 1


def test_forged_tokens_are_fenced(served: tuple[Conductor, Ask]) -> None:
    conductor, ask = served
    (lease,) = ask(encode(next_of(worker="w1", seq=1, k=1))).leases
    forged = [result(lease, token=lease.token + n) for n in (1, 2**32, -1)]
    reply = ask(encode(next_of(worker="w1", seq=2, k=0, results=forged, held=[lease.token])))
    assert reply.fenced == [each.token for each in forged]
    assert counters(conductor)["fenced"] == 3
    beat = ask(encode(beat_of(worker="w1", held={str(lease.token): 1, "999": 1})))
    assert beat.lost == [999]
    row = conductor.snapshot()["campaigns"]["alpha"]
    assert (row["committed"], row["leased"]) == (0, 1)


def test_another_workers_token_gives_nothing_back(served: tuple[Conductor, Ask]) -> None:
    conductor, ask = served
    ask(encode(hello("w2")))
    (lease,) = ask(encode(next_of(worker="w1", seq=1, k=1))).leases
    ask(encode(next_of(worker="w2", seq=1, k=0, held=[lease.token])))
    assert conductor.snapshot()["campaigns"]["alpha"]["leased"] == 1
    assert "unknown worker" in ask(encode(next_of(worker="nobody", seq=1, k=1))).error
