"""Poses that say no more than the straight lines between the others are left out."""

from __future__ import annotations

import numpy as np

from twin.drives.drive import POSE

PLACE_TOLERANCE_M = 0.002
"""How far from the lines a pose that is left out may lie at its time [m]."""
HEADING_TOLERANCE_RAD = 0.0017
"""The same of headings, 0.1 degrees [rad]."""

_X, _Y, _HEADING = POSE.index("x_m"), POSE.index("y_m"), POSE.index("heading_rad")


def thinned(poses: np.ndarray) -> np.ndarray:
    """The poses that are kept, float64 [M, 5]; the first and the last are always.

    ``poses``: float64 [N, 5] by :data:`twin.drives.drive.POSE`, headings unwrapped.
    """
    kept = np.zeros(len(poses), bool)
    kept[[0, -1]] = True
    spans = [(0, len(poses) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        worst, most = _worst(poses[first : last + 1])
        if most > 1.0:
            kept[first + worst] = True
            spans += [(first, first + worst), (first + worst, last)]
    return poses[kept]


def _worst(poses: np.ndarray) -> tuple[int, float]:
    """The pose farthest from the line between the ends, and how far, in tolerances."""
    share = (poses[:, 0] - poses[0, 0]) / (poses[-1, 0] - poses[0, 0])
    line = poses[0] + share[:, None] * (poses[-1] - poses[0])
    off = np.abs(poses - line)
    beyond = np.maximum(
        np.hypot(off[:, _X], off[:, _Y]) / PLACE_TOLERANCE_M,
        off[:, _HEADING] / HEADING_TOLERANCE_RAD,
    )
    worst = int(np.argmax(beyond))
    return worst, float(beyond[worst])


def unwrapped(poses: np.ndarray) -> np.ndarray:
    """The same poses, whose headings go on without jumps."""
    whole = poses.copy()
    whole[:, _HEADING] = np.unwrap(whole[:, _HEADING])
    return whole


def at_times(poses: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Poses at times, evenly between those that are there; headings unwrapped."""
    columns = [np.interp(times_s, poses[:, 0], poses[:, column]) for column in range(1, len(POSE))]
    return np.column_stack([times_s, *columns])


def cut(poses: np.ndarray, from_s: float, to_s: float) -> np.ndarray:
    """Poses of a time, with one at each of its ends where the poses reach so far."""
    low, high = max(from_s, poses[0, 0]), min(to_s, poses[-1, 0])
    if high < low:
        return poses[:0]
    ends = at_times(poses, np.array([low, high] if high > low else [low]))
    inside = poses[(poses[:, 0] > low) & (poses[:, 0] < high)]
    return np.concatenate([ends[:1], inside, ends[1:]])
