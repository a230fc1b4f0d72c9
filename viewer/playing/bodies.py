"""Bodies of a played scenario as Rerun draws them: boxes, names, trails and speeds over time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import rerun as rr

from schemas.escape import escape
from schemas.files.played_scenario import PlayEntity, PlayFile
from twin.records.play_file import poses_of
from viewer.playing import paths
from viewer.recording.rows import EntityRows
from viewer.recording.scenery import Color, Logged

NAME_CHARS = 40
"""Longest name beside a body [characters]."""
_NAME_BELOW = 0.012
"""Distance of a name from its body, as a share of the height of the eye."""
_STAGGER = 0.055
"""By so much more for every second and third name: those of neighbours stay legible."""
_LINE_M = 0.12
"""Half of the width of lines on a roof [m]."""
_EGO_ABOVE = 0.075
"""Distance of the ego's name above it, likewise."""
_SMALL_M = 2.5
"""Smaller bodies have a dot that stays visible from far away [m]."""
_TRAIL_LIFT_M = np.array([0.0, 0.0, 0.08])
_WHITE: Color = (255, 255, 255)


def styles(play: PlayFile) -> list[Logged]:
    """Names and colours of the plots; logged without a time."""
    looks = zip(play.entities, paths.entity_names(play), paths.entity_colors(play), strict=True)
    return [
        (
            f"{paths.SPEEDS}/{name}",
            rr.SeriesLines(
                names=escape(entity.name, NAME_CHARS),
                colors=[color],
                widths=3.0 if entity.ego else 1.5,
            ),
        )
        for entity, name, color in looks
    ]


def bodies(play: PlayFile, origin_m: np.ndarray) -> Iterator[EntityRows]:
    """Rows of all entities; places are moved by ``-origin_m``."""
    looks = zip(play.entities, paths.entity_names(play), paths.entity_colors(play), strict=True)
    for number, (entity, name, color) in enumerate(looks):
        poses = poses_of(entity.poses)
        if not len(poses):
            continue
        places = poses[:, 1:4] - origin_m
        yield from _body(play, entity, f"{paths.ENTITIES}/{name}", color, poses, places)
        yield from _name(play, number, f"{paths.NAMES}/{name}", color, places)
        yield _rows(
            play,
            f"{paths.SPEEDS}/{name}",
            poses[:, 0],
            rr.Scalars.columns(scalars=poses[:, 5]),
        )
        yield from _trail(play, entity, f"{paths.TRAILS}/{name}", color, poses, places)
        if number == paths.followed(play):
            yield _rows(play, paths.CENTRE, poses[:, 0], rr.Transform3D.columns(translation=places))


def presences(poses: np.ndarray, period_s: float) -> list[tuple[int, int]]:
    """First row, and the one after the last, of every time in which an entity was there."""
    breaks = np.flatnonzero(np.diff(poses[:, 0]) > 1.5 * period_s) + 1
    edges = [0, *breaks.tolist(), len(poses)]
    return list(itertools.pairwise(edges)) if len(poses) else []


def kept_period_s(play: PlayFile) -> float:
    """Time between two poses of a body that stays; longer than told where poses were thinned."""
    steps = [
        float(np.diff(times).min())
        for entity in play.entities
        if len(times := poses_of(entity.poses)[:, 0]) > 1
    ]
    return max(play.period_s, min(steps, default=0.0))


def vanishings(play: PlayFile, poses: np.ndarray, period_s: float) -> list[float]:
    """Times at which an entity is no longer there, before the end [s]."""
    lasts = [float(poses[end - 1, 0]) for _, end in presences(poses, period_s)]
    return [last + period_s for last in lasts if last + 1.5 * period_s < play.end_s]


def _body(
    play: PlayFile,
    entity: PlayEntity,
    path: str,
    color: Color,
    poses: np.ndarray,
    places: np.ndarray,
) -> Iterator[EntityRows]:
    half_turn, level = 0.5 * poses[:, 4], np.zeros(len(poses))
    turns = np.stack([level, level, np.sin(half_turn), np.cos(half_turn)], axis=-1)
    columns = rr.Transform3D.columns(translation=places, quaternion=turns)
    yield _rows(play, path, poses[:, 0], columns)
    period_s = kept_period_s(play)
    begins = poses[[first for first, _ in presences(poses, period_s)], 0]
    count = len(begins)
    half = [max(size, 0.05) / 2 for size in (entity.length_m, entity.width_m, entity.height_m)]
    box = rr.Boxes3D.columns(
        centers=[entity.centre_m] * count,
        half_sizes=[half] * count,
        colors=[color] * count,
        fill_mode=[rr.components.FillMode.Solid] * count,
        show_labels=[False] * count,
    )
    yield _rows(play, f"{path}/body", begins, box)
    lines = [_nose(entity)] + ([_outline(entity)] if entity.ego else [])
    drawn = rr.LineStrips3D.columns(
        strips=lines * count,
        colors=[_WHITE if entity.ego else (20, 22, 28)] * (len(lines) * count),
        radii=[_LINE_M] * (len(lines) * count),
    )
    yield _rows(play, f"{path}/front", begins, drawn.partition([len(lines)] * count))
    if max(entity.length_m, entity.width_m) < _SMALL_M:
        dot = rr.Points3D.columns(
            positions=[(0.0, 0.0, entity.height_m + 0.1)] * count,
            radii=[rr.Radius.ui_points(4.0)] * count,
            colors=[color] * count,
        )
        yield _rows(play, f"{path}/dot", begins, dot)
    yield from _cleared(play, [f"{path}/{part}" for part in ("body", "front", "dot")], poses)


def _name(
    play: PlayFile, number: int, path: str, color: Color, places: np.ndarray
) -> Iterator[EntityRows]:
    """The name below a body as the views see it, however the body is turned."""
    entity = play.entities[number]
    poses = poses_of(entity.poses)
    eye_m, right = paths.eye_height_m(play), paths.right_rad(play)
    turn = poses[:, 4] - right
    x, y, z = entity.centre_m
    reach = 0.5 * (
        entity.length_m * np.abs(np.sin(turn)) + entity.width_m * np.abs(np.cos(turn))
    ) - (x * np.sin(turn) + y * np.cos(turn))
    below = reach + eye_m * (_NAME_BELOW + _STAGGER * (number % 3))
    if entity.ego:  # alone above: there it covers nobody who is parked beside its lane
        below = reach - entity.width_m - eye_m * _EGO_ABOVE
    at = places + np.stack(
        [below * math.sin(right), -below * math.cos(right), np.full(len(below), z)], axis=-1
    )
    yield _rows(play, path, poses[:, 0], rr.Transform3D.columns(translation=at))
    begins = poses[[first for first, _ in presences(poses, kept_period_s(play))], 0]
    count = len(begins)
    label = rr.Points3D.columns(
        positions=[(0.0, 0.0, 0.0)] * count,
        radii=[rr.Radius.ui_points(0.1)] * count,
        colors=[color] * count,
        labels=[escape(entity.name, NAME_CHARS)] * count,
        show_labels=[True] * count,
    )
    yield _rows(play, f"{path}/label", begins, label)
    yield from _cleared(play, [f"{path}/label"], poses)


def _cleared(play: PlayFile, parts: list[str], poses: np.ndarray) -> Iterator[EntityRows]:
    gone = np.array(vanishings(play, poses, kept_period_s(play)))
    for part in parts:
        if len(gone):
            cleared = rr.Clear.columns(is_recursive=[False] * len(gone))
            yield _rows(play, part, gone, cleared)


def _nose(entity: PlayEntity) -> list[list[float]]:
    """A wedge on the roof that shows where the front is."""
    x, y, z = entity.centre_m
    tip, back = x + 0.46 * entity.length_m, x + 0.22 * entity.length_m
    side, top = 0.4 * entity.width_m, z + 0.5 * entity.height_m + 0.05
    return [[back, y - side, top], [tip, y, top], [back, y + side, top]]


def _outline(entity: PlayEntity) -> list[list[float]]:
    """A frame around the roof."""
    x, y, z = entity.centre_m
    length, width = 0.5 * entity.length_m + 0.1, 0.5 * entity.width_m + 0.1
    top = z + 0.5 * entity.height_m + 0.05
    corners = [(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]
    return [[x + i * length, y + j * width, top] for i, j in corners]


def _trail(
    play: PlayFile,
    entity: PlayEntity,
    path: str,
    color: Color,
    poses: np.ndarray,
    places: np.ndarray,
) -> Iterator[EntityRows]:
    """A short line per row, from the row before; the view shows all up to its time."""
    pairs = np.stack([places[:-1], places[1:]], axis=1) + _TRAIL_LIFT_M
    whole = np.diff(poses[:, 0]) <= 1.5 * kept_period_s(play)
    moved = whole & (np.abs(pairs[:, 1] - pairs[:, 0]).max(axis=1, initial=0.0) > 1e-6)
    strips = pairs[moved]
    if len(strips):
        columns = rr.LineStrips3D.columns(
            strips=_strip_pairs(strips),
            colors=np.tile(np.array(color, np.uint8), (len(strips), 1)),
            radii=np.full(len(strips), -1.6 if entity.ego else -1.1),  # points of the screen
        )
        yield _rows(play, path, poses[1:, 0][moved], columns)


def _strip_pairs(pairs: np.ndarray) -> pa.Array:
    """Lines of two points [N, 2, 3] as Rerun keeps them; from lists it takes 40 us each."""
    point = pa.list_(pa.field("item", pa.float32(), nullable=False), 3)
    strip = pa.list_(pa.field("item", point, nullable=False))
    numbers = pa.array(pairs.astype(np.float32).ravel())
    points = pa.FixedSizeListArray.from_arrays(numbers, type=point)
    offsets = pa.array(np.arange(len(pairs) + 1, dtype=np.int32) * 2)
    return pa.ListArray.from_arrays(offsets, points, type=strip)


def _rows(
    play: PlayFile, path: str, times_s: np.ndarray, columns: rr.ComponentColumnList
) -> EntityRows:
    return EntityRows(path, *stamps(play, times_s), list(columns))


def stamps(play: PlayFile, times_s: np.ndarray) -> tuple[list[int], list[int]]:
    """Times as sim time [ns] and as steps of the player."""
    times_ns = np.rint(times_s * 1e9).astype(np.int64)
    return times_ns.tolist(), np.rint(times_s / play.step_s).astype(np.int64).tolist()
