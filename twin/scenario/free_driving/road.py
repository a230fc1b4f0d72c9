"""Roads for free driving as OpenDRIVE files, from a seed."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

from twin.road.shipped.xml_parts import (
    Coefficients,
    LanePlan,
    MarkPlan,
    PlanView,
    constant,
    cubics,
    document,
    element,
    road,
    section,
    signal,
)
from twin.scenario.free_driving.chance import Draws
from twin.scenario.free_driving.classes import MOTORWAY, STREET, RoadClass

_KMH = 1.0 / 3.6
_MEDIAN_M = 2.0
"""Half width of a motorway's median."""
_SHOULDER_M = {"motorway": 2.5, "rural": 1.5}
_PARKING_M, _FOOTWAY_M, _KERB_M = 2.0, 2.5, 0.12
_RAIL_M = 0.75
"""Height of guard rails [m]."""
_STEEL_M = 0.012
"""Height of manhole covers and joints above the road [m]."""
_HEADROOM_M = 4.8
"""Below bridges: 4.7 m at least on German motorways and 4.5 m elsewhere [m]."""
_GANTRY_M = 6.5
_BANK_M = 3.0
"""From the outer edge to trees and piers [m]."""


@dataclass(slots=True)
class _Beside:
    """What stands beside a road."""

    objects: list[str] = field(default_factory=list)
    signals: list[str] = field(default_factory=list)

    def add(
        self,
        kind: str,
        s_m: float,
        t_m: float,
        *,
        name: str = "",
        subtype: str = "",
        z_m: float = 0.0,
        length_m: float = 0.0,
        width_m: float = 0.0,
        height_m: float = 0.0,
        radius_m: float = 0.0,
        along_m: float = 0.0,
        every_m: float = 0.0,
    ) -> None:
        """Add an object; ``along_m``: so far along the road, in one piece or ``every_m``."""
        number = len(self.objects)
        size = {"radius": radius_m} if radius_m else {"length": length_m, "width": width_m}
        row = ""
        if along_m > 0.0:
            ends: dict[str, float] = {"tStart": t_m, "tEnd": t_m}
            ends |= {"heightStart": height_m, "heightEnd": height_m}
            ends |= {"zOffsetStart": z_m, "zOffsetEnd": z_m}
            if radius_m:
                ends |= {"radiusStart": radius_m, "radiusEnd": radius_m}
            else:
                ends |= {"widthStart": width_m, "widthEnd": width_m}
                ends |= {"lengthStart": length_m, "lengthEnd": length_m}
            row = element("repeat", s=s_m, length=along_m, distance=every_m, **ends)
        words: dict[str, object] = {"subtype": subtype} if subtype else {}
        self.objects.append(
            element(
                "object",
                row,
                id=number,
                name=name or kind,
                type=kind,
                s=s_m,
                t=t_m,
                zOffset=z_m,
                hdg=0.0,
                orientation="none",
                height=height_m,
                **size,
                **words,
            )
        )


@dataclass(frozen=True, slots=True)
class _Curve:
    """An arc with its clothoids."""

    begin_m: float
    end_m: float
    side: float
    """1: to the left."""


def road_file(road_class: RoadClass, seed: int) -> bytes:
    """An OpenDRIVE file of a class; the same bytes for the same seed."""
    plan, curves = _line(road_class, Draws(seed, f"{road_class.name} line"))
    beside = _Beside()
    draws = Draws(seed, f"{road_class.name} beside")
    _rails(road_class, curves, plan.length_m, beside)
    _over(road_class, draws, beside)
    _covers(road_class, draws, plan.length_m, beside)
    _bank(road_class, draws, plan.length_m, beside)
    heights = _heights(road_class, Draws(seed, f"{road_class.name} heights"), plan.length_m)
    limit = signal(
        0, "limit", road_class.begin_m + 40.0, -_edge_m(road_class) - 0.8, "274", z_m=2.2
    ).replace('subtype="-1"', f'subtype="{road_class.limit_kmh:.0f}"')
    text = road(
        plan,
        section(0.0, _lanes(road_class), _centre(road_class)),
        road_id=0,
        name=road_class.name,
        kind=road_class.kind,
        speed_mps=road_class.limit_kmh * _KMH,
        profiles=element("elevationProfile", cubics("elevation", heights)),
        offset=constant(0.0),
        beside=element("objects", "".join(beside.objects)) + element("signals", limit),
    )
    return document(f"driving {road_class.name}", text)


def _line(road_class: RoadClass, draws: Draws) -> tuple[PlanView, list[_Curve]]:
    """Straights and arcs between clothoids, by turns; curves turn back more often than on, so a
    road does not come round to itself."""
    plan, curves, turned = PlanView(), list[_Curve](), 0.0
    long = road_class.clothoid_m
    while plan.length_m < road_class.length_m:
        plan.add(draws.between(*road_class.straight_m))
        side = 1.0 if draws.happens(0.5) else -1.0
        bend = side / draws.between(*road_class.radius_m, 1.0)
        arc = draws.between(*road_class.arc_m)
        if abs(turned + bend * (arc + long)) > math.radians(70.0):
            bend, side = -bend, -side
        begin = plan.length_m
        plan.add(long, 0.0, bend).add(arc, bend, bend).add(long, bend, 0.0)
        turned += bend * (arc + long)
        curves.append(_Curve(begin, plan.length_m, side))
    return plan, curves


def _heights(
    road_class: RoadClass, draws: Draws, length_m: float
) -> tuple[tuple[float, Coefficients], ...]:
    """Parabolas between slopes; level on streets."""
    if not road_class.slope_max:
        return constant(0.0)
    stations, slopes = [0.0], [0.0]
    while stations[-1] < length_m:
        stations.append(stations[-1] + draws.between(200.0, 400.0, 1.0))
        slopes.append(draws.between(-road_class.slope_max, road_class.slope_max, 0.001))
    rows, height = list[tuple[float, Coefficients]](), 0.0
    for (s, slope), (after, next_slope) in itertools.pairwise(zip(stations, slopes, strict=True)):
        span = after - s
        rows.append((s, (height, slope, 0.5 * (next_slope - slope) / span, 0.0)))
        height += 0.5 * (slope + next_slope) * span
    return tuple(rows)


def _edge_m(road_class: RoadClass) -> float:
    """From the middle to the outer edge of what is driven, parked or walked on."""
    driven = road_class.lanes * road_class.lane_m
    if road_class is STREET:
        return driven + _PARKING_M + _FOOTWAY_M
    middle = _MEDIAN_M if road_class is MOTORWAY else 0.0
    return middle + driven + _SHOULDER_M[road_class.name]


def _lanes(road_class: RoadClass) -> list[LanePlan]:
    edge = MarkPlan("solid", 0.3 if road_class is MOTORWAY else 0.12)
    between = MarkPlan("broken", 0.15, 6.0, 12.0, "both")
    lanes = []
    for side in (1, -1):
        rows: list[tuple[str, float, MarkPlan | None, float]] = []
        if road_class is MOTORWAY:
            rows.append(("median", _MEDIAN_M, MarkPlan("solid", 0.15), 0.0))
        for lane in range(road_class.lanes):
            mark = edge if lane == road_class.lanes - 1 else between
            rows.append(("driving", road_class.lane_m, mark, 0.0))
        if road_class is STREET:
            rows.append(("parking", _PARKING_M, None, 0.0))
            rows.append(("sidewalk", _FOOTWAY_M, None, _KERB_M))
        else:
            rows.append(("shoulder", _SHOULDER_M[road_class.name], None, 0.0))
        lanes += [
            LanePlan(side * index, kind, width, mark, raised)
            for index, (kind, width, mark, raised) in enumerate(rows, start=1)
        ]
    return lanes


def _centre(road_class: RoadClass) -> MarkPlan | None:
    if road_class is MOTORWAY:
        return None
    if road_class is STREET:
        return MarkPlan("broken", 0.12, 3.0, 6.0, "both")
    return MarkPlan("broken", 0.12, 4.0, 8.0, "both")


def _rails(road_class: RoadClass, curves: list[_Curve], length_m: float, beside: _Beside) -> None:
    """Guard rails: along all of a motorway, else at the outer side of curves."""

    def rail(s_m: float, along_m: float, t_m: float) -> None:
        beside.add(
            *("barrier", s_m, t_m),
            subtype="guardRail",
            width_m=0.3,
            height_m=_RAIL_M,
            along_m=along_m,
        )

    outer = _edge_m(road_class) + 0.5
    if road_class is MOTORWAY:
        for t_m in (outer, 0.9, -0.9, -outer):
            rail(0.0, length_m, t_m)
    elif road_class is not STREET:
        for curve in curves:
            rail(curve.begin_m, curve.end_m - curve.begin_m, -curve.side * outer)


def _over(road_class: RoadClass, draws: Draws, beside: _Beside) -> None:
    """Bridges over the road with their piers, and gantries, where the ego drives."""
    aside = _edge_m(road_class) + _BANK_M
    first, last = road_class.begin_m + 60.0, road_class.begin_m + road_class.drive_m
    count = road_class.bridges + road_class.gantries
    for index in range(count):
        width = (last - first) / count
        s_m = draws.between(first + index * width, first + (index + 0.8) * width)
        # Bridges and gantries by turns, as long as there are both.
        if index % 2 == 0 or index >= 2 * road_class.gantries:
            long = draws.between(6.0, 14.0)
            beside.add(
                *("none", s_m, 0.0),
                name="bridge",
                z_m=_HEADROOM_M + draws.between(0.0, 1.0),
                length_m=long,
                width_m=2.0 * aside + 12.0,
                height_m=1.4,
            )
            piers = (aside, -aside, 0.0) if road_class is MOTORWAY else (aside, -aside)
            for t_m in piers:
                beside.add("pole", s_m, t_m, name="pier", radius_m=0.45, height_m=_HEADROOM_M)
        else:
            beside.add(
                *("gantry", s_m, 0.0),
                length_m=0.6,
                width_m=2.0 * aside,
                height_m=_GANTRY_M,
            )


def _covers(road_class: RoadClass, draws: Draws, length_m: float, beside: _Beside) -> None:
    """Manhole covers in the lanes; on motorways joints of steel across them."""
    middle = _MEDIAN_M if road_class is MOTORWAY else 0.0
    s_m = draws.between(*road_class.covers_m)
    while s_m < length_m:
        side = 1.0 if draws.happens(0.35) else -1.0
        if road_class is MOTORWAY:
            wide = road_class.lanes * road_class.lane_m
            beside.add(
                *("barrier", s_m, side * (middle + 0.5 * wide)),
                name="joint",
                length_m=0.35,
                width_m=wide,
                height_m=_STEEL_M,
            )
        else:
            t_m = side * (0.5 * road_class.lane_m + draws.between(-0.8, 0.8))
            beside.add(
                *("barrier", s_m, t_m), name="manhole cover", radius_m=0.35, height_m=_STEEL_M
            )
        s_m += draws.between(*road_class.covers_m)


def _bank(road_class: RoadClass, draws: Draws, length_m: float, beside: _Beside) -> None:
    """Trees, and in streets houses and lamps."""
    edge = _edge_m(road_class)
    for side in (1.0, -1.0):
        if road_class is STREET:
            _houses(draws, length_m, side * (edge + 6.0), beside)
            beside.add(
                *("streetLamp", 10.0, side * (edge - 0.3)),
                radius_m=0.08,
                height_m=7.5,
                along_m=length_m - 20.0,
                every_m=35.0,
            )
            continue
        s_m = draws.between(10.0, 40.0)
        while s_m < length_m:
            beside.add(
                *("tree", s_m, side * (edge + _BANK_M + draws.between(0.0, 6.0))),
                radius_m=draws.between(0.9, 1.8),
                height_m=draws.between(5.0, 10.0),
            )
            s_m += draws.between(15.0, 60.0)


def _houses(draws: Draws, length_m: float, t_m: float, beside: _Beside) -> None:
    s_m = draws.between(8.0, 16.0)
    while s_m < length_m - 12.0:
        long = draws.between(9.0, 18.0)
        if draws.happens(0.8):
            beside.add(
                *("building", s_m + 0.5 * long, t_m),
                length_m=long,
                width_m=9.0,
                height_m=draws.between(6.0, 14.0),
            )
        s_m += long + draws.between(1.0, 8.0)
