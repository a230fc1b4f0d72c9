"""The conductor of a run on several sites: started on this host, asked how it stands, and keys with
which workers join it."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from hpc.commands import start_apart
from schemas import SCHEMA_VERSION
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply, StatusRequest
from schemas.wire.rpc_routes import route_key
from schemas.wire.status import ConductorStatus
from twin.base.errors import InfrastructureError, TwinError, UnreachableError, UsageError
from twin.fabric.discovery import Target, choose_target, find_conductor, find_target
from twin.fabric.handshake import greet
from twin.fabric.keys.authority import days_left, load_authority
from twin.fabric.keys.own_keys import fabric_folder, fabric_name
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import join

LOG_NAME = "conductor.log"
"""File in the run folder for what the conductor says."""
START_S = 300.0
"""Longest wait for a conductor that starts: it may load networks [s]."""
POLL_S = 0.2
ANSWER_S = 5.0
"""Longest wait for an answer of the conductor [s]."""
TRIES = 3
KEY_DAYS = 30
"""How long the key of a site is valid [days]."""


def serving(out: Path) -> Target | None:
    """The conductor that serves ``out`` now, as a worker reaches it from here; None: none does."""
    try:
        target = find_target(out, Role.worker)
        greet(target.endpoint, target.key)
    except TwinError:
        return None
    return target


def start(out: Path, campaign: str, listen: str, history: str = "", store: str = "") -> Target:
    """Start ``conductor serve`` in the background, and wait until it listens.

    ``history``: folder of an earlier run, whose longest cases begin first; empty: none.
    ``store``: URL of its result store; empty: none.

    Raises:
        UsageError: it refuses the campaign or the folder.
        InfrastructureError: it does not start.
    """
    words = ["-m", "conductor", "serve", "--campaign", campaign, "--until-done"]
    words += ["--history", history] if history else []
    words += ["--store", store] if store else []
    log = out / LOG_NAME
    before = log.stat().st_size if log.exists() else 0
    child = start_apart(*(sys.executable, *words, "--state", str(out), "--listen", listen), log=log)
    until_s = time.monotonic() + START_S
    while time.monotonic() < until_s:
        try:
            if find_conductor(out).pid == child.pid and (target := serving(out)):
                return target
        except UsageError:
            pass
        if child.poll() is not None:
            raise _ended(child, log, before)
        time.sleep(POLL_S)
    child.terminate()
    raise InfrastructureError(f"the conductor did not start in {START_S:.0f} s; see {log}")


def _ended(child: subprocess.Popen[bytes], log: Path, before: int) -> TwinError:
    with log.open("rb") as file:
        file.seek(before)
        lines = file.read(1 << 20).decode(errors="replace").splitlines()
    said = lines[-1] if lines else f"exit code {child.returncode}"
    kind = UsageError if child.returncode == 2 else InfrastructureError
    return kind(f"the conductor did not start: {said.removeprefix('conductor: ')}")


def invitation(out: Path, connect: str, namespace: str) -> bytes:
    """A key file with which workers of one site join; withdrawn alone by ``conductor revoke``.

    Raises:
        TwinError: this user has no keys of the run.
    """
    authority = load_authority(fabric_folder(fabric_name(out)))
    days = min(KEY_DAYS, days_left(authority))
    return authority.issue(Role.worker, days, connect, namespace)


def target_of(key: Path) -> Target:
    """The conductor that an invitation names.

    Raises:
        UsageError: it is no invitation.
    """
    return choose_target("", None, "twin", key, Role.worker)


def status(target: Target) -> ConductorStatus:
    """How the conductor stands.

    Raises:
        UnreachableError: nobody answers.
    """
    greet(target.endpoint, target.key)
    bus = join(target, ANSWER_S)
    try:
        request = StatusRequest(v=SCHEMA_VERSION)
        for _ in range(TRIES):
            data = bus.request(route_key(request), encode(request), ANSWER_S)
            if data is not None:
                reply: Reply = decode(data, Reply)
                if not reply.error:
                    return reply.status
    finally:
        bus.close()
    raise UnreachableError(f"{target.endpoint}: no conductor answers")
