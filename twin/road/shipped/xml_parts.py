"""Parts of OpenDRIVE files as text: lanes, marks, reference lines, objects, signals.

Numbers are written with at most nine decimals, so that the last bit of a sine, which differs
between mathematical libraries, does not reach a file. Coefficients of polynomials have fifteen:
they are multiplied by cubes of lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.road.opendrive.clothoid import clothoid

Coefficients = tuple[float, float, float, float]


def number(value: float, decimals: int = 9) -> str:
    """A number as it stands in a file."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def element(name: str, inside: str = "", /, **attributes: object) -> str:
    """An element; attributes with a trailing underscore are written without it."""
    words = "".join(
        f' {key.rstrip("_")}="{number(value) if isinstance(value, float) else value}"'
        for key, value in attributes.items()
    )
    return f"<{name}{words}>\n{inside}</{name}>\n" if inside else f"<{name}{words}/>\n"


def cubics(name: str, rows: Sequence[tuple[float, Coefficients]], start: str = "s") -> str:
    """Cubic polynomials, each from a station on; ``start`` is the attribute of the station."""
    return "".join(
        element(name, **{start: s}, **dict(zip("abcd", (number(v, 15) for v in row), strict=True)))
        for s, row in rows
    )


def constant(value: float) -> tuple[tuple[float, Coefficients], ...]:
    """A value that does not change."""
    return ((0.0, (value, 0.0, 0.0, 0.0)),)


@dataclass(frozen=True, slots=True)
class MarkPlan:
    """A road mark on the outer border of a lane."""

    type: str
    width_m: float
    stroke_m: float = 0.0
    """0: solid."""
    gap_m: float = 0.0
    change: str = "none"
    """Who may cross it."""

    def text(self) -> str:
        """The element."""
        inside = ""
        if self.stroke_m > 0.0:
            line = element(
                "line",
                length=self.stroke_m,
                space=self.gap_m,
                tOffset=0.0,
                sOffset=0.0,
                width=self.width_m,
            )
            inside = element("type", line, name=self.type, width=self.width_m)
        return element(
            "roadMark",
            inside,
            sOffset=0.0,
            type=self.type,
            weight="standard",
            color="standard",
            width=self.width_m,
            laneChange=self.change,
        )


@dataclass(frozen=True, slots=True)
class LanePlan:
    """A lane of constant width."""

    id: int
    type: str
    width_m: float
    mark: MarkPlan | None = None
    height_m: float = 0.0
    """Above the road, as of a footway behind its kerb."""
    before: tuple[int, ...] = ()
    after: tuple[int, ...] = ()
    speed_mps: float = 0.0
    """Speed limit; 0: that of the road."""

    def text(self) -> str:
        """The element."""
        link = "".join(element("predecessor", id=i) for i in self.before)
        link += "".join(element("successor", id=i) for i in self.after)
        inside = element("link", link) if link else ""
        if self.id != 0:
            inside += cubics("width", constant(self.width_m), "sOffset")
        inside += self.mark.text() if self.mark else ""
        if self.speed_mps > 0.0:
            inside += element("speed", sOffset=0.0, max=self.speed_mps, unit="m/s")
        if self.height_m > 0.0:
            inside += element("height", sOffset=0.0, inner=self.height_m, outer=self.height_m)
        return element("lane", inside, id=self.id, type=self.type, level="false")


def section(s_m: float, lanes: Sequence[LanePlan], centre: MarkPlan | None) -> str:
    """A lane section; ``centre`` is the mark on lane 0."""
    left = sorted((lane for lane in lanes if lane.id > 0), key=lambda lane: -lane.id)
    right = sorted((lane for lane in lanes if lane.id < 0), key=lambda lane: -lane.id)
    inside = element("left", "".join(lane.text() for lane in left)) if left else ""
    inside += element("center", LanePlan(0, "none", 0.0, centre).text())
    inside += element("right", "".join(lane.text() for lane in right)) if right else ""
    return element("laneSection", inside, s=s_m)


@dataclass(slots=True)
class PlanView:
    """A reference line under construction: pieces are put at its end."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    length_m: float = 0.0
    parts: list[str] = field(default_factory=list)

    def add(self, length_m: float, start_per_m: float = 0.0, end_per_m: float = 0.0) -> PlanView:
        """A straight, an arc or a clothoid between two curvatures, to the left positive [1/m]."""
        if start_per_m == end_per_m == 0.0:
            shape = element("line")
        elif start_per_m == end_per_m:
            shape = element("arc", curvature=start_per_m)
        else:
            shape = element("spiral", curvStart=start_per_m, curvEnd=end_per_m)
        # What stands in the file is where the next piece begins, rounding included.
        begin = {
            "s": self.length_m,
            "x": self.x_m,
            "y": self.y_m,
            "hdg": self.heading_rad,
            "length": length_m,
        }
        self.parts.append(element("geometry", shape, **begin))
        curve = clothoid(start_per_m, end_per_m, length_m)
        x, y = (float(value[0]) for value in curve.at(np.array([length_m])))
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        self.x_m = float(self.x_m + c * x - s * y)
        self.y_m = float(self.y_m + s * x + c * y)
        self.heading_rad += 0.5 * (start_per_m + end_per_m) * length_m
        self.length_m += length_m
        return self

    def text(self) -> str:
        """The element."""
        return element("planView", "".join(self.parts))


def road(
    plan: PlanView,
    sections: str,
    *,
    road_id: int,
    name: str,
    kind: str = "",
    speed_mps: float = 0.0,
    link: str = "",
    junction: int = -1,
    profiles: str = "",
    offset: Sequence[tuple[float, Coefficients]] = (),
    beside: str = "",
) -> str:
    """A road; ``profiles`` are its elements of height and tilt, ``beside`` objects and signals."""
    inside = element("link", link) if link else ""
    if kind:
        speed = element("speed", max=speed_mps, unit="m/s")
        inside += element("type", speed, s=0.0, type=kind, country="DE")
    inside += plan.text() + profiles
    inside += element("lanes", cubics("laneOffset", offset) + sections) + beside
    return element(
        "road", inside, name=name, length=plan.length_m, id=road_id, junction=junction, rule="RHT"
    )


def document(name: str, inside: str) -> bytes:
    """A whole file."""
    head = element("header", revMajor=1, revMinor=7, name=name, version="1.00", vendor="drivetwin")
    body = element("OpenDRIVE", head + inside)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}'.encode()


def crosswalk(road_id: int, s_m: float, length_m: float, half_width_m: float) -> str:
    """A pedestrian crossing: a rectangle across the road, ``length_m`` along it."""
    corners = (
        (-0.5 * length_m, -half_width_m),
        (0.5 * length_m, -half_width_m),
        (0.5 * length_m, half_width_m),
        (-0.5 * length_m, half_width_m),
    )
    outline = "".join(
        element("cornerRoad", s=s_m + along, t=across, dz=0.01, height=0.0, id=index)
        for index, (along, across) in enumerate(corners)
    )
    return element(
        "object",
        element("outlines", element("outline", outline, id=0, closed="true")),
        id=f"{road_id}00",
        name="crossing",
        type="crosswalk",
        s=s_m,
        t=0.0,
        zOffset=0.0,
        hdg=0.0,
        orientation="none",
        length=length_m,
        width=2.0 * half_width_m,
        height=0.0,
    )


def guard_rail(rail_id: int, s_m: float, length_m: float, t_m: float) -> str:
    """A guard rail along a road, 0.75 m high."""
    row = element(
        "repeat",
        s=s_m,
        length=length_m,
        distance=0.0,
        tStart=t_m,
        tEnd=t_m,
        widthStart=0.3,
        widthEnd=0.3,
        heightStart=0.75,
        heightEnd=0.75,
        zOffsetStart=0.0,
        zOffsetEnd=0.0,
    )
    return element(
        "object",
        row,
        id=rail_id,
        name="guard rail",
        type="barrier",
        subtype="guardRail",
        s=s_m,
        t=t_m,
        zOffset=0.0,
        hdg=0.0,
        orientation="none",
        length=length_m,
        width=0.3,
        height=0.75,
    )


def signal(
    signal_id: int,
    name: str,
    s_m: float,
    t_m: float,
    kind: str,
    *,
    light: bool = False,
    orientation: str = "+",
    z_m: float = 2.2,
) -> str:
    """A sign of the German catalogue, or a traffic light (``light``)."""
    return element(
        "signal",
        s=s_m,
        t=t_m,
        id=signal_id,
        name=name,
        dynamic="yes" if light else "no",
        orientation=orientation,
        zOffset=z_m,
        country="OpenDRIVE" if light else "DE",
        type=kind,
        subtype="-1",
        height=0.9 if light else 0.6,
        width=0.3 if light else 0.6,
    )
