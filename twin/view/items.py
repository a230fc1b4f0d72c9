"""Items that the simulator's loop hands to the view: copies, ready to be encoded elsewhere.

Imports nothing heavy: the simulator opens its sessions before Warp is loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from schemas.messages import CameraSite, Command, LidarSite
from schemas.wire.control import Lease
from twin.view.quality import Quality

if TYPE_CHECKING:
    from twin.rig.slot import Finished
    from twin.world.street.build import World


@dataclass(frozen=True, slots=True)
class SlotSeen:
    """A slot at one tick, copied out of the simulator."""

    tick: int
    sim_time_ns: int
    state: np.ndarray
    """[T] of :data:`twin.vehicle.state.COLUMN`."""
    command: Command | None
    image: np.ndarray | None
    """uint8 [H, W, 3] RGB of the main camera; None: no frame was due, or nobody wants it."""
    boxes: np.ndarray | None
    """float32 [B, 7] of :data:`schemas.messages.BOX_COLUMNS`, valid rows only."""
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    """Pictures of further cameras by message name; like ``image``."""
    clouds: dict[str, Cloud] = field(default_factory=dict)
    """LiDAR points by message name."""
    grids: dict[str, np.ndarray] = field(default_factory=dict)
    """Grids that are drawn as pictures by message name, as their sensors declare them."""
    label: str = ""
    """See :attr:`SlotRun.label`."""
    at_s: float | None = None
    """When the simulator was there, by the rig's clock [s]; None: nobody asked."""
    target: bool = True
    """Something stands in the lane, to which the state's distance is measured."""
    nearest: tuple[float | None, float | None] | None = None
    """Distance [m] and time [s] to collision of a case that is about whatever is nearest; None: it
    is about its target."""
    movers: np.ndarray | None = None
    """float64 [M, 9]: world x, y, z, yaw, half length, half width, height, pitch, roll."""
    readings: dict[str, np.ndarray] = field(default_factory=dict)
    """Readings of the sensors with a row of numbers that were due, by message name [K]."""
    rows: dict[str, np.ndarray] = field(default_factory=dict)
    """Valid rows of the sensors that are drawn as points and were due, by message name [N, K]."""

    @property
    def nbytes(self) -> int:
        """Bytes of the large arrays."""
        arrays = [*self.pictures.values(), *(cloud.points for cloud in self.clouds.values())]
        arrays += [*self.rows.values(), *self.grids.values()]
        return sum(a.nbytes for a in (self.image, *arrays) if a is not None)


@dataclass(frozen=True, slots=True)
class Cloud:
    """A lidar's sweep, thinned."""

    points: np.ndarray
    """float32 [N, K] of :data:`schemas.sections.lidar.POINT_COLUMNS`; NaN: no return."""
    stride: int
    """Every so many rays."""


@dataclass(slots=True)
class SlotRun:
    """An attempt in a slot; the simulator's loop hands out its running numbers."""

    lease: Lease
    recorded: bool
    target: int | None = None
    """Collider that its scenario is about; None: there is none."""
    samples: int = 0
    """Running numbers handed out."""
    last_tick: int = -1
    shown_s: dict[str, float] = field(default_factory=dict)
    """Times at which streams for viewers were last due, by name [s]."""
    label: str = ""
    """State that an intervention has left it in: ``by hand``, ``paused``, ``steered``."""

    qualities: dict[str, Quality] = field(default_factory=dict)
    """Qualities of its cameras' pictures by message name; only the view's thread looks at them."""

    def number(self, count: int = 1) -> int:
        """The first of ``count`` running numbers."""
        first = self.samples
        self.samples += count
        return first


@dataclass(frozen=True, slots=True)
class Began:
    """A case begins."""

    run: SlotRun
    seq: int
    colliders: np.ndarray
    """float64 [N, 5]: x, y, yaw, half length, half width."""
    cars: int
    """How many of the first colliders are cars."""


@dataclass(frozen=True, slots=True)
class Scenery:
    """Static surroundings of a case that a viewer has just begun to look at."""

    run: SlotRun
    rig: str
    world: World
    cameras: list[CameraSite]
    lidars: list[LidarSite]


@dataclass(frozen=True, slots=True)
class Ticked:
    """A case is at a tick, commanded and not yet stepped."""

    run: SlotRun
    seq: int
    """First running number (picture, then state); -1: for viewers only."""
    snapshot: SlotSeen
    due: frozenset[str] = frozenset()
    """Streams that viewers are to get, see :mod:`twin.view.demand`."""


@dataclass(frozen=True, slots=True)
class ShownEnd:
    """A case has ended."""

    run: SlotRun
    seq: int
    """First running number (last row, then end); -1: for viewers only."""
    finished: Finished | None
    """End of the attempt; None: it was abandoned."""
    last_row: bool
    """The last KPI row has not been sent with a tick."""
    sim_time_ns: int
    at_s: float | None = None
    """When it ended, by the rig's clock [s]."""
    thumbnail: bool = False
    live: bool = False
    """A viewer looks at this case alone."""


@dataclass(frozen=True, slots=True)
class WorldRequest:
    """A viewer asks for the standing world."""

    world: World
    respond: Callable[[bytes], None]


Item = Began | Scenery | Ticked | ShownEnd | WorldRequest
