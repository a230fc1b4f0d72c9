"""A recorded drive becomes a scenario: who is there, when, and where they go."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.base.errors import UsageError
from twin.drives.drive import DrivenObject, RecordedDrive
from twin.drives.thinning import at_times, cut, thinned, unwrapped
from twin.scenario.storyboard.native.sections import ACTORS_MAX, POSES_MAX

SHORTEST_S = 0.2
"""Shortest scenario [s]."""
LONGEST_S = 3600.0
"""Longest scenario [s]."""
FAR_M = 10_000.0
"""Places farther than this from zero are moved by whole metres, unless a road says where they
are [m]."""
PRESENT_S = 0.15
"""Who is seen this near to the beginning or end of a scenario is there from or until then [s]."""
_EGO_MIDDLE_M = 1.4
"""From the middle of the ego's rear axle to about the middle of its box [m]."""
_ITSELF_M = 1.0
"""Objects whose middle stays so near to that of the ego are the ego [m]."""


@dataclass(frozen=True, slots=True)
class DriveCut:
    """What of a drive is wanted."""

    from_s: float
    """The ego is the stack's from then on [s]."""
    to_s: float | None
    """None: until its end [s]."""
    range_m: float
    """Objects that never come nearer are left out [m]."""
    moved: bool
    """Places may be moved: no road says where they are."""


@dataclass(frozen=True, slots=True)
class CutActor:
    """An object of the scenario."""

    name: str
    source: str
    """Its name in the recording."""
    kind: str
    size_m: tuple[float, float, float]
    """0: as its kind."""
    poses: np.ndarray
    """From the beginning of the scenario on, float64 [N, 5]; headings unwrapped."""
    appears_s: float | None
    """None: it is there from the beginning."""
    vanishes_s: float | None
    """None: it is there until the end."""


@dataclass(frozen=True, slots=True)
class CutDrive:
    """The scenario, before it is written."""

    ego: np.ndarray
    """Poses, float64 [N, 5]; headings unwrapped."""
    actors: list[CutActor]
    duration_s: float
    origin_m: tuple[float, float]
    """What was taken from all places."""
    notes: list[str]


def cut_drive(drive: RecordedDrive, wanted: DriveCut) -> CutDrive:
    """The scenario of a stretch of a drive.

    Raises:
        UsageError: the stretch is not in it, or too short or long; one line.
    """
    whole = unwrapped(drive.ego)
    end_s = float(whole[-1, 0])
    to_s = end_s if wanted.to_s is None else min(wanted.to_s, end_s)
    if not SHORTEST_S <= to_s - wanted.from_s <= LONGEST_S:
        raise UsageError(
            f"--from {wanted.from_s:g}, until {to_s:g} s: the ego is recorded from 0 to {end_s:g} "
            f"s; at least {SHORTEST_S:g} and at most {LONGEST_S:g} s must be left"
        )
    ego = cut(whole, wanted.from_s, to_s)
    far = wanted.moved and np.abs(ego[:, 1:3]).max() > FAR_M
    origin = np.floor(ego[0, 1:3]) if far else np.zeros(2)
    notes: list[str] = []
    near = _near(drive.objects, ego, wanted, to_s, notes)
    actors, numbers = [], dict[str, int]()
    for each, poses in near:
        kind = "truck" if each.kind == "trailer" else each.kind  # nobody tows it
        numbers[kind] = numbers.get(kind, 0) + 1
        name = f"{kind}_{numbers[kind]}"
        actors.append(_actor(name, kind, each, poses, origin, (wanted.from_s, to_s)))
    return CutDrive(
        ego=_within(_placed(ego, origin, wanted.from_s), "the ego"),
        actors=actors,
        duration_s=to_s - wanted.from_s,
        origin_m=(float(origin[0]), float(origin[1])),
        notes=notes,
    )


def _near(
    objects: list[DrivenObject],
    ego: np.ndarray,
    wanted: DriveCut,
    to_s: float,
    notes: list[str],
) -> list[tuple[DrivenObject, np.ndarray]]:
    """Objects that are there, by their names, with their poses of that time."""
    found, far, itself = [], 0, 0
    for each in objects:
        poses = cut(unwrapped(each.poses), wanted.from_s, to_s)
        if len(poses) < 2:
            continue
        gaps = _gaps(poses, ego)
        if float(gaps.min()) > wanted.range_m:
            far += 1
        elif float(np.median(gaps)) < _ITSELF_M:
            itself += 1
        else:
            found.append((float(gaps.min()), each, poses))
    found.sort(key=lambda row: (row[0], row[1].name))
    for count, words in (
        (far, f"objects that never come nearer than {wanted.range_m:g} m (--range)"),
        (itself, "objects that are the ego itself"),
        (max(0, len(found) - ACTORS_MAX), f"objects beyond the nearest {ACTORS_MAX}"),
    ):
        if count:
            notes.append(f"left out: {count} {words}")
    kept = [(each, poses) for _, each, poses in found[:ACTORS_MAX]]
    return sorted(kept, key=lambda row: (row[1][0, 0], row[0].name))


def _gaps(poses: np.ndarray, ego: np.ndarray) -> np.ndarray:
    """From the middle of the ego to that of an object at each of its poses [m]."""
    there = at_times(ego, poses[:, 0])
    x = there[:, 1] + _EGO_MIDDLE_M * np.cos(there[:, 4])
    y = there[:, 2] + _EGO_MIDDLE_M * np.sin(there[:, 4])
    return np.asarray(np.hypot(poses[:, 1] - x, poses[:, 2] - y))


def _actor(
    name: str,
    kind: str,
    each: DrivenObject,
    poses: np.ndarray,
    origin: np.ndarray,
    span_s: tuple[float, float],
) -> CutActor:
    from_s, to_s = span_s
    placed = _within(_placed(poses, origin, from_s), each.name)
    first, last = float(placed[0, 0]), float(placed[-1, 0])
    if first > 0.0:
        # Until it appears, it stands where it will.
        placed = np.concatenate([[[0.0, *placed[0, 1:]]], placed])
    length, width, height = (float(side) for side in each.size_m)
    return CutActor(
        name=name,
        source=each.name,
        kind=kind,
        size_m=(length, width, height),
        poses=placed,
        appears_s=first if first > PRESENT_S else None,
        vanishes_s=last if last < to_s - from_s - PRESENT_S else None,
    )


def _placed(poses: np.ndarray, origin: np.ndarray, from_s: float) -> np.ndarray:
    placed = thinned(poses)
    placed[:, 0] -= from_s
    placed[:, 1:3] -= origin
    # Turns of hours of driving stay small numbers.
    placed[:, 4] -= 2.0 * math.pi * np.round(placed[0, 4] / (2.0 * math.pi))
    return placed


def _within(poses: np.ndarray, name: str) -> np.ndarray:
    if len(poses) > POSES_MAX:
        raise UsageError(
            f"{name}: {len(poses)} poses are needed for its way, allowed: {POSES_MAX}; "
            "take a shorter stretch with --from and --to"
        )
    return poses
