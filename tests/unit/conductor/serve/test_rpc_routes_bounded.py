"""What comes in is bounded by its route before it costs anything: its size, and what it may be."""

from __future__ import annotations

from pathlib import Path

import msgpack
import pytest
from conductor_bench import hello
from unit.conductor.ops_bench import running_hub, serving
from waiting import PATIENCE_S

import schemas.wire.rpc_routes
from conductor.serve.inbox import GROUP_MAX, OTHERS_WAITING_MAX, Inbox
from schemas import SCHEMA_VERSION as V
from schemas.wire import topics
from schemas.wire.codec import MESSAGE_BYTES_MAX, WireError, decode, encode
from schemas.wire.control import Beat, Reply, StatusRequest
from schemas.wire.rpc_routes import (
    COMMAND_BYTES_MAX,
    PEEK_BYTES,
    RPC_ROUTES,
    WORKER_BYTES_MAX,
    read_request,
)

STATUS, WORKER, SUBMIT, ADMIN = (
    topic.key
    for topic in (topics.RPC_STATUS, topics.RPC_WORKER, topics.RPC_SUBMIT, topics.RPC_ADMIN)
)


def beat_of(size: int) -> bytes:
    """A beat that is costly to decode, of about so many bytes."""
    held = {str(token): 1 for token in range(10**9, 10**9 + size // 12)}
    return encode(Beat(v=V, worker="w1", held=held))


def test_each_door_has_a_size_of_its_own() -> None:
    sizes = {key: found.bytes_max for key, found in RPC_ROUTES.items()}
    assert sizes == {
        STATUS: COMMAND_BYTES_MAX,
        WORKER: WORKER_BYTES_MAX,
        SUBMIT: MESSAGE_BYTES_MAX,
        ADMIN: COMMAND_BYTES_MAX,
    }
    assert COMMAND_BYTES_MAX < WORKER_BYTES_MAX < MESSAGE_BYTES_MAX


@pytest.mark.parametrize("key", RPC_ROUTES)
def test_a_message_is_turned_away_by_the_size_of_its_route(key: str) -> None:
    inbox, said = Inbox(), []
    most = RPC_ROUTES[key].bytes_max
    inbox.receive(bytes(most), pytest.fail, key)
    inbox.receive(bytes(most + 1), lambda data: said.append(decode(data, Reply).error), key)
    assert said == [f"message of {most + 1} bytes, at most {most} are accepted"]
    assert len(inbox.group(0.0)) == 1
    assert inbox.turned_away == 1


def test_a_flood_of_giants_by_a_viewer_is_never_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[int] = []

    def counting(payload: bytes, *rest: object) -> object:
        read.append(len(payload))
        return decode(payload, *rest)

    monkeypatch.setattr(schemas.wire.rpc_routes, "decode", counting)
    giant = beat_of(MESSAGE_BYTES_MAX - 4096)
    with running_hub() as hub, serving(tmp_path / "state", hub) as conductor:
        viewer, worker = hub.open(), hub.open()
        for _ in range(20):
            said = decode(viewer.request(STATUS, giant, PATIENCE_S) or b"", Reply)
            assert f"at most {COMMAND_BYTES_MAX} are accepted" in said.error
        assert not decode(worker.request(WORKER, encode(hello()), PATIENCE_S) or b"", Reply).error
        counters = conductor.snapshot()["counters"]
        assert (counters["turned_away"], counters["refused"]) == (20, 0)
    assert sum(read) < 10_000, "bytes that anybody looked into"


def test_whoever_asks_too_much_waits_for_himself() -> None:
    inbox, said = Inbox(), []
    question = encode(StatusRequest(v=V))
    for _ in range(OTHERS_WAITING_MAX + 5):
        inbox.receive(question, lambda data: said.append(decode(data, Reply)), STATUS)
    assert len(said) == 5
    assert all(reply.retry_after_s for reply in said), "busy: asked again later"
    for _ in range(3):
        inbox.receive(b"worker", pytest.fail, WORKER)
    first = [message.route for message, _ in inbox.group(0.0)]
    assert len(first) == GROUP_MAX
    assert first.count(WORKER) == 3, "none of them waits behind the thousand"
    rest = 0
    while group := inbox.group(0.0):
        rest += len(group)
    assert rest == OTHERS_WAITING_MAX + 3 - GROUP_MAX, "and nobody is forgotten"


@pytest.mark.parametrize("size", [100, PEEK_BYTES + 1, 2 << 20])
def test_what_belongs_elsewhere_is_known_by_its_name_alone(
    size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rest of it is not even well formed."""
    request = {"verb": "beat", "v": "no number", "worker": 7, "held": "x" * size}
    payload = msgpack.packb(request)
    if size > PEEK_BYTES:  # then nothing else looks at it
        monkeypatch.setattr(schemas.wire.rpc_routes, "decode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(WireError, match=f"Beat came on {SUBMIT}; send it to {WORKER}"):
        read_request(payload, SUBMIT)


def test_what_may_come_is_read() -> None:
    beat = Beat(v=V, worker="w1", held={"1": 2})
    assert read_request(encode(beat), WORKER) == beat
    assert read_request(encode(beat), "") == beat, "from inside the process"
    large = beat_of(1 << 20)
    assert len(large) > PEEK_BYTES
    assert isinstance(read_request(large, WORKER), Beat)
