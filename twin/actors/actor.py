"""One object of a scene's script, and what a case may vary of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.actors.path import Path, TimeLaw


@dataclass(frozen=True, slots=True)
class Actor:
    """One object of a script."""

    path: Path | None
    """Path of the object; None: it stands."""
    law: TimeLaw | None
    start_s: float
    loop: bool
    repeat_s: float
    """0: once."""
    present: bool
    """Whether it is also there before its start and after its end."""
    pose: tuple[float, float, float, float]
    """x, y, z [m] and yaw [rad] of one that stands."""
    kind: int
    """Kind of it standing, and the first of its phases."""
    phases: int
    """Number of kinds, after the first, that show it moving; 0: one kind for all."""
    way_m: float
    """Way in which all phases pass once."""
    vehicle: bool
    """Whether it is a vehicle and has lamps."""
    name: str = ""
    """Name in the scene; empty: it has none."""
    speed_mps: float | None = None
    """All the way; None: it stands, or its speed changes."""

    def pace_of(self, speed_mps: float | None) -> float:
        """Factor of its speed at another speed; None: its own.

        Raises:
            ValueError: it has no even speed, or would be slower than it is repeated; one line.
        """
        if speed_mps is None:
            return 1.0
        if self.speed_mps is None or self.law is None:
            raise ValueError("speed_mps: in the scene it has no speed_mps of its own")
        pace = speed_mps / self.speed_mps
        takes_s = float(self.law.time_s[-1]) / pace
        if self.repeat_s and self.repeat_s < takes_s:
            raise ValueError(
                f"speed_mps {speed_mps:g}: the way takes {takes_s:.1f} s, longer than the scene's "
                f"repeat_s {self.repeat_s:g}"
            )
        return pace

    def started(self, start_s: float) -> float:
        """When it sets off, if that can be chosen.

        Raises:
            ValueError: it stands; one line.
        """
        if self.law is None:
            raise ValueError("start_s: it has one waypoint in the scene and stands there")
        return start_s

    def sideways(self, offset_m: float) -> tuple[float, float]:
        """World x and y so far to the left of the direction in which it sets off [m]."""
        yaw = self.pose[3] if self.path is None else float(self.path.start[0, 2])
        return -math.sin(yaw) * offset_m, math.cos(yaw) * offset_m
