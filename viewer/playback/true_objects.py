"""What moved in a recorded case, and where the ego was: the truth, for exports that ask for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.ros2.frames import of_angles
from twin.ros2.motion import TrueObject, kind_of_size
from viewer.playback.frames import MoverBox, PlayedTick, RecordedCase

_SAME_M = 1e-3
"""Boxes whose sizes differ by more are different objects [m]."""


@dataclass(frozen=True, slots=True)
class TrueTick:
    """The truth at one time."""

    objects: list[TrueObject]
    pose: tuple[float, ...] | None
    """Ego, as a row of ``POSE_COLUMNS``; None: not recorded."""
    speed_mps: float


def true_ticks(case: RecordedCase) -> dict[int, TrueTick]:
    """Truth by sim time [ns]."""
    followed = _Followed()
    return {frame.sim_time_ns: TrueTick(followed.at(frame), *_ego(frame)) for frame in case.frames}


def _ego(frame: PlayedTick) -> tuple[tuple[float, ...] | None, float]:
    speed_mps = frame.speed_mps or 0.0
    if frame.x_m is None or frame.y_m is None or frame.yaw_rad is None:
        return None, speed_mps
    turn = of_angles(frame.roll_rad or 0.0, frame.pitch_rad or 0.0, frame.yaw_rad)
    return (frame.x_m, frame.y_m, frame.z_m or 0.0, *turn), speed_mps


class _Followed:
    """Gives the boxes of one time after the other names: a recording has them in one order, in
    which those that are gone leave no gap."""

    def __init__(self) -> None:
        self._boxes: dict[str, MoverBox] = {}
        self._count = 0
        self._time_ns = 0

    def at(self, frame: PlayedTick) -> list[TrueObject]:
        """Objects of the next time."""
        before, boxes = list(self._boxes.items()), frame.movers or []
        period_s = (frame.sim_time_ns - self._time_ns) * 1e-9
        self._boxes, self._time_ns = {}, frame.sim_time_ns
        found = []
        for box in boxes:
            place = _nearest(box, before)
            if place is None:
                self._count += 1
                name, speed_mps = f"object_{self._count}", 0.0
            else:
                name, last = before.pop(place)
                speed_mps = _along(last, box) / period_s if period_s > 0.0 else 0.0
            self._boxes[name] = box
            kind = kind_of_size(box.size_m)
            found.append(
                TrueObject(name, kind, box.position_m, box.rotation, box.size_m, speed_mps)
            )
        return found


def _nearest(box: MoverBox, before: list[tuple[str, MoverBox]]) -> int | None:
    """Place of the box that it was, of those of its size; the order decides between equals."""
    fitting = [
        (math.dist(box.position_m, other.position_m), place)
        for place, (_, other) in enumerate(before)
        if math.dist(box.size_m, other.size_m) < _SAME_M
    ]
    return min(fitting)[1] if fitting else None


def _along(last: MoverBox, box: MoverBox) -> float:
    """Way along its own x [m]."""
    x, y, z, w = box.rotation
    ahead = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    moved = [now - then for now, then in zip(box.position_m, last.position_m, strict=True)]
    return sum(a * m for a, m in zip(ahead, moved, strict=True))
