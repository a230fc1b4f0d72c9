"""Somebody in a process of his own, with a worker's key where one is needed, who wants the verdicts
of others: every way to commit, to speak for a worker, and to bring files."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from schemas import SCHEMA_VERSION as V
from schemas.files.recording import RecordingObject
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import (
    Beat,
    Bye,
    Ended,
    Hello,
    Next,
    Recorded,
    Reply,
    Request,
    Result,
    Sealed,
    StatusRequest,
)
from schemas.wire.delivery import AttemptFiles, Delivered, SeenFolder, files_sha256
from schemas.wire.rpc_routes import route_key
from twin.base.software import software_digest
from twin.fabric.bus import Bus
from twin.fabric.discovery import choose_target
from twin.fabric.keys.roles import Role
from twin.fabric.session import new_secret, seal
from twin.fabric.zenoh_bus import join

TIMEOUT_S = 10.0
GUESSES = 8
"""Tokens count up from the epoch's first."""


def attack(folder: Path) -> dict[str, str]:
    """Go for every case that runs at the conductor of ``folder``: how each way ended."""
    bus = join(choose_target("", folder, "twin", None, Role.worker), TIMEOUT_S)
    try:
        return _attack(bus)
    finally:
        bus.close()


def _attack(bus: Bus) -> dict[str, str]:
    session, me = new_secret(), f"thief-{new_secret().hex()[:8]}"
    own = Hello(V, me, "h", 1, "cpu:test", software_digest(), 1, session=session)
    assert not _ask(bus, own).error
    state = _ask(bus, StatusRequest(V, running=True))
    found: dict[str, str] = {}
    for number, row in enumerate(state.status["running"], start=1):
        case, victim = (row["campaign"], row["case"]), row["worker"]
        tokens = [(state.epoch << 32) + n for n in range(1, GUESSES + 1)]
        files = f"cases/{row['case']}/attempt-{row['attempt']}"
        forged = [
            Result(*case, t, "verdict", "pass", attempt_dir=files, kpi_sha256="0" * 64)
            for t in tokens
        ]
        given_up = [Ended(*case, token, "crash", "stolen") for token in tokens]
        sealed = [Sealed(r.token, victim, encode(r), seal(session, encode(r))) for r in forged]
        held = dict.fromkeys(map(str, tokens), 10**6)
        film = RecordingObject("0" * 64, 1, True)
        seq = 10 * number
        requests: dict[str, Request] = {
            "commit": Next(V, me, seq, 0, results=forged, session=session),
            "commit sealed": Next(V, me, seq + 1, 0, sealed=sealed, session=session),
            # What is given back is not answered: held tokens of others are lost, in any case.
            "give back": Next(V, me, seq + 2, 0, ended=given_up, held=tokens, session=session),
            "beat": Beat(V, me, held, session=session),
            "commit as the worker": Next(V, victim, 2**40, 0, results=forged, session=session),
            "commit without a secret": Next(V, victim, 2**40, 0, results=forged),
            "beat as the worker": Beat(V, victim, held, session=session),
            "leave as the worker": Bye(V, victim, session=session),
            "record": Recorded(V, me, *case, tokens[0], film, session),
            "record as the worker": Recorded(V, victim, *case, tokens[0], film, session),
            "join as the worker": Hello(
                *(V, victim, "h", 1, "cpu:test", software_digest(), 1), session=session
            ),
        }
        for what, request in requests.items():
            found[f"{what} {row['case']}"] = _outcome(_ask(bus, request), tokens)
        kpi, log = b"forged", b"forged"
        sent = AttemptFiles(V, *case, row["attempt"], kpi, log, files_sha256(kpi, log))
        seen = SeenFolder(V, row["campaign"], "0" * 64)
        for name, how in ((me, ""), (victim, " as the worker")):
            for what, message in (("files", sent), ("folder", seen)):
                told = _sent(bus, message, name, session)
                found[f"{what}{how} {row['case']}"] = "TAKEN" if told.ok else "refused"
    _ask(bus, Bye(V, me, session=session))
    return found


def _outcome(reply: Reply, tokens: list[int]) -> str:
    if reply.error:
        return "refused"
    return "fenced" if tokens in (reply.fenced, reply.lost) else "TAKEN"


def _ask(bus: Bus, request: Request) -> Reply:
    data = bus.request(route_key(request), encode(request), TIMEOUT_S)
    assert data is not None, "no answer"
    return decode(data, Reply)


def _sent(bus: Bus, message: AttemptFiles | SeenFolder, worker: str, session: bytes) -> Delivered:
    named = replace(message, worker=worker, session=session)
    data = bus.request(topics.FILES.key, encode(named), TIMEOUT_S)
    assert data is not None, "no answer"
    return decode(data, Delivered)
