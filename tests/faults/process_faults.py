"""Processes that are killed, frozen or started anew."""

from __future__ import annotations

import random
import signal
from collections.abc import Iterator
from contextlib import suppress

import psutil
from fabric import TTL_S, Fabric
from kinds import Body, fault

KINDS: dict[str, tuple[str, ...]] = {
    "conductor": (),
    "worker": (),
    "simulator": (),
    "stack": (),
    "recorder": ("recorder",),
    "viewer": ("viewer",),
    "relay": ("relay",),
}
"""Kind of process -> what the fabric needs for it."""
ZONES = ("Pacific/Kiritimati", "America/St_Johns", "Asia/Kathmandu", "Pacific/Pago_Pago")


def _kill(kind: str) -> Body:
    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        victim = fabric.victim(kind, dice)
        if victim is None:
            return
        role = fabric.role_of(victim)
        if role is not None:
            role.held += 1
        with suppress(psutil.NoSuchProcess):
            victim.kill()
        yield f"SIGKILL {kind} {victim.pid}"
        if role is not None:
            role.held -= 1

    return body


def _freeze(kind: str) -> Body:
    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        victim = fabric.victim(kind, dice)
        if victim is None:
            return
        try:
            victim.send_signal(signal.SIGSTOP)
        except psutil.NoSuchProcess:
            return
        yield f"SIGSTOP {kind} {victim.pid}"
        with suppress(psutil.NoSuchProcess):
            victim.send_signal(signal.SIGCONT)

    return body


def _restart(kind: str, *, zones: bool = False) -> Body:
    """End a process in good order, if need be to start it in another time zone."""

    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        victim = fabric.victim(kind, dice)
        role = fabric.role_of(victim) if victim is not None else None
        if victim is None or role is None:
            return
        role.held += 1
        if zones:
            role.zone = dice.choice([zone for zone in ZONES if zone != role.zone])
        victim.terminate()
        yield f"SIGTERM {kind} {victim.pid} {role.zone}".rstrip()
        role.held -= 1

    return body


for _kind, _extras in KINDS.items():
    _stormy = not _extras
    fault(f"kill {_kind}", (0.0, 1.0), extras=_extras, stormy=_stormy)(_kill(_kind))
for _kind, _extras in KINDS.items():
    _stormy = not _extras
    fault(f"freeze {_kind}", (0.2, 2 * TTL_S), extras=_extras, stormy=_stormy)(_freeze(_kind))
fault("restart conductor", (0.0, 1.0), stormy=True)(_restart("conductor"))
fault("restart relay", (0.0, 1.0), extras=("relay",))(_restart("relay"))
fault("time zone of conductor", (0.0, 0.5))(_restart("conductor", zones=True))
fault("time zone of worker", (0.0, 0.5))(_restart("worker", zones=True))
