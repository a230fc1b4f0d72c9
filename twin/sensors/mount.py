"""The vehicle's own sensors as the suite runs them: their protocol, and what each is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.messages import SensorErrors
from twin.world.scene import Origin

KeyOf = Callable[[str], int]
"""Key of a random stream by its name, :func:`schemas.identity.case_stream`."""


@runtime_checkable
class Redraws(Protocol):
    """A sensor whose random numbers may be others from a moment of a case on. One that draws and
    does not say so keeps its own."""

    def redraw(self, slot: int, key: KeyOf) -> None:
        """Draw by other keys from the next reading on; whatever was drawn before stays."""


@runtime_checkable
class KeepsReading(Protocol):
    """A sensor of which slots can be saved: also one that has nothing to remember says so."""

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """What the next reading of a slot depends on beside the case, the tick and the truth."""

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with that, in a slot whose case has just begun."""


@dataclass(frozen=True, slots=True)
class SensorMount:
    """Where a rig's sensors are."""

    slots: int
    device: wp.Device
    origin: Origin
    """Of the scene's coordinates on the earth."""
    hz: int
    """Readings per second [Hz]."""
    every: int
    """Control periods between two readings."""


class Sensor(Protocol):
    """One kind of sensor, in all slots of a rig."""

    every: int
    """Control periods between two readings."""

    def __init__(self, mount: SensorMount) -> None:
        """Allocate for all slots."""

    def reset(self, slot: int, case: Case) -> None:
        """Begin a case."""

    def clear(self, slot: int) -> None:
        """Make a slot inactive."""

    def hold(self, slot: int, *, held: bool) -> None:
        """Leave a slot out of the readings, or take it in again as it was."""

    def modulate(self, slot: int, errors: SensorErrors) -> None:
        """Change the errors of a slot from the next reading on."""

    def read(self, truth: wp.array, tick: np.ndarray) -> np.ndarray:
        """Readings [S, ...] at the case ticks ``tick`` [S]; zeros where inactive."""
