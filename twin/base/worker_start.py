"""Workers that `conductor run` starts before its conductor listens, and their stacks: they load,
and are told on their standard input whom to serve."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from schemas.wire.control import Share


class WorkerStart(Struct, frozen=True):
    """Message that such a worker is sent, on one line of JSON."""

    connect: str
    """The conductor's endpoint; plain TCP only if somebody typed ``--insecure``."""
    slots: int
    """Cases simulated together."""
    key: str = ""
    """Path of its key file; empty: none."""
    log: str = ""
    """File to which it writes from then on; empty: where it did before."""
    share: Share | None = None
    """Cases that the worker prefers, where several work side by side; None: any."""

    @property
    def key_path(self) -> Path | None:
        """Its key file, if it has one."""
        return Path(self.key) if self.key else None
