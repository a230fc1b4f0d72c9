"""The eyes that look down on a played scenario, and how large a pixel is to each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.files.played_scenario import PlayFile
from twin.records.play_file import poses_of
from viewer.playing import paths

NEAR_M = (34.0, 80.0)
"""Lowest and highest place of the eye that follows [m]."""
FAR_M = (40.0, 6_000.0)
"""Lowest and highest place of the eye that sees all [m]."""
_STANDING_M, _PER_MPS = 22.0, 1.5
"""Height of the eye that follows: the faster somebody drives, the more is seen."""
_AHEAD = 0.25
"""Place below that eye, before whom it follows, as a share of its height."""
_HALF_FIELD = math.tan(math.radians(55.0) / 2.0)
"""Half of the height that Rerun's eye sees at a distance of 1 m."""
_ASPECT = 2.4
"""About how much wider than high a view is."""
_NEAR_PX, _FAR_PX = 380.0, 212.0
"""Heights of the views in a picture of 1280 x 720 pixels."""


@dataclass(frozen=True, slots=True)
class TopEye:
    """An eye straight above a place."""

    key: str
    """Part of the paths of names that only its view shows."""
    below: tuple[float, float, float]
    """Place below it, in the axes of its view [m]."""
    height_m: float
    right_rad: float
    """Direction that its view has on the right."""
    pixel_m: float
    """Size of a pixel on the ground, in a picture of usual size [m]."""

    def upwards(self, pixels: float) -> np.ndarray:
        """Way on the ground that leads so many pixels up in the view [3] [m]."""
        way = np.array([-math.sin(self.right_rad), math.cos(self.right_rad), 0.0])
        return way * pixels * self.pixel_m


def near_eye(play: PlayFile) -> TopEye | None:
    """The eye that follows the ego; None: there is nobody to follow."""
    number = paths.followed(play)
    if number < 0:
        return None
    poses = poses_of(play.entities[number].poses)
    height = _STANDING_M + _PER_MPS * float(np.abs(poses[:, 5]).max())
    height = min(max(height, NEAR_M[0]), NEAR_M[1])
    right = float(poses[0, 4])
    ahead = _AHEAD * height
    below = (ahead * math.cos(right), ahead * math.sin(right), 0.0)
    return TopEye("near", below, height, right, 2.0 * _HALF_FIELD * height / _NEAR_PX)


def far_eye(play: PlayFile, origin_m: np.ndarray) -> TopEye:
    """The eye that sees all places of all entities, their longest extent from the left to the
    right."""
    rows = [poses_of(entity.poses)[:, 1:4] for entity in play.entities]
    places = np.concatenate([*rows, np.zeros((0, 3))]) - origin_m
    if not len(places):
        places = np.zeros((1, 3))
    near = near_eye(play)
    right = near.right_rad if near is not None else 0.0
    along = places @ [math.cos(right), math.sin(right), 0.0]
    across = places @ [-math.sin(right), math.cos(right), 0.0]
    if np.ptp(across) > np.ptp(along):
        right, along, across = right + 0.5 * math.pi, across, -along
    x, y = (float(axis.min() + axis.max()) / 2.0 for axis in (along, across))
    c, s = math.cos(right), math.sin(right)
    below = (c * x - s * y, s * x + c * y, float(places[:, 2].mean()))
    needed = max(float(np.ptp(along)) / _ASPECT, float(np.ptp(across))) / 2.0 + 8.0
    height = min(max(needed / _HALF_FIELD, FAR_M[0]), FAR_M[1])
    return TopEye("far", below, height, right, 2.0 * _HALF_FIELD * height / _FAR_PX)


def top_eyes(play: PlayFile, origin_m: np.ndarray) -> list[TopEye]:
    """The eyes of all views, from the upper to the lower one."""
    near = near_eye(play)
    far = far_eye(play, origin_m)
    return [far] if near is None else [near, far]
