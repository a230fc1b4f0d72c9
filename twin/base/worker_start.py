"""Workers that `conductor run` starts before its conductor listens: what each is stands in its
arguments, and whom to serve it is told on its standard input."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Share

LOCAL_WORKER = ("worker", "-")
"""Arguments of ``python -m twin`` before a :class:`LocalWorker`."""


class LocalWorker(Struct, frozen=True, omit_defaults=True):
    """What such a worker is from its start, as JSON. Fields without words are those of
    :class:`twin.worker.options.WorkerOptions`."""

    device: str = "cpu"
    cores: str = ""
    """Processor cores, as in ``0-7,12``; empty: all."""
    load_simulator: bool = False
    """Whether a simulator and a stack load meanwhile."""
    view: ViewMode | None = None
    memory_gb: float | None = None
    join_dir: str = ""
    spool: str = ""
    handover: int = -1
    """Descriptor of a socket through which it may be handed that of the conductor's own."""


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
    handed: bool = False
    """Whether a socket of the conductor lies at :attr:`LocalWorker.handover`, by which the worker
    joins instead of ``connect``."""

    @property
    def key_path(self) -> Path | None:
        """Its key file, if it has one."""
        return Path(self.key) if self.key else None
