"""``conductor relay``: a way to the conductor for workers that cannot reach its host.

A Zenoh router of its own, e.g. on a login node: workers and viewers connect to it as they would to
the conductor, with the same key. It holds nothing; when it ends, workers keep their results until
it is back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from conductor.serve.audit import log_event
from twin.base.command import StopSignal
from twin.base.errors import TwinError, UsageError
from twin.fabric.discovery import Target, find_target
from twin.fabric.endpoint import to_listen
from twin.fabric.front.router import Fronted
from twin.fabric.keys.roles import Role
from twin.fabric.refusals import Refusals
from twin.fabric.zenoh_bus import open_bus

LOOK_S = 1.0
"""How often ``conductor.json`` is looked at for a conductor that has moved [s]."""


def relay(target: Target, listen: str, state: Path | None) -> int:
    """Pass on between ``listen`` and the conductor at ``target`` until SIGINT or SIGTERM.

    Args:
        target: the conductor, which must answer now; later it may come and go.
        listen: endpoint for those who cannot reach it.
        state: folder whose ``conductor.json`` tells where the conductor is, should it move.

    Raises:
        UsageError: the key is of another role, in which it would drop what others send.
    """
    if target.key is not None and target.key.role is not Role.conductor:
        raise UsageError(
            f"{target.key.path}: a relay passes on for all roles, so it takes a key of role "
            f"{Role.conductor}, this one is of role {target.key.role}; give --key keys/ or --state "
            "of the conductor"
        )
    stop = StopSignal()
    way = _open(target, to_listen(listen, keyed=target.key is not None))
    try:
        here = way.endpoint
        key = " --key worker.key" if target.key else ""
        print(
            f"relay to {target.endpoint} at {here}\n  worker:  twin worker --connect {here}{key}",
            flush=True,
        )
        while not stop.wait(LOOK_S):
            moved = _moved(target, state)
            if moved is not None:
                print(f"the conductor is at {moved.endpoint} now", flush=True)
                way.close()
                way, target = _open(moved, here, required=False), moved
    finally:
        way.close()
    return 0


@dataclass(frozen=True, slots=True)
class _Way:
    """Way that is open to those who cannot reach the conductor."""

    endpoint: str
    close: Callable[[], None]


def _open(target: Target, listen: str, *, required: bool = True) -> _Way:
    if target.key is not None:
        fronted = Fronted(
            listen,
            target.namespace,
            target.key,
            partial(log_event, refusals=Refusals()),
            connect=target.endpoint,
            connect_required=required,
        )
        return _Way(fronted.bus.endpoints[0], fronted.close)
    bus = open_bus(
        "router",
        listen=[listen],
        connect=[target.endpoint],
        namespace=target.namespace,
        connect_required=required,
    )
    return _Way(bus.endpoints[0], bus.close)


def _moved(target: Target, state: Path | None) -> Target | None:
    """Where the conductor is now, if that is another place; its key stays the same."""
    if state is None:
        return None
    try:
        current = find_target(state, Role.conductor, target.key.path if target.key else None)
    except TwinError:
        return None  # between two conductors
    return (
        replace(target, endpoint=current.endpoint) if current.endpoint != target.endpoint else None
    )
