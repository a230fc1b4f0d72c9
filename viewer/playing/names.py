"""Names of bodies and events in views from above, where they cover nobody.

Rerun writes a label of fixed size below a point. So each view has points of its own, at distances
that are some pixels there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from schemas.escape import escape
from schemas.files.played_scenario import PlayFile
from twin.records.play_file import poses_of
from viewer.playing import paths
from viewer.playing.bodies import NAME_CHARS, Presence, cleared, stamps
from viewer.playing.eyes import TopEye
from viewer.recording.rows import EntityRows
from viewer.recording.scenery import ORANGE

_BELOW_PX = 4.0
"""Distance of a name from its body."""
_STAGGER_PX = 20.0
"""By so much more for every second and third name: those of neighbours stay legible."""
_EGO_ABOVE_PX = 27.0
"""Distance of the ego's name above it: there it covers nobody who is parked beside its lane."""
_EVENT_ABOVE_PX = 52.0
"""Distance of an event's name above its point: below stand the names of bodies."""


def body_names(play: PlayFile, origin_m: np.ndarray, eye: TopEye) -> Iterator[EntityRows]:
    """Names that move with their bodies; places are moved by ``-origin_m``."""
    looks = zip(play.entities, paths.entity_names(play), paths.entity_colors(play), strict=True)
    shown = -1
    for entity, name, color in looks:
        poses = poses_of(entity.poses)
        if not len(poses):
            continue
        shown += not entity.ego
        turn = poses[:, 4] - eye.right_rad
        side, forward = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        x, y, z = entity.centre_m
        # Where the middle of the box is, and how far it reaches, upwards in the view [m].
        middle = x * np.sin(turn) + y * np.cos(turn)
        reach = 0.5 * (entity.length_m * forward + entity.width_m * side)
        if entity.ego:
            up = middle + reach + _EGO_ABOVE_PX * eye.pixel_m
        else:
            up = middle - reach - (_BELOW_PX + _STAGGER_PX * (shown % 3)) * eye.pixel_m
        way = eye.upwards(1.0) / eye.pixel_m
        at = poses[:, 1:4] - origin_m + up[:, None] * way + np.array([0.0, 0.0, z])
        path = f"{paths.NAMES}/{eye.key}/{name}"
        presence = Presence(play, poses)
        times = stamps(play, poses[:, 0])
        yield EntityRows(path, *times, list(rr.Transform3D.columns(translation=at)))
        begins = stamps(play, presence.begins_s)
        count = len(presence.begins_s)
        label = rr.Points3D.columns(
            positions=[(0.0, 0.0, 0.0)] * count,
            radii=[rr.Radius.ui_points(0.1)] * count,
            colors=[color] * count,
            labels=[escape(entity.name, NAME_CHARS)] * count,
            show_labels=[True] * count,
        )
        yield EntityRows(f"{path}/label", *begins, list(label))
        yield from cleared(play, [f"{path}/label"], presence)


def event_name(
    number: int, text: str, place: np.ndarray, width_m: float, eye: TopEye
) -> tuple[str, list[rr.ComponentColumn]]:
    """Path and columns of the name above the point ``place`` of an event."""
    above = place + eye.upwards(_EVENT_ABOVE_PX + 0.5 * width_m / eye.pixel_m)
    columns = rr.Points3D.columns(
        positions=[above],
        radii=[rr.Radius.ui_points(0.1)],
        colors=[ORANGE],
        labels=[text],
        show_labels=[True],
    )
    return f"{paths.NAMES}/{eye.key}/event-{number:03d}", list(columns)
