"""What ``twin validate road`` says of a road file: figures, gaps, a table."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from schemas.escape import escape
from twin.road.opendrive.gaps import RoadGap, find_gaps
from twin.road.opendrive.records import RoadRecord
from twin.road.opendrive.road_map import RoadMap

SHOWN_MAX = 20
"""Most roads, gaps and notes that the table shows."""


@dataclass(frozen=True, slots=True)
class RoadFigures:
    """Figures of one road."""

    id: str
    length_m: float
    lanes: dict[str, int]
    """Lanes by type, where there are most of them."""
    sections: int
    junction: str | None
    signals: int
    objects: int
    radius_min_m: float | None
    """Tightest curve of the reference line, None: it is straight."""
    elevation_m: tuple[float, float]
    """Least and largest height of the reference line."""
    slope_max: float
    """Steepest climb or descent, rise per metre."""
    superelevation_max_rad: float
    """Steepest turn about the reference line, either way."""
    width_max_m: float
    """Of all lanes together."""


@dataclass(frozen=True, slots=True)
class RoadCheck:
    """Everything that is said of a file."""

    file: str
    version: str
    junctions: int
    extent_m: tuple[float, float, float, float]
    """Least x and y, largest x and y of the reference lines."""
    roads: tuple[RoadFigures, ...]
    gaps: tuple[RoadGap, ...]
    notes: tuple[str, ...]


def check_roads(roads: RoadMap) -> RoadCheck:
    """The figures of a network."""
    network = roads.network
    lines = [frame.line for frame in roads.frames.values()]
    x = np.concatenate([line.sample_x for line in lines])
    y = np.concatenate([line.sample_y for line in lines])
    return RoadCheck(
        file=network.file,
        version="{}.{}".format(*network.version),
        junctions=len(network.junctions),
        extent_m=(float(x.min()), float(y.min()), float(x.max()), float(y.max())),
        roads=tuple(_figures(roads, road) for road in network.roads.values()),
        gaps=tuple(find_gaps(network, roads.frames)),
        notes=network.notes,
    )


def _figures(roads: RoadMap, road: RoadRecord) -> RoadFigures:
    frame = roads.frames[road.id]
    s = frame.line.sample_s
    pose = frame.pose(s)
    curvature = float(np.abs(frame.curvature(s)).max())
    lanes: dict[str, int] = {}
    for section in road.sections:
        types = [lane.type for lane in section.lanes]
        for name in types:
            lanes[name] = max(lanes.get(name, 0), types.count(name))
    return RoadFigures(
        id=road.id,
        length_m=road.length_m,
        lanes=dict(sorted(lanes.items())),
        sections=len(road.sections),
        junction=road.junction,
        signals=len(road.signals),
        objects=len(road.objects),
        radius_min_m=1.0 / curvature if curvature > 1e-9 else None,
        elevation_m=(float(pose.z_m.min()), float(pose.z_m.max())),
        slope_max=float(np.abs(np.tan(pose.pitch_rad)).max()),
        superelevation_max_rad=float(np.abs(pose.roll_rad).max()),
        width_max_m=_width(roads, road, s),
    )


def _width(roads: RoadMap, road: RoadRecord, s: np.ndarray) -> float:
    frame = roads.frames[road.id]
    index = frame.section_at(s)
    widest = 0.0
    for number, section in enumerate(frame.sections):
        mine = s[index == number]
        mine = mine if len(mine) else np.array([section.section.start_m])
        left = section.outer(len(section.section.left), mine)[0]
        right = section.outer(-len(section.section.right), mine)[0]
        widest = max(widest, float((left - right).max()))
    return widest


def to_json(check: RoadCheck) -> dict[str, object]:
    """What was found, as plain values."""
    gaps = [gap._asdict() for gap in check.gaps]
    return {**asdict(check), "valid": True, "gaps": gaps}


def to_table(check: RoadCheck) -> Group:
    """What was found, as a table for people."""
    total = math.fsum(road.length_m for road in check.roads)
    x0, y0, x1, y1 = check.extent_m
    head = (
        f"{check.file}: OpenDRIVE {check.version}, valid\n"
        f"roads {len(check.roads)}, {total:.1f} m; junctions {check.junctions}; "
        f"signals {sum(road.signals for road in check.roads)}; "
        f"objects {sum(road.objects for road in check.roads)}; "
        f"x {x0:.1f} to {x1:.1f} m, y {y0:.1f} to {y1:.1f} m"
    )
    table = Table("road", box=None, pad_edge=False)
    for column in ("length m", "width m", "radius m", "height m", "slope %", "tilt deg", "signals"):
        table.add_column(column, justify="right")
    table.add_column("lanes by type")
    for road in check.roads[:SHOWN_MAX]:
        table.add_row(*_row(road))
    lines = [f"... and {len(check.roads) - SHOWN_MAX} more roads"]
    parts: list[Text | Table] = [Text(head), table]
    if len(check.roads) > SHOWN_MAX:
        parts.append(Text(lines[0]))
    parts.append(Text(_gap_words(check.gaps)))
    parts += [Text(note) for note in _cut(check.notes)]
    return Group(*parts)


def _row(road: RoadFigures) -> tuple[str, ...]:
    inside = f" (junction {road.junction[:20]})" if road.junction is not None else ""
    low, high = road.elevation_m
    return (
        escape(f"{road.id[:20]}{inside}"),
        f"{road.length_m:.2f}",
        f"{road.width_max_m:.2f}",
        "straight" if road.radius_min_m is None else f"{road.radius_min_m:.1f}",
        f"{low:.2f}" if low == high else f"{low:.2f} to {high:.2f}",
        f"{100 * road.slope_max:.1f}",
        f"{math.degrees(road.superelevation_max_rad):.1f}",
        str(road.signals),
        ", ".join(f"{count} {name}" for name, count in road.lanes.items()),
    )


def _gap_words(gaps: tuple[RoadGap, ...]) -> str:
    if not gaps:
        return "No gaps above 1 cm or 0.1 degrees where roads and pieces meet."
    lines = [
        escape(
            f"gap: road {gap.road[:20]} at {gap.at}, to road {gap.other[:20]}: "
            f"{100 * gap.distance_m:.1f} cm, {math.degrees(gap.kink_rad):.2f} degrees"
        )
        for gap in gaps
    ]
    return "\n".join(_cut(tuple(lines)))


def _cut(lines: tuple[str, ...]) -> list[str]:
    more = [f"... and {len(lines) - SHOWN_MAX} more"] if len(lines) > SHOWN_MAX else []
    return [*lines[:SHOWN_MAX], *more]
