"""A recorded drive as plain arrays: where the ego was, and what was seen around it.

Times are seconds from the ego's first pose. Places are in one frame of the recording, metres, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import Struct

from twin.world.apart.checks import Array, ListOf, Record, Text

KINDS = (
    *("car", "van", "truck", "trailer", "bus", "motorcycle", "bicycle", "pedestrian"),
    *("child", "animal", "obstacle"),
)
"""Kinds of objects, those of scenario files."""

OBJECTS_MAX = 5_000
"""Most objects of a recorded drive."""
POSES_MAX = 1_000_000
"""Most poses of one object, or of the ego."""
SIZE_MAX_M = 40.0
"""Largest length, width or height of an object [m]."""
COORDINATE_MAX_M = 1e8
"""Largest coordinate: a projection of the earth [m]."""
TOPICS_MAX = 500
"""Most topics that are told."""
NAME_CHARS_MAX = 200
"""Longest name [characters]."""

POSE = ("time_s", "x_m", "y_m", "z_m", "heading_rad")
"""Columns of poses."""


class DriveQuestion(Struct, frozen=True, forbid_unknown_fields=True):
    """What is looked for in a recording."""

    ego: str = ""
    """Topic of odometry, or a frame; empty: chosen."""
    objects: str = ""
    """Topic of objects, or the beginning of the names of frames, with ``*``; empty: chosen."""


@dataclass(frozen=True, slots=True)
class DrivenObject:
    """Something that was seen."""

    name: str
    kind: str
    size_m: np.ndarray
    """Length, width, height, float64 [3]; 0: not known."""
    poses: np.ndarray
    """Of the middle of its box, float64 [N, 5] by :data:`POSE`; times rise."""


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """What a recording holds."""

    ego_source: str
    """Topic or frame of the ego's poses."""
    objects_source: str
    """Topic or frames of the objects; empty: there are none."""
    frame: str
    """Frame of all places."""
    ego: np.ndarray
    """Of the ego's reference point, float64 [N, 5] by :data:`POSE`; times rise from 0."""
    objects: list[DrivenObject]
    topics: list[str]
    """Topics of the recording with type and number of messages, for people."""
    notes: list[str]
    """What was left out, and why."""


_POSES = Array("float64", ("poses", len(POSE)), side_max=POSES_MAX)

DRIVE_CHECK = Record(
    RecordedDrive,
    {
        "ego_source": Text(NAME_CHARS_MAX),
        "objects_source": Text(NAME_CHARS_MAX),
        "frame": Text(NAME_CHARS_MAX),
        "ego": _POSES,
        "objects": ListOf(
            Record(
                DrivenObject,
                {
                    "name": Text(NAME_CHARS_MAX),
                    "kind": Text(allowed=KINDS),
                    "size_m": Array("float64", (3,)),
                    "poses": _POSES,
                },
            ),
            OBJECTS_MAX,
        ),
        "topics": ListOf(Text(3 * NAME_CHARS_MAX), TOPICS_MAX),
        "notes": ListOf(Text(3 * NAME_CHARS_MAX), TOPICS_MAX),
    },
)
"""What the process that reads a recording may answer."""


def drive_mistake(drive: RecordedDrive) -> str:
    """What is wrong with a drive that a reader answered, or an empty string."""
    for name, poses in (("ego", drive.ego), *((o.name, o.poses) for o in drive.objects)):
        if len(poses) == 0:
            return f"{name}: no poses"
        if (np.diff(poses[:, 0]) <= 0.0).any():
            return f"{name}: times do not rise"
        if not (np.abs(poses[:, 1:4]) <= COORDINATE_MAX_M).all():
            return f"{name}: a coordinate beyond {COORDINATE_MAX_M:g} m"
        if not (np.abs(poses[:, 4]) <= 1e6).all() or not (np.abs(poses[:, 0]) <= 1e9).all():
            return f"{name}: a heading or time out of range"
    for each in drive.objects:
        if not ((each.size_m >= 0.0) & (each.size_m <= SIZE_MAX_M)).all():
            return f"{each.name}: a size out of range"
    return ""
