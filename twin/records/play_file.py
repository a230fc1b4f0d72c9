"""Reads and writes played scenarios, see :mod:`schemas.files.played_scenario`.

`twin play` writes them and the viewer reads them, so this stands where both may import it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.escape import escape
from schemas.files.played_scenario import (
    FILE_BYTES_MAX,
    LENGTH_M_MAX,
    PLAY_VERSION,
    POINTS_MAX,
    POSE_COLUMNS,
    POSES_MAX,
    STEP_S_MIN,
    TIME_S_MAX,
    PlayFile,
)
from schemas.files.regular_file import read_regular
from twin.base.errors import UsageError

Rows = NDArray[np.float64]

_FLOAT = np.dtype("<f8")

POINT_BYTES = 3 * _FLOAT.itemsize
"""Size of a point of a line [bytes]."""

POSE_BYTES = len(POSE_COLUMNS) * _FLOAT.itemsize
"""Size of a pose [bytes]."""


class _VersionOnly(msgspec.Struct):
    """The one key that all versions have."""

    version: int


def packed_rows(rows: NDArray[Any]) -> bytes:
    """An array [N, C] as the bytes of the format."""
    return np.ascontiguousarray(rows, _FLOAT).tobytes()


def points_of(data: bytes) -> Rows:
    """Points of a checked file [N, 3] [m]."""
    return np.frombuffer(data, _FLOAT).reshape(-1, 3)


def poses_of(data: bytes) -> Rows:
    """Poses of a checked file [N, 6], columns :data:`POSE_COLUMNS`."""
    return np.frombuffer(data, _FLOAT).reshape(-1, len(POSE_COLUMNS))


def write_play(path: Path, play: PlayFile) -> None:
    """Write a played scenario.

    Raises:
        UsageError: it is larger than a limit of the format, or the file cannot be written.
    """
    data = msgspec.msgpack.encode(play)
    try:
        parse_play(data)
    except ValueError as error:
        raise UsageError(f"{path}: this cannot be saved: {error}") from None
    try:
        path.write_bytes(data)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None


def read_play(path: Path) -> PlayFile:
    """Read a played scenario.

    Raises:
        UsageError: there is no such file, or it is none of this version; one line.
    """
    try:
        data = read_regular(path, FILE_BYTES_MAX)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    try:
        return parse_play(data)
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


def parse_play(data: bytes) -> PlayFile:
    """A played scenario from its bytes, with every array and index checked.

    Raises:
        ValueError: it is none; one line.
    """
    if len(data) > FILE_BYTES_MAX:
        raise ValueError(f"{len(data)} bytes, at most {FILE_BYTES_MAX} are read")
    try:
        version = msgspec.msgpack.decode(data, type=_VersionOnly).version
    except (msgspec.MsgspecError, RecursionError, ValueError):
        raise ValueError(
            "no played scenario, or a damaged one; `twin play FILE --save OUT.play` makes one"
        ) from None
    if version != PLAY_VERSION:
        raise ValueError(
            f"played scenario of version {version}, this program reads {PLAY_VERSION}; "
            "play it again"
        )
    try:
        play = msgspec.msgpack.decode(data, type=PlayFile)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ValueError(escape(f"damaged played scenario: {error}")) from None
    _check(play)
    return play


def _check(play: PlayFile) -> None:
    _check_times(play)
    _check_bodies(play)
    _check_lines(play)
    count, bodies = len(play.elements), len(play.entities)
    for number, element in enumerate(play.elements):
        if not all(0 <= actor < bodies for actor in element.actors):
            raise ValueError(f"element {number} has an actor that is no entity")
    before = 0.0
    for number, transition in enumerate(play.transitions):
        if not 0 <= transition.element < count:
            raise ValueError(f"transition {number} is of no element")
        if not before <= transition.time_s <= TIME_S_MAX:
            raise ValueError(f"transition {number} is not in the order of time")
        before = transition.time_s


def _check_times(play: PlayFile) -> None:
    for name in ("step_s", "period_s"):
        value = getattr(play, name)
        if not STEP_S_MIN <= value <= TIME_S_MAX:
            raise ValueError(f"{name} {value:g} is no time from {STEP_S_MIN:g} to {TIME_S_MAX:g} s")
    if not 0.0 <= play.end_s <= TIME_S_MAX:
        raise ValueError(f"end_s {play.end_s:g} is no time up to {TIME_S_MAX:g} s")


def _check_bodies(play: PlayFile) -> None:
    poses = 0
    for number, entity in enumerate(play.entities):
        sizes = (entity.length_m, entity.width_m, entity.height_m, *entity.centre_m)
        if not _bounded(sizes) or min(sizes[:3]) < 0.0:
            raise ValueError(f"entity {number} has no box of finite size")
        rows = _rows(entity.poses, len(POSE_COLUMNS), f"poses of entity {number}")
        poses += len(rows)
        times = rows[:, 0]
        if len(rows) and not (times[0] >= 0.0 and times[-1] <= TIME_S_MAX):
            raise ValueError(f"poses of entity {number} are not within the times of a scenario")
        if (np.diff(times) <= 0.0).any():
            raise ValueError(f"poses of entity {number} are not in the order of time")
    if poses > POSES_MAX:
        raise ValueError(f"{poses} poses, at most {POSES_MAX} are read")


def _check_lines(play: PlayFile) -> None:
    points = 0
    for number, lane in enumerate(play.lanes):
        left = _rows(lane.left, 3, f"left border of lane {number}")
        right = _rows(lane.right, 3, f"right border of lane {number}")
        if len(left) != len(right):
            raise ValueError(f"lane {number} has borders of {len(left)} and {len(right)} points")
        points += len(left) + len(right)
    for number, mark in enumerate(play.marks):
        points += len(_rows(mark.points, 3, f"mark {number}"))
        lengths = (mark.width_m, mark.stroke_m, mark.gap_m)
        if not _bounded((*lengths, mark.from_m)) or min(lengths) < 0.0:
            raise ValueError(f"mark {number} has no strokes of finite length")
    for number, line in enumerate(play.paths):
        points += len(_rows(line.points, 3, f"path {number}"))
    if points > POINTS_MAX:
        raise ValueError(f"{points} points of lines, at most {POINTS_MAX} are read")


def _rows(data: bytes, columns: int, what: str) -> Rows:
    if len(data) % (columns * _FLOAT.itemsize):
        raise ValueError(f"{what}: {len(data)} bytes are no rows of {columns} numbers")
    rows = np.frombuffer(data, _FLOAT).reshape(-1, columns)
    if len(rows) and not float(np.abs(rows).max()) <= LENGTH_M_MAX:
        raise ValueError(f"{what}: a number is not finite, or beyond {LENGTH_M_MAX:g}")
    return rows


def _bounded(values: Iterable[float]) -> bool:
    return all(math.isfinite(value) and abs(value) <= LENGTH_M_MAX for value in values)
