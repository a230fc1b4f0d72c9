"""Triangles of one look."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

AREA_MIN_M2 = 1e-7
"""Smaller triangles are left out: where a lane begins or ends its width is 0."""

PatchKind = Literal["lane", "kerb", "mark", "ground"]


@dataclass(frozen=True, slots=True)
class SurfacePatch:
    """Triangles, counterclockwise seen from above (of kerbs: from their lower side)."""

    kind: PatchKind
    look: str
    """Type of the lanes, or colour of the marks; empty of kerbs and ground."""
    points_m: np.ndarray
    """World, float64 [V, 3]."""
    faces: np.ndarray
    """int32 [F, 3]."""
    friction: float | None = None
    """Of lanes, over that of a road without one [-]; None: none is given."""


def strip(
    kind: PatchKind,
    look: str,
    left_m: np.ndarray,
    right_m: np.ndarray,
    joined: np.ndarray | None = None,
    friction: float | None = None,
) -> SurfacePatch | None:
    """The strip between two lines of as many points [N, 3], both along s; None: it has no area.

    ``joined``, bool [N - 1], says which of them are joined to the next; None: all.

    In a bend tighter than its distance from the reference line a strip folds over itself; what
    would look down there is left out.
    """
    count = len(left_m)
    points = np.concatenate([left_m, right_m])
    i = np.arange(count - 1) if joined is None else np.flatnonzero(joined)
    faces = np.concatenate(
        [
            np.column_stack([count + i, count + i + 1, i + 1]),
            np.column_stack([count + i, i + 1, i]),
        ]
    )
    a, b, c = points[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    kept = 0.25 * (normal * normal).sum(axis=1) > AREA_MIN_M2 * AREA_MIN_M2
    if kind != "kerb":
        kept &= normal[:, 2] > 0.0
    if not kept.any():
        return None
    return SurfacePatch(kind, look, points, faces[kept].astype(np.int32), friction)


def merged(patches: Iterable[SurfacePatch | None]) -> tuple[SurfacePatch, ...]:
    """One patch for each kind, look and friction, in the order in which they are met."""
    groups: dict[tuple[PatchKind, str, float | None], list[SurfacePatch]] = {}
    for patch in patches:
        if patch is not None:
            groups.setdefault((patch.kind, patch.look, patch.friction), []).append(patch)
    whole = []
    for (kind, look, friction), parts in groups.items():
        first = np.cumsum([0, *(len(part.points_m) for part in parts)])
        faces = [part.faces + start for part, start in zip(parts, first[:-1], strict=True)]
        points = np.concatenate([part.points_m for part in parts])
        whole.append(
            SurfacePatch(kind, look, points, np.concatenate(faces).astype(np.int32), friction)
        )
    return tuple(whole)
