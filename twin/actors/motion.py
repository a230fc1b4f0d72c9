"""Movable objects of a scene: kinds with a mesh, and where each object is at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from twin.world.meshes.mesh import Mesh

if TYPE_CHECKING:
    from twin.actors.actor import Actor
    from twin.actors.variations import Variations


@dataclass(frozen=True, slots=True)
class ObjectKind:
    """A movable thing, or one phase of it (a step of a walk)."""

    name: str
    mesh: Mesh
    """Own axes: x forward, z up, origin on the ground below the hull's centre [m]."""
    half_length_m: float
    half_width_m: float


@dataclass(frozen=True, slots=True)
class Placement:
    """Places of the M objects of S slots; a function of the slots' times alone."""

    kind: np.ndarray
    """int32 [S, M], index of the kind; -1: not there."""
    position_m: np.ndarray
    """float64 [S, M, 3], world."""
    yaw_rad: np.ndarray
    """float64 [S, M]"""
    velocity_mps: np.ndarray
    """float64 [S, M, 3], world."""
    yaw_rate_radps: np.ndarray
    """float64 [S, M]"""
    brake: np.ndarray
    """float32 [S, M], brake lamps 0 or 1."""
    lamps: np.ndarray
    """float32 [S, M], head and tail lamps 0 or 1; who calls decides whether it is dark."""
    half_m: np.ndarray | None = None
    """float64 [S, M, 2], half length and half width of each; None: those of the kinds."""
    class_index: np.ndarray | None = None
    """int32 [S, M], index into :data:`schemas.messages.OBJECT_CLASSES` of objects that are another
    thing in every slot; None: the world says what each is."""
    lights: np.ndarray | None = None
    """int32 [S, M], bit of each :class:`twin.actors.lamps.VehicleLamp` that is on whatever the
    hour; None: none is."""
    pitch_rad: np.ndarray | None = None
    """float64 [S, M], about the axis to the left after the yaw, nose down positive; None, like
    :attr:`roll_rad`: all stand level."""
    roll_rad: np.ndarray | None = None
    """float64 [S, M], about the forward axis after the pitch, to the right positive."""
    signals: np.ndarray | None = None
    """int32 [S, K], lamps that are on of each traffic light of :attr:`World.signals`: bit 0 red, 1
    amber, 2 green; None: as before."""

    def hulls(self, sizes_m: np.ndarray) -> np.ndarray:
        """What vehicles may hit of it [S, M, 8], :data:`twin.vehicle.kernel.MOVER_COLUMNS`.

        Args:
            sizes_m: half length and half width of each kind [K, 2].
        """
        hulls = np.zeros((*self.kind.shape, 8))
        if hulls.size:
            half_m = sizes_m[self.kind] if self.half_m is None else self.half_m
            hulls[..., 0:2] = self.position_m[..., :2]
            hulls[..., 2] = self.yaw_rad
            hulls[..., 3:5] = half_m * (self.kind >= 0)[..., None]
            hulls[..., 5:7] = self.velocity_mps[..., :2]
            hulls[..., 7] = self.yaw_rate_radps
        return hulls


class Motion(Protocol):
    """The script of all movable objects."""

    count: int
    """Number of objects M."""
    actors: Sequence[Actor]
    """What the scene says of each object [M]."""

    @property
    def standing(self) -> np.ndarray:
        """int32 [M]: kind of each object as it stands."""

    def at(self, time_s: np.ndarray, varied: Variations | None = None) -> Placement:
        """Places of all objects at the sim times ``time_s`` [S]; None: as the scene says."""


class InterventionTarget(Protocol):
    """What moves the objects of slots that say themselves what an intervention does to them."""

    def act(self, slot: int, action: Any) -> int:
        """Carry out an action; the object it was done to.

        Raises:
            ValueError: it cannot be done; one line.
        """

    def moved(self, slot: int) -> frozenset[int]:
        """Objects that an intervention has taken off."""

    def hulls(self) -> np.ndarray:
        """What vehicles may hit now [S, M, 8], :data:`twin.vehicle.kernel.MOVER_COLUMNS`."""


class Still:
    """Nothing moves."""

    count = 0
    actors: Sequence[Actor] = ()
    standing = np.zeros(0, np.int32)

    def at(
        self,
        time_s: np.ndarray,
        varied: Variations | None = None,  # noqa: ARG002 - there is nothing to vary
    ) -> Placement:
        """See :class:`Motion`."""
        empty = np.zeros((len(time_s), 0))
        vectors = np.zeros((len(time_s), 0, 3))
        flags = empty.astype(np.float32)
        return Placement(empty.astype(np.int32), vectors, empty, vectors, empty, flags, flags)
