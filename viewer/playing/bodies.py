"""Bodies of a played scenario as Rerun draws them: boxes, names, trails and speeds over time."""

from __future__ import annotations

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
_LINE_M = 0.12
"""Half of the width of lines on a roof [m]."""
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
        yield _rows(
            play,
            f"{paths.SPEEDS}/{name}",
            poses[:, 0],
            rr.Scalars.columns(scalars=poses[:, 5]),
        )
        yield from _trail(play, entity, f"{paths.TRAILS}/{name}", color, poses, places)
        if number == paths.followed(play):
            yield _rows(play, paths.CENTRE, poses[:, 0], rr.Transform3D.columns(translation=places))


class Presence:
    """The times in which an entity was there."""

    def __init__(self, play: PlayFile, poses: np.ndarray) -> None:
        """Find them: between two poses that are kept it was there all the time.

        Poses may have been thinned, so the shortest time between two counts, if it is longer than
        the one that is told.
        """
        times = poses[:, 0]
        steps = np.diff(times)
        period_s = max(play.period_s, float(steps.min()) if len(steps) else 0.0)
        firsts = np.flatnonzero(np.concatenate([[True], steps > 1.5 * period_s])[: len(times)])
        lasts = np.append(firsts[1:], len(times))[: len(firsts)] - 1
        self.whole = steps <= 1.5 * period_s
        """Whether it was there from a pose to the next [N - 1]."""
        self.begins_s: np.ndarray = times[firsts]
        """When it appeared [K]."""
        gone = times[lasts] + period_s
        self.ends_s: np.ndarray = gone[gone + 0.5 * period_s < play.end_s]
        """When it vanished, before the end [K or K - 1]."""


def cleared(play: PlayFile, parts: list[str], presence: Presence) -> Iterator[EntityRows]:
    """Rows that take parts of an entity away when it vanishes."""
    count = len(presence.ends_s)
    for part in parts if count else ():
        columns = rr.Clear.columns(is_recursive=[False] * count)
        yield _rows(play, part, presence.ends_s, columns)


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
    presence = Presence(play, poses)
    begins, count = presence.begins_s, len(presence.begins_s)
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
    yield from cleared(play, [f"{path}/{part}" for part in ("body", "front", "dot")], presence)


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
    moved = Presence(play, poses).whole & (
        np.abs(pairs[:, 1] - pairs[:, 0]).max(axis=1, initial=0.0) > 1e-6
    )
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
