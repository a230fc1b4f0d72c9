"""What stands still in a recording: lanes, hulls and the ego's own, seen from above."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from viewer.recording import naming

LINES_MAX, POINTS_MAX, HULLS_MAX = 64, 4096, 4096
"""Most lines, points of a line, and hulls that are kept."""

HULLS = {naming.OBSTACLE: "obstacle", naming.PARKED: "parked", naming.BUILDINGS: "building"}
"""Entity path -> kind of its boxes."""


@dataclass(frozen=True, slots=True)
class StandingHull:
    """A box on the ground."""

    kind: str
    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float


@dataclass(slots=True)
class StandingScene:
    """Everything that stands, in the world's axes."""

    lines_m: list[list[list[float]]] = field(default_factory=list)
    """Edges of lanes and kerbs: lines of x, y."""
    hulls: list[StandingHull] = field(default_factory=list)
    ego_size_m: list[float] | None = None
    """Length, width and height of the ego's hull."""
    ego_center_m: list[float] | None = None
    """Its middle, from the reference point that the poses are of."""


def read_surroundings(path: Path) -> StandingScene:
    """What a recording says of it; empty where it says nothing, or cannot be read."""
    shown = StandingScene()
    try:
        with warnings.catch_warnings():
            # The file of a killed recorder has no footer.
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(path)
            store = next(iter(reader.recordings()), None)
            if store is None:
                return shown
            for entity in (naming.STREET, naming.EGO_BODY, *HULLS):
                for chunk in reader.stream(store=store).filter(content=f"/{entity}"):
                    if chunk.is_static:
                        _take(shown, entity, chunk.to_record_batch().to_pydict())
    except (OSError, ValueError, RuntimeError):
        return shown
    return shown


def _take(shown: StandingScene, entity: str, columns: dict[str, list[Any]]) -> None:
    if entity == naming.STREET:
        for strip in (columns.get("LineStrips3D:strips") or [None])[0] or []:
            if len(shown.lines_m) < LINES_MAX:
                step = -(-len(strip) // POINTS_MAX) or 1
                shown.lines_m.append([[float(x), float(y)] for x, y, *_ in strip[::step]])
        return
    centers = _first(columns, "Boxes3D:centers")
    halves = _first(columns, "Boxes3D:half_sizes")
    if entity == naming.EGO_BODY:
        if halves:
            shown.ego_size_m = [2 * float(half) for half in halves[0]]
        if centers:
            shown.ego_center_m = [float(at) for at in centers[0]]
        return
    turns = _first(columns, "Boxes3D:rotation_axis_angles")
    turns += [None] * (len(centers) - len(turns))
    for center, half, turn in zip(centers, halves, turns, strict=False):
        if len(shown.hulls) >= HULLS_MAX:
            return
        yaw_rad = float(turn["angle"]) * float(turn["axis"][2]) if turn else 0.0
        size_m = [2 * float(edge) for edge in half]
        shown.hulls.append(
            StandingHull(HULLS[entity], float(center[0]), float(center[1]), yaw_rad, *size_m)
        )


def _first(columns: dict[str, list[Any]], name: str) -> list[Any]:
    rows = columns.get(name) or [None]
    return list(rows[0] or [])
