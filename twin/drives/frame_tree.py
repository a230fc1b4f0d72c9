"""Frames over time, of ``/tf`` and ``/tf_static``: where one is in another at a time.

Between two transforms of a frame places move evenly and turns go the shorter way (normalised linear
interpolation of quaternions); before the first and after the last those hold.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

from twin.ros2.frames import IDENTITY, Quaternion, product, yaw_of

Vector = tuple[float, float, float]

DEPTH_MAX = 64
"""Most frames between one and the root: a circle of frames has no end."""


@dataclass(frozen=True, slots=True)
class FramePlace:
    """Where something is in a frame: world = turn(local) + at."""

    at: Vector
    turn: Quaternion

    def then(self, inner: FramePlace) -> FramePlace:
        """Where ``inner``, which is placed in this, is in this one's parent."""
        x, y, z = rotated(self.turn, inner.at)
        ax, ay, az = self.at
        return FramePlace((ax + x, ay + y, az + z), product(self.turn, inner.turn))

    @property
    def heading_rad(self) -> float:
        """Left of x."""
        return yaw_of(self.turn)


HERE = FramePlace((0.0, 0.0, 0.0), IDENTITY)
"""The frame itself."""


def rotated(turn: Quaternion, place: Vector) -> Vector:
    """A turned place."""
    x, y, z, w = turn
    px, py, pz = place
    tx, ty, tz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return (
        px + w * tx + y * tz - z * ty,
        py + w * ty + z * tx - x * tz,
        pz + w * tz + x * ty - y * tx,
    )


def unit(turn: Quaternion) -> Quaternion | None:
    """A turn of length 1; None: it has none, as in messages that leave it out."""
    length = math.sqrt(sum(part * part for part in turn))
    if not 0.5 < length < 2.0:
        return None
    x, y, z, w = (part / length for part in turn)
    return x, y, z, w


@dataclass(slots=True)
class _Track:
    """A frame in its parent over time."""

    parent: str
    times: list[int] = field(default_factory=list)
    placements: list[FramePlace] = field(default_factory=list)

    def add(self, time_ns: int, placement: FramePlace) -> None:
        index = bisect.bisect_left(self.times, time_ns)
        if index < len(self.times) and self.times[index] == time_ns:
            self.placements[index] = placement
        else:
            self.times.insert(index, time_ns)
            self.placements.insert(index, placement)

    @property
    def moves(self) -> bool:
        """Whether it is not always at the same place of its parent."""
        return any(placement != self.placements[0] for placement in self.placements)

    def at(self, time_ns: int) -> FramePlace:
        index = bisect.bisect_right(self.times, time_ns)
        if index == 0:
            return self.placements[0]
        if index == len(self.times):
            return self.placements[-1]
        before, after = self.times[index - 1], self.times[index]
        return between(
            self.placements[index - 1],
            self.placements[index],
            (time_ns - before) / (after - before),
        )


def between(one: FramePlace, other: FramePlace, share: float) -> FramePlace:
    """What lies between two placements."""
    x, y, z = (a + share * (b - a) for a, b in zip(one.at, other.at, strict=True))
    sign = 1.0 if sum(a * b for a, b in zip(one.turn, other.turn, strict=True)) >= 0.0 else -1.0
    mixed = [a + share * (sign * b - a) for a, b in zip(one.turn, other.turn, strict=True)]
    turn = unit((mixed[0], mixed[1], mixed[2], mixed[3]))
    return FramePlace((x, y, z), turn or one.turn)


@dataclass(slots=True)
class FrameTree:
    """All frames of a recording."""

    tracks: dict[str, _Track] = field(default_factory=dict)

    def add(self, parent: str, child: str, time_ns: int, placement: FramePlace) -> None:
        """A transform; a frame that changes its parent is with the new one from the first."""
        track = self.tracks.get(child)
        if track is None or track.parent != parent:
            track = self.tracks[child] = _Track(parent)
        track.add(time_ns, placement)

    def times(self, child: str) -> list[int]:
        """When a frame was told of [ns]."""
        return self.tracks[child].times if child in self.tracks else []

    def root(self, frame: str) -> str:
        """The frame at the end of all parents.

        Raises:
            ValueError: they have no end.
        """
        for _ in range(DEPTH_MAX):
            if frame not in self.tracks:
                return frame
            frame = self.tracks[frame].parent
        raise ValueError(f"frames above '{frame}' go in a circle")

    def in_root(self, frame: str, time_ns: int) -> FramePlace:
        """Where a frame is in its root at a time.

        Raises:
            ValueError: its parents have no end.
        """
        placed = HERE
        for _ in range(DEPTH_MAX):
            track = self.tracks.get(frame)
            if track is None:
                return placed
            placed = track.at(time_ns).then(placed)
            frame = track.parent
        raise ValueError(f"frames above '{frame}' go in a circle")
