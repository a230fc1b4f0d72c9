"""Plans of the roads that ship: their lines, cross sections, marks, signs and heights.

Widths and marks are those of German roads in round numbers. Motorway: cross section RQ 36 of the
guidelines for motorways (RAA 2008) has lanes of 3.75 m, shoulders of 2.5 m and a median of 4 m.
Rural road: RQ 11 of the guidelines for rural roads (RAL 2012) has lanes of 3.5 m; radii, clothoids
and slopes are those of a winding road of design class EKL 3 or 4. Streets and junctions: lanes of
3.25 m, parking of 2 m and footways of 2.5 m (RASt 06). Marks: strokes of 6 m and gaps of 12 m on a
motorway, 4 m and 8 m on a rural road, 3 m and 6 m in a town (RMS 1993).
"""

from __future__ import annotations

import itertools
import math

from twin.road.shipped.xml_parts import (
    Coefficients,
    LanePlan,
    MarkPlan,
    PlanView,
    constant,
    crosswalk,
    cubics,
    document,
    element,
    guard_rail,
    road,
    section,
    signal,
)

_KMH = 1.0 / 3.6
_KERB_M = 0.12
_EDGE = MarkPlan("solid", 0.12)
_TOWN_CENTRE = MarkPlan("broken", 0.12, 3.0, 6.0, "both")


def motorway() -> bytes:
    """Three lanes each way, a median and hard shoulders; straight and level, 1.5 km."""
    between = MarkPlan("broken", 0.15, 6.0, 12.0, "both")
    edge = MarkPlan("solid", 0.3)
    lanes = []
    for side in (1, -1):
        lanes += [
            LanePlan(side * 1, "median", 2.0, MarkPlan("solid", 0.15)),
            LanePlan(side * 2, "driving", 3.75, between),
            LanePlan(side * 3, "driving", 3.75, between),
            LanePlan(side * 4, "driving", 3.75, edge),
            LanePlan(side * 5, "shoulder", 2.5),
        ]
    text = road(
        PlanView().add(1500.0),
        section(0.0, lanes, None),
        road_id=0,
        name="motorway",
        kind="motorway",
        speed_mps=130.0 * _KMH,
    )
    return document("motorway", text)


_RURAL_LINE = (
    (150.0, 0.0, 0.0),
    (60.0, 0.0, 1 / 250),
    (140.0, 1 / 250, 1 / 250),
    (60.0, 1 / 250, 0.0),
    (90.0, 0.0, 0.0),
    (50.0, 0.0, -1 / 160),
    (100.0, -1 / 160, -1 / 160),
    (50.0, -1 / 160, 0.0),
    (40.0, 0.0, 0.0),
    (50.0, 0.0, 1 / 200),
    (110.0, 1 / 200, 1 / 200),
    (50.0, 1 / 200, 0.0),
    (200.0, 0.0, 0.0),
)
"""Pieces: length [m], curvature at the beginning and the end [1/m]."""
_RURAL_SLOPES = (
    *((0.0, 0.0), (120.0, 0.0), (280.0, 0.05), (420.0, 0.05)),
    *((640.0, -0.04), (760.0, -0.04), (900.0, 0.02), (1150.0, 0.02)),
)
"""Station [m] and slope; linear between them, so heights are parabolas."""
_TILT_MAX_RAD = math.radians(3.0)
"""Superelevation in arcs: about 5 %."""


def rural() -> bytes:
    """A winding road with a lane each way: arcs between clothoids, hills, tilt; 1.15 km."""
    plan = PlanView()
    tilts: list[tuple[float, Coefficients]] = []
    for length, start, end in _RURAL_LINE:
        # The outer side of a curve is the higher one: to the left of a curve to the right.
        tilt, target = (-math.copysign(_TILT_MAX_RAD, k) if k else 0.0 for k in (start, end))
        tilts.append((plan.length_m, (tilt, (target - tilt) / length, 0.0, 0.0)))
        plan.add(length, start, end)
    heights: list[tuple[float, Coefficients]] = []
    height = 0.0
    for (s, slope), (after, next_slope) in itertools.pairwise(_RURAL_SLOPES):
        length = after - s
        heights.append((s, (height, slope, 0.5 * (next_slope - slope) / length, 0.0)))
        height += 0.5 * (slope + next_slope) * length
    lanes = []
    for side in (1, -1):
        lanes += [LanePlan(side, "driving", 3.5, _EDGE), LanePlan(2 * side, "shoulder", 1.5)]
    profiles = element("elevationProfile", cubics("elevation", heights))
    profiles += element("lateralProfile", cubics("superelevation", tilts))
    text = road(
        plan,
        section(0.0, lanes, MarkPlan("broken", 0.12, 4.0, 8.0, "both")),
        road_id=0,
        name="rural road",
        kind="rural",
        speed_mps=100.0 * _KMH,
        profiles=profiles,
    )
    return document("rural", text)


_CROSSING_M = 150.0
_CROSSING_FREE_M = 8.0
"""Nobody parks so far before and behind the crossing."""


def street() -> bytes:
    """A street with parking lanes and footways, and a zebra crossing at 150 m; straight, 300 m."""
    low, high = _CROSSING_M - _CROSSING_FREE_M, _CROSSING_M + _CROSSING_FREE_M
    sections = ""
    for s, beside in ((0.0, "parking"), (low, "restricted"), (high, "parking")):
        lanes = []
        for side in (1, -1):
            for index, (kind, width, mark, raised) in enumerate(
                (
                    ("driving", 3.25, _EDGE, 0.0),
                    (beside, 2.0, None, 0.0),
                    ("sidewalk", 2.5, None, _KERB_M),
                ),
                start=1,
            ):
                before = (side * index,) if s > 0.0 else ()
                after = (side * index,) if s < high else ()
                lanes.append(LanePlan(side * index, kind, width, mark, raised, before, after))
        sections += section(s, lanes, _TOWN_CENTRE)
    signs = "".join(
        signal(index, "crossing", _CROSSING_M - 2.5 * way, -5.6 * way, "350", orientation=facing)
        for index, (way, facing) in enumerate(((1, "+"), (-1, "-")))
    )
    text = road(
        PlanView().add(300.0),
        sections,
        road_id=0,
        name="street",
        kind="town",
        speed_mps=50.0 * _KMH,
        beside=element("objects", crosswalk(0, _CROSSING_M, 4.0, 5.25)) + element("signals", signs),
    )
    return document("street", text)


_LANE_M = 3.25
_HALF_M = 16.0
"""From the middle of the junction to the ends of its arms."""
_ARM_M = 200.0
_CORNER_M = 1.4
"""Width of the strip that covers what the lanes for going straight on and right leave open."""
_ARMS = ("west", "north", "east", "south")
"""Clockwise; an arm's road leads from outside to the junction."""
_JUNCTION = 100


def junction() -> bytes:
    """Four arms of 200 m at right angles, with traffic lights.

    Towards the junction an arm has a lane for turning left in its middle and one for straight on
    and right; opposite turning lanes face each other.
    """
    text = "".join(_arm(index) for index in range(4))
    # Paved corners that nobody drives on come first: what overlaps them lies above in pictures.
    ways = [(arm, turn) for turn in ("right", "straight", "left") for arm in range(4)]
    connections = ""
    for index, (arm, turn) in enumerate(ways):
        text += _way(arm, turn)
        inside = element("laneLink", from_=-1 if turn == "left" else -2, to=-1)
        if turn == "right":
            inside += element("laneLink", from_=-3, to=-2)
        connections += element(
            "connection",
            inside,
            id=index,
            incomingRoad=arm,
            connectingRoad=_way_id(arm, turn),
            contactPoint="start",
        )
    text += element("junction", connections, id=_JUNCTION, name="junction", type="default")
    return document("junction", text)


def _arm(arm: int) -> str:
    heading = -0.5 * math.pi * arm
    far = _HALF_M + _ARM_M
    plan = PlanView(-far * math.cos(heading), -far * math.sin(heading), heading).add(_ARM_M)
    lanes = [
        LanePlan(2, "sidewalk", 2.5, None, _KERB_M),
        LanePlan(1, "driving", _LANE_M, _EDGE),
        LanePlan(-1, "driving", _LANE_M, MarkPlan("broken", 0.12, 3.0, 3.0, "both")),
        LanePlan(-2, "driving", _LANE_M, _EDGE),
        LanePlan(-3, "sidewalk", 2.5, None, _KERB_M),
    ]
    lights = "".join(
        signal(10 * arm + index, "traffic light", _ARM_M - 1.0, t, "1000001", light=True, z_m=z)
        for index, (t, z) in enumerate(((-5.4, 2.2), (0.0, 5.0)))
    )
    return road(
        plan,
        section(0.0, lanes, MarkPlan("solid", 0.12)),
        road_id=arm,
        name=_ARMS[arm],
        kind="town",
        speed_mps=50.0 * _KMH,
        link=element("successor", elementType="junction", elementId=_JUNCTION),
        offset=constant(0.5 * _LANE_M),
        beside=element("objects", crosswalk(arm, _ARM_M - 5.0, 4.0, 4.875))
        + element("signals", lights),
    )


def _way_id(arm: int, turn: str) -> int:
    return 10 + 10 * arm + ("left", "straight", "right").index(turn)


def _way(arm: int, turn: str) -> str:
    """A road through the junction; its reference line leads from arm to arm."""
    heading = -0.5 * math.pi * arm
    plan = PlanView(-_HALF_M * math.cos(heading), -_HALF_M * math.sin(heading), heading)
    half = 0.5 * _LANE_M
    to, lane = {"left": (1, -1), "straight": (2, -2), "right": (3, -2)}[turn]
    if turn == "straight":
        plan.add(2.0 * _HALF_M)
        offset = constant(-half)
    else:
        bend = (1.0 if turn == "left" else -1.0) / _HALF_M
        plan.add(0.5 * math.pi * _HALF_M, bend, bend)
        offset = constant(-half)
    if turn == "left":
        # From the middle of its arm to the right-hand side of the next.
        long = plan.length_m
        shift = -2.0 * half
        offset = ((0.0, (half, 0.0, 3.0 * shift / long**2, -2.0 * shift / long**3)),)
    lanes = [LanePlan(-1, "driving", _LANE_M, None, 0.0, (lane,), (1,))]
    if turn == "right":
        lanes.append(LanePlan(1, "restricted", _CORNER_M))
        lanes.append(LanePlan(-2, "sidewalk", 2.5, None, _KERB_M, (-3,), (2,)))
    elif turn == "straight" and arm < 2:
        lanes.append(LanePlan(1, "restricted", _LANE_M))
    link = element("predecessor", elementType="road", elementId=arm, contactPoint="end")
    link += element("successor", elementType="road", elementId=(arm + to) % 4, contactPoint="end")
    return road(
        plan,
        section(0.0, lanes, None),
        road_id=_way_id(arm, turn),
        name=f"{_ARMS[arm]} {turn}",
        link=link,
        junction=_JUNCTION,
        offset=offset,
    )


def track() -> bytes:
    """A lane each way between wide paved areas, as on a proving ground; straight, level, 600 m."""
    lanes = []
    for side in (1, -1):
        lanes += [LanePlan(side, "driving", 3.5, _EDGE), LanePlan(2 * side, "shoulder", 24.0)]
    text = road(
        PlanView().add(600.0),
        section(0.0, lanes, _TOWN_CENTRE),
        road_id=0,
        name="track",
        kind="rural",
        speed_mps=100.0 * _KMH,
    )
    return document("track", text)


_BEND_LINE = (
    (150.0, 0.0, 0.0),
    (50.0, 0.0, 1 / 120),
    (120.0, 1 / 120, 1 / 120),
    (50.0, 1 / 120, 0.0),
    (130.0, 0.0, 0.0),
)
"""Pieces as those of the rural road."""
_RAIL_M = 7.25
"""From the middle of the road to its guard rails: 0.75 m beside the shoulders."""


def bend() -> bytes:
    """A lane each way and paved shoulders between guard rails, a bend of 120 m; level, 500 m."""
    plan = PlanView()
    for length, start, end in _BEND_LINE:
        plan.add(length, start, end)
    lanes = []
    for side in (1, -1):
        lanes += [LanePlan(side, "driving", 3.5, _EDGE), LanePlan(2 * side, "shoulder", 3.0)]
    rails = "".join(guard_rail(i, 100.0, 320.0, t) for i, t in enumerate((-_RAIL_M, _RAIL_M)))
    text = road(
        plan,
        section(0.0, lanes, MarkPlan("broken", 0.12, 4.0, 8.0, "both")),
        road_id=0,
        name="bend",
        kind="rural",
        speed_mps=70.0 * _KMH,
        beside=element("objects", rails),
    )
    return document("bend", text)


_CROSSROADS_LANE_M = 3.5
_CORNER_RADIUS_M = 8.0
_CROSSROADS_HALF_M = _CORNER_RADIUS_M + _CROSSROADS_LANE_M
"""From the middle of the crossroads to the ends of its arms; radius of the ways round corners."""
_CROSSROADS_ARM_M = 250.0


def crossroads() -> bytes:
    """Four arms of 250 m with a lane each way, paved beside, corners of 8 m; without lights.

    As on a proving ground. Every way through it has lanes both ways: two lead straight on, four
    round a corner.
    """
    text = "".join(_crossroads_arm(index) for index in range(4))
    connections, count = "", 0
    for first, second in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)):
        text += _crossroads_way(10 + 10 * first + second, first, second)
        for arm, end, lane in ((first, "start", -1), (second, "end", 1)):
            connections += element(
                "connection",
                element("laneLink", from_=-1, to=lane),
                id=count,
                incomingRoad=arm,
                connectingRoad=10 + 10 * first + second,
                contactPoint=end,
            )
            count += 1
    text += element("junction", connections, id=_JUNCTION, name="crossroads", type="default")
    return document("crossroads", text)


def _crossroads_arm(arm: int) -> str:
    heading = -0.5 * math.pi * arm
    far = _CROSSROADS_HALF_M + _CROSSROADS_ARM_M
    plan = PlanView(-far * math.cos(heading), -far * math.sin(heading), heading)
    lanes = []
    for side in (1, -1):
        lanes += [
            LanePlan(side, "driving", _CROSSROADS_LANE_M, _EDGE),
            LanePlan(2 * side, "shoulder", _CROSSROADS_LANE_M),
        ]
    return road(
        plan.add(_CROSSROADS_ARM_M),
        section(0.0, lanes, _TOWN_CENTRE),
        road_id=arm,
        name=_ARMS[arm],
        kind="town",
        speed_mps=60.0 * _KMH,
        link=element("successor", elementType="junction", elementId=_JUNCTION),
    )


def _crossroads_way(road_id: int, first: int, second: int) -> str:
    """A road from the end of one arm to that of another, to its left or straight on."""
    heading, half = -0.5 * math.pi * first, _CROSSROADS_HALF_M
    plan = PlanView(-half * math.cos(heading), -half * math.sin(heading), heading)
    lanes = [
        LanePlan(1, "driving", _CROSSROADS_LANE_M, None, 0.0, (1,), (-1,)),
        LanePlan(-1, "driving", _CROSSROADS_LANE_M, None, 0.0, (-1,), (1,)),
    ]
    if (second - first) % 4 == 1:
        plan.add(0.5 * math.pi * half, 1.0 / half, 1.0 / half)
        lanes.append(LanePlan(2, "shoulder", _CROSSROADS_LANE_M, None, 0.0, (2,), (-2,)))
    else:
        plan.add(2.0 * half)
    ends = [
        element(name, elementType="road", elementId=arm, contactPoint="end")
        for name, arm in (("predecessor", first), ("successor", second))
    ]
    return road(
        plan,
        section(0.0, lanes, None),
        road_id=road_id,
        name=f"{_ARMS[first]} {_ARMS[second]}",
        link="".join(ends),
        junction=_JUNCTION,
    )


PLANS = {
    "bend": bend,
    "crossroads": crossroads,
    "junction": junction,
    "motorway": motorway,
    "rural": rural,
    "street": street,
    "track": track,
}
"""What writes each file, by its name."""
