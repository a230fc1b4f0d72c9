"""A conductor on a thread over an in-memory bus, and statuses as it would give them."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from waiting import PATIENCE_S

from conductor.serve.shell import Conductor
from twin.fabric.memory_bus import MemoryHub


@contextlib.contextmanager
def running_hub() -> Iterator[MemoryHub]:
    """A hub that delivers by itself."""
    hub = MemoryHub()
    thread = hub.run()
    try:
        yield hub
    finally:
        hub.stop()
        thread.join()


@contextlib.contextmanager
def serving(folder: Path, hub: MemoryHub, **options: Any) -> Iterator[Conductor]:
    """A conductor that serves ``folder`` on ``hub``."""
    conductor = Conductor(folder, bus_factory=lambda *_: hub.open(), **options)
    thread = threading.Thread(target=conductor.serve, daemon=True)
    thread.start()
    assert conductor.started.wait(PATIENCE_S)
    try:
        yield conductor
        assert thread.is_alive(), "the loop died"
    finally:
        conductor.stop()
        thread.join(PATIENCE_S)


def row(cases: int = 16, left: int = 16, **fields: Any) -> dict[str, Any]:
    """A campaign's row of a status."""
    others = ("leased", "not_passed", "failed", "unresolved", "cancelled", "attempts")
    counts = {"cases": cases, "waiting": left, "left": left, "passed": cases - left}
    return {"out": "/out", "disagreements": 0, **dict.fromkeys(others, 0), **counts, **fields}


def found(**rows: dict[str, Any]) -> dict[str, Any]:
    """A status."""
    left = sum(each["left"] for each in rows.values())
    return {"epoch": 1, "left": left, "campaigns": rows, "workers": [], "notes": []}
