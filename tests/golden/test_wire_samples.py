"""Messages of every released version are still understood, or refused in words that help.

`wire/VERSION/` holds messages as that version wrote them, with what they said; they are never made
anew. `UPDATE_GOLDEN=1` writes the folder of the version at hand if there is none; a release adds
its name to `MADE`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
import wire_messages
from conductor_bench import Bench

from conductor.core.state import Config
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas import SCHEMA_VERSION, messages
from schemas.wire import control, delivery, interventions, view
from schemas.wire.codec import WireError, decode, encode
from twin.base.errors import InfrastructureError
from twin.fabric.bus import Sample
from twin.fabric.drive import SimulatorEnd, StackEnd
from twin.fabric.memory_bus import MemoryHub

MADE = ["0.1"]
HERE = Path(__file__).parent / "wire"
UNIONS: dict[str, Any] = {
    **dict.fromkeys(
        (
            *("Hello", "Next", "Beat", "Bye", "Recorded"),
            *("Submit", "Control", "Explain", "StatusRequest"),
        ),
        control.Request,
    ),
    **dict.fromkeys(("SeenFolder", "AttemptFiles"), delivery.Delivery),
}
"""Messages that travel as one of several."""


def samples() -> list[Path]:
    """Every message of every version."""
    return [path for version in MADE for path in sorted((HERE / version).glob("*.bin"))]


def type_of(name: str) -> Any:
    """What the message is decoded as."""
    modules = (messages, control, delivery, interventions, view)
    return UNIONS.get(name) or next(getattr(m, name) for m in modules if hasattr(m, name))


def said(message: Any) -> bytes:
    """A message's content, for people and diffs."""
    return msgspec.json.format(msgspec.json.encode(message), indent=1) + b"\n"


def current() -> list[Any]:
    """One message of every kind, as this version writes it."""
    planes = (wire_messages.control(), wire_messages.drive_plane())
    return [*planes[0], *planes[1], *wire_messages.view_plane(), *wire_messages.steering()]


if os.environ.get("UPDATE_GOLDEN") and not (HERE / MADE[-1]).exists():
    (HERE / MADE[-1]).mkdir(parents=True)
    for one in current():
        made = HERE / MADE[-1] / f"{type(one).__name__}.bin"
        made.write_bytes(encode(one))
        made.with_suffix(".json").write_bytes(said(one))


def test_there_is_a_sample_of_every_message() -> None:
    assert {path.stem for path in samples()} >= {type(one).__name__ for one in current()}


@pytest.mark.parametrize("path", samples(), ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_what_a_released_version_wrote_is_understood(path: Path) -> None:
    """Keys that have come since have their defaults, and are left out of the comparison."""
    expected = msgspec.json.decode(path.with_suffix(".json").read_bytes())
    found = msgspec.json.decode(said(decode(path.read_bytes(), type_of(path.stem))))
    assert expected == _only(found, expected)


def _only(found: Any, expected: Any) -> Any:
    if isinstance(found, dict) and isinstance(expected, dict):
        return {key: _only(found.get(key), expected[key]) for key in expected}
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        return [_only(one, other) for one, other in zip(found, expected, strict=True)]
    return found


@pytest.mark.parametrize("message", current(), ids=lambda message: type(message).__name__)
def test_a_newer_minor_version_adds_keys_that_are_ignored(message: Any) -> None:
    newer = {**msgpack.unpackb(encode(message)), "moon_phase": [0.5], "later": {"minor": 99}}
    assert decode(msgpack.packb(newer), type_of(type(message).__name__)) == message


@pytest.mark.parametrize("message", current(), ids=lambda message: type(message).__name__)
def test_an_older_minor_version_leaves_keys_out(message: Any) -> None:
    fields = msgspec.structs.fields(type(message))
    required = {field.encode_name for field in fields if field.required}
    plain = msgpack.unpackb(encode(message))
    tag = type(message).__struct_config__.tag_field
    older = {key: value for key, value in plain.items() if key in required or key == tag}
    found = decode(msgpack.packb(older), type_of(type(message).__name__))
    assert all(getattr(found, f.name) == getattr(message, f.name) for f in fields if f.required)


@pytest.mark.parametrize("other", [SCHEMA_VERSION - 1, SCHEMA_VERSION + 1, "2", None])
@pytest.mark.parametrize("message", current(), ids=lambda message: type(message).__name__)
def test_another_major_version_is_refused_with_both(message: Any, other: Any) -> None:
    """Also where the rest of the message would be none of ours."""
    plain = msgpack.unpackb(encode(message))
    for changed in ({**plain, "v": other}, {"v": other, "nothing": "is where it was"}):
        with pytest.raises(WireError) as caught:
            decode(msgpack.packb(changed), type_of(type(message).__name__))
        assert f"schema version {other} given" in str(caught.value)
        assert f"this side speaks {SCHEMA_VERSION}" in str(caught.value)


def _of_version(message: Any, version: int) -> bytes:
    return msgpack.packb({**msgpack.unpackb(encode(message)), "v": version})


def test_a_conductor_tells_a_worker_of_another_version() -> None:
    """The worker of the other version reads the same sentence, or says it itself."""
    engine = ConductorEngine(_Nothing(), Config(folder="/nowhere"), 0)
    (hello, *_) = wire_messages.control()
    (data,) = engine.turn([IncomingRequest(_of_version(hello, SCHEMA_VERSION + 1), 1)]).replies
    reply: control.Reply = decode(data or b"", control.Reply)
    assert f"schema version {SCHEMA_VERSION + 1} given, this side speaks" in reply.error
    assert engine.counters.refused == 1
    with pytest.raises(WireError, match=f"version {SCHEMA_VERSION + 1} given"):
        decode(_of_version(reply, SCHEMA_VERSION + 1), control.Reply)
    assert Bench().state.workers == {}


class _Nothing:
    """A journal of nothing."""

    def append(self, _facts: Any) -> None: ...

    def probe(self) -> None: ...

    def fold(self) -> list[Any]:
        return []


def test_both_ends_of_the_drive_plane_say_it() -> None:
    hub = MemoryHub()
    simulator = SimulatorEnd(hub.open(), "r", 1, None)
    (ready, tick, *_) = wire_messages.drive_plane()
    answer = msgspec.structs.replace(ready, role="stack", seen=True)
    bus = hub.open()
    bus.publish("drive/r/control/stack", _of_version(answer, SCHEMA_VERSION + 1))
    hub.deliver()
    sentence = f"schema version {SCHEMA_VERSION + 1} given, this side speaks {SCHEMA_VERSION}"
    with pytest.raises(InfrastructureError, match=sentence):
        simulator.handshake(lambda: None)
    stack = StackEnd(hub.open(), "r", 1)
    for kind, message in (("control/simulator", ready), ("tick", tick)):
        with pytest.raises(WireError, match=sentence):
            stack._take(Sample(f"drive/r/{kind}", _of_version(message, SCHEMA_VERSION + 1), b""))
