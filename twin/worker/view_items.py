"""What the simulator's loop hands to the view feed: copies, ready to be encoded elsewhere.

Imports nothing heavy: the simulator opens its sessions before Warp is loaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas.messages import Command, Lease

if TYPE_CHECKING:
    from twin.engine import Finished


@dataclass(frozen=True, slots=True)
class Seen:
    """A slot at one tick, copied out of the simulator."""

    tick: int
    sim_time_ns: int
    state: np.ndarray
    """[T] of :data:`twin.vehicle.state.COLUMN`."""
    command: Command | None
    image: np.ndarray | None
    """uint8 [H, W, 3] RGB; None: no frame was due."""
    boxes: np.ndarray | None
    """float32 [B, 7] of :data:`schemas.messages.BOX_COLUMNS`, valid rows only."""


@dataclass(slots=True)
class Run:
    """An attempt in a slot; the simulator's loop hands out its running numbers."""

    lease: Lease
    recorded: bool
    samples: int = 0
    """Running numbers handed out."""
    last_tick: int = -1
    shown_s: float = 0.0
    """When the last thumbnail was asked for [s]."""

    def number(self, count: int = 1) -> int:
        """The first of ``count`` running numbers."""
        first = self.samples
        self.samples += count
        return first


@dataclass(frozen=True, slots=True)
class Began:
    """A case begins."""

    run: Run
    seq: int
    colliders: np.ndarray
    """float64 [N, 5]: x, y, yaw, half length, half width; the obstacle comes first."""
    cars: int
    """How many of the colliders are cars, the obstacle included."""


@dataclass(frozen=True, slots=True)
class Ticked:
    """A case is at a tick, commanded and not yet stepped."""

    run: Run
    seq: int
    """First running number (picture, then state); -1: for a thumbnail only."""
    seen: Seen
    thumbnail: bool


@dataclass(frozen=True, slots=True)
class Ended:
    """A case has ended."""

    run: Run
    seq: int
    """First running number (last row, then end); -1: for a thumbnail only."""
    finished: Finished | None
    """None: abandoned."""
    last_row: bool
    """The last KPI row has not been sent with a tick."""
    sim_time_ns: int
    thumbnail: bool


Item = Began | Ticked | Ended
