"""The object store that has results and journal, and the loss of a conductor with its folder."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from contextlib import suppress

import psutil
from fabric import Fabric
from kinds import Body, fault

SHARES = {
    "timeouts of the store": {"timeout": 0.3},
    "store answers 503": {"503": 0.5},
    "partial writes of the store": {"partial write": 0.5},
    "store away": {"down": True},
}
"""Row -> share of the requests that it befalls."""


def _broken(name: str) -> Body:
    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        fabric.break_store(SHARES[name])
        yield name
        fabric.break_store({})

    return body


for _name in SHARES:
    fault(_name, (2.0, 5.0), extras=("store",), group="store")(_broken(_name))


@fault("conductor lost with its folder", (0.0, 0.5), extras=("store",), group="store")
def conductor_lost(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """The conductor dies, and nothing of its state folder is left: another takes over."""
    return _lost(fabric, dice, {})


@fault("stale listings at a takeover", (25.0, 30.0), extras=("store",), group="store")
def stale_listings(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """The same, and listings show what was there long before."""
    return _lost(fabric, dice, {"stale listing": 1.0})


@fault("takeover from a store that breaks", (25.0, 30.0), extras=("store",), group="store")
def broken_takeover(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """The same, while a tenth of the requests time out, are refused, or written in part."""
    return _lost(fabric, dice, {"timeout": 0.1, "503": 0.1, "partial write": 0.1})


def _lost(fabric: Fabric, dice: random.Random, shares: dict[str, float]) -> Iterator[str]:
    victim = fabric.victim("conductor", dice)
    role = fabric.role_of(victim) if victim is not None else None
    if victim is None or role is None or role.child is None:
        return
    role.held += 1
    with suppress(psutil.NoSuchProcess):
        victim.kill()
    role.child.wait()
    for path in fabric.state.iterdir():  # the folder itself is where workers have one of theirs
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    fabric.break_store(shares)
    role.held -= 1
    yield f"SIGKILL conductor {victim.pid}, its folder removed {shares or ''}".rstrip()
    fabric.break_store({})
