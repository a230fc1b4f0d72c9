"""Messages of the three planes, and what is done with them first."""

from __future__ import annotations

import contextlib
import itertools
import struct
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

from fuzz_target import Target

from conductor.core.facts import Committed
from conductor.serve.case_files import CaseFiles
from conductor.serve.deliveries import Deliveries
from devkit.bridges.autodrive.socketio import SocketClient, SocketError
from schemas.messages import Commands, Episode, Frame, Ready, Tick, command_mistake
from schemas.wire.case_files import CaseFilePiece
from schemas.wire.codec import ATTACHMENT_BYTES_MAX, WireError, decode
from schemas.wire.control import Reply, Request
from schemas.wire.delivery import MESSAGE_BYTES_MAX as DELIVERY_BYTES_MAX
from schemas.wire.delivery import Delivered, Delivery
from schemas.wire.interventions import ControlReply, ControlRequest
from schemas.wire.view import (
    CameraSample,
    CaseEnd,
    CaseStart,
    FeedEnd,
    PointsSample,
    RecorderBatch,
    SceneMesh,
    StateSample,
    Thumbnail,
)
from twin.base.errors import InfrastructureError
from twin.fabric.bus import Sample
from twin.fabric.drive import StackEnd
from twin.fabric.memory_bus import MemoryHub
from twin.rig.pipe import Unpacker, Upward
from twin.worker.spool import unpack
from viewer.live import mosaic
from viewer.recording import scenery

CONTROL: tuple[Any, ...] = (Request, Reply, Delivery, Delivered)
DRIVE: tuple[Any, ...] = (Ready, Tick, Episode, Frame, Commands)
VIEW: tuple[Any, ...] = (
    *(CaseStart, StateSample, CameraSample, PointsSample, SceneMesh),
    *(CaseEnd, Thumbnail, FeedEnd, RecorderBatch),
)
PART = struct.Struct("<BHH")
STEERING: tuple[Any, ...] = (ControlRequest, ControlReply)


def _chosen(types: tuple[Any, ...], then: Callable[[Any], object]) -> Callable[[bytes], object]:
    """The first byte says which message the rest should be."""

    def run(data: bytes) -> object:
        type_ = types[data[0] % len(types)] if data else types[0]
        limit = ATTACHMENT_BYTES_MAX if type_ is Frame else DELIVERY_BYTES_MAX
        return then(decode(data[1:], type_, limit))

    return run


def _commands(message: Any) -> None:
    if isinstance(message, Commands):
        for command in message.commands:
            command_mistake(command)


def _view(message: Any) -> None:
    """What a live viewer makes of it, before Rerun gets it."""
    match message:
        case SceneMesh():
            scenery.unpacked(message)
        case CaseStart():
            scenery.outline(message.stage)
            scenery.eyes(message)
        case StateSample():
            scenery.movers([message.movers])


def _stack_end(data: bytes) -> None:
    """A simulator that sends what it likes; a message is a kind, two lengths, and two bodies."""
    end = StackEnd(MemoryHub().open(), "r", 1)
    kinds = ("control/simulator", "tick", "episode", "sensor/camera")
    while len(data) >= PART.size:
        kind, payload_size, attachment_size = PART.unpack_from(data)
        body, data = data[PART.size :], data[PART.size + payload_size + attachment_size :]
        payload = body[:payload_size]
        attachment = body[payload_size : payload_size + attachment_size]
        key = f"drive/r/{kinds[kind % len(kinds)]}"
        seq = end._take(Sample(key, payload, attachment))
        if seq is not None and end._partial[seq].complete():
            end._incoming(end._partial[seq])


def _points(data: bytes) -> object:
    return scenery.points(data)


def _jpeg(data: bytes) -> object:
    return mosaic.decoded(data)


@cache
def _deliveries() -> Deliveries:
    return Deliveries(lambda _: ("", "nobody"))


def _delivery(data: bytes) -> object:
    return _deliveries().handle(data)


_FOLDER = tempfile.TemporaryDirectory(prefix="fuzz-")
_SECONDS = itertools.count()
"""As many may be asked for as come: a message a second."""


@cache
def _case_files() -> CaseFiles:
    """Of one campaign with one case, which has left a log."""
    attempt = Path(_FOLDER.name) / "cases/c1/attempt-1"
    attempt.mkdir(parents=True)
    (attempt / "log.txt").write_bytes(b"log")
    result: Any = SimpleNamespace(kpi_sha256="0" * 64)
    end = Committed(result=result, worker="w", device_class="cpu", attempt=1)
    case = SimpleNamespace(case=SimpleNamespace(id="c1"), end=end)
    campaign = SimpleNamespace(cases={"c1": case}, out=_FOLDER.name)
    engine: Any = SimpleNamespace(state=SimpleNamespace(campaigns={"c": campaign}))
    return CaseFiles(engine, Lock())


def _case_file(data: bytes) -> object:
    return _case_files().handle(data, float(next(_SECONDS)))


def _case_piece(data: bytes) -> object:
    return decode(data, CaseFilePiece)


class _Silent:
    """A connection on which nothing more comes."""

    def send(self, _text: str) -> None: ...

    def recv(self) -> str:
        raise SocketError("closed")

    def close(self) -> None: ...


@cache
def _socket() -> SocketClient:
    return SocketClient(_Silent(), pings_s=None)


def _socketio(data: bytes) -> object:
    client = _socket()
    client._take(data if data[:1] == b"\0" else data.decode("utf-8", "replace"))
    with contextlib.suppress(SocketError):
        return client.receive(0.0)
    return None


def _pipe(data: bytes) -> object:
    return Unpacker(Upward).feed(data)


REFUSED = (WireError,)
TARGETS = {
    "wire-control": Target(_chosen(CONTROL, lambda _: None), REFUSED),
    "wire-drive": Target(_chosen(DRIVE, _commands), REFUSED),
    "wire-view": Target(_chosen(VIEW, _view), (WireError, ValueError)),
    "wire-steering": Target(_chosen(STEERING, lambda _: None), REFUSED),
    "wire-stack-end": Target(_stack_end, (WireError, InfrastructureError)),
    "wire-delivery": Target(_delivery, ()),
    "wire-case-file": Target(_case_file, ()),
    "wire-case-piece": Target(_case_piece, REFUSED),
    "wire-pipe": Target(_pipe, REFUSED),
    "wire-socketio": Target(_socketio, (SocketError,)),
    "view-points": Target(_points, (ValueError,)),
    "view-jpeg": Target(_jpeg, ()),
    "spool": Target(unpack, ()),
}
