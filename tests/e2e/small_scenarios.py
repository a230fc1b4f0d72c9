"""Small scenarios, one thing each, that esmini plays, too: two cars on a road that bends."""

from __future__ import annotations

import re
from collections.abc import Iterator

_LANES = "".join(
    f"<{side}>"
    + "".join(
        f'<lane id="{lane}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        for lane in ids
    )
    + f"</{side}>"
    + ('<center><lane id="0" type="none"/></center>' if side == "left" else "")
    for side, ids in (("left", (3, 2, 1)), ("right", (-1, -2, -3)))
)
ROADS = (
    '<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="0" length="1200" junction="-1" '
    'rule="RHT"><planView><geometry s="0" x="0" y="0" hdg="0" length="500"><line/></geometry>'
    '<geometry s="500" x="500" y="0" hdg="0" length="700"><arc curvature="0.004"/></geometry>'
    f'</planView><lanes><laneSection s="0">{_LANES}</laneSection></lanes></road></OpenDRIVE>'
)
"""500 m straight, then an arc of 250 m radius to the left; three lanes a side."""
END_S = 11


def car(name: str) -> str:
    """A car of 5 m."""
    return (
        f'<ScenarioObject name="{name}"><Vehicle name="{name}" vehicleCategory="car"><BoundingBox>'
        '<Center x="1.4" y="0" z="0.9"/><Dimensions width="2" length="5" height="1.8"/>'
        '</BoundingBox><Performance maxSpeed="70" maxDeceleration="10" maxAcceleration="10"/>'
        '<Axles><FrontAxle maxSteering="0.5" wheelDiameter="0.8" trackWidth="1.7" '
        'positionX="2.98" positionZ="0.4"/><RearAxle maxSteering="0" wheelDiameter="0.8" '
        'trackWidth="1.7" positionX="0" positionZ="0.4"/></Axles></Vehicle></ScenarioObject>'
    )


def lane(s: float, lane_id: int = -2, offset: float = 0.0) -> str:
    """A position on a lane."""
    return (
        f'<Position><LanePosition roadId="0" laneId="{lane_id}" s="{s}" offset="{offset}"/>'
        "</Position>"
    )


def world(x: float, y: float, h: float | None = None) -> str:
    """A position in the world."""
    heading = "" if h is None else f' h="{h}"'
    return f'<Position><WorldPosition x="{x}" y="{y}" z="0"{heading}/></Position>'


def private(inner: str) -> str:
    """An action of an entity."""
    return f"<PrivateAction>{inner}</PrivateAction>"


def teleport(position: str) -> str:
    """Be somewhere."""
    return private(f"<TeleportAction>{position}</TeleportAction>")


def speed(target: float, shape: str = "step", dimension: str = "time", value: float = 0.0) -> str:
    """Change speed."""
    return _speed(f'<AbsoluteTargetSpeed value="{target}"/>', shape, dimension, value)


def relative_speed(value: float, kind: str, continuous: str) -> str:
    """Change speed to that of B within a second."""
    target = (
        f'<RelativeTargetSpeed entityRef="B" value="{value}" speedTargetValueType="{kind}" '
        f'continuous="{continuous}"/>'
    )
    return _speed(target, "linear", "time", 1.0)


def _speed(target: str, shape: str, dimension: str, value: float) -> str:
    return private(
        f'<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="{shape}" '
        f'dynamicsDimension="{dimension}" value="{value}"/><SpeedActionTarget>{target}'
        "</SpeedActionTarget></SpeedAction></LongitudinalAction>"
    )


def lane_change(target: int, shape: str, dimension: str, value: float, offset: float = 0.0) -> str:
    """Change to a lane."""
    return private(
        f'<LateralAction><LaneChangeAction targetLaneOffset="{offset}"><LaneChangeActionDynamics '
        f'dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/>'
        f'<LaneChangeTarget><AbsoluteTargetLane value="{target}"/></LaneChangeTarget>'
        "</LaneChangeAction></LateralAction>"
    )


def lane_offset(target: float, shape: str) -> str:
    """Move within the lane, by 0.5 m/s2."""
    return private(
        '<LateralAction><LaneOffsetAction continuous="false"><LaneOffsetActionDynamics '
        f'dynamicsShape="{shape}" maxLateralAcc="0.5"/><LaneOffsetTarget>'
        f'<AbsoluteTargetLaneOffset value="{target}"/></LaneOffsetTarget></LaneOffsetAction>'
        "</LateralAction>"
    )


def keep_distance(attributes: str, limits: str = "") -> str:
    """Keep a distance behind B."""
    return private(
        f'<LongitudinalAction><LongitudinalDistanceAction entityRef="B" {attributes} '
        f'displacement="trailingReferencedEntity">{limits}</LongitudinalDistanceAction>'
        "</LongitudinalAction>"
    )


def synchronize(final: str) -> str:
    """Be 100 m ahead when B is 200 m ahead."""
    target, master = lane(105)[10:-11], lane(210, -3)[10:-11]
    speeds = f"<FinalSpeed>{final}</FinalSpeed>" if final else ""
    return private(
        f'<SynchronizeAction masterEntityRef="B"><TargetPositionMaster>{master}'
        f"</TargetPositionMaster><TargetPosition>{target}</TargetPosition>{speeds}"
        "</SynchronizeAction>"
    )


def follow(shape: str, timing: str = "<None/>") -> str:
    """Follow a trajectory."""
    return private(
        '<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory name="t" closed="false">'
        f"<Shape>{shape}</Shape></Trajectory></TrajectoryRef><TimeReference>{timing}"
        '</TimeReference><TrajectoryFollowingMode followingMode="follow"/></FollowTrajectoryAction>'
        "</RoutingAction>"
    )


def after(time_s: float) -> str:
    """A condition: the time has come."""
    return _value(f'<SimulationTimeCondition value="{time_s}" rule="greaterOrEqual"/>')


def _value(inner: str) -> str:
    return (
        '<Condition name="c" delay="0" conditionEdge="none"><ByValueCondition>'
        f"{inner}</ByValueCondition></Condition>"
    )


def state(kind: str, name: str, word: str) -> str:
    """A condition: a storyboard element is in a state."""
    return _value(
        f'<StoryboardElementStateCondition storyboardElementType="{kind}" '
        f'storyboardElementRef="{name}" state="{word}"/>'
    )


def by_entity(inner: str, edge: str = "none", delay: float = 0.0) -> str:
    """A condition of A."""
    return (
        f'<Condition name="c" delay="{delay}" conditionEdge="{edge}"><ByEntityCondition>'
        '<TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="A"/>'
        f"</TriggeringEntities><EntityCondition>{inner}</EntityCondition></ByEntityCondition>"
        "</Condition>"
    )


def event(
    name: str, action: str, condition: str, priority: str = "parallel", executions: int = 1
) -> str:
    """An event with one action."""
    trigger = f"<StartTrigger><ConditionGroup>{condition}</ConditionGroup></StartTrigger>"
    return (
        f'<Event name="{name}" priority="{priority}" maximumExecutionCount="{executions}">'
        f'<Action name="{name} action">{action}</Action>{trigger if condition else ""}</Event>'
    )


def scenario(a: str, b: str, events: str, others: str = "") -> str:
    """Init actions of A and B, events of A, and of B from 3 s on."""
    groups = "".join(
        f'<Act name="act {name}"><ManeuverGroup name="group {name}" maximumExecutionCount="1">'
        f'<Actors selectTriggeringEntities="false"><EntityRef entityRef="{name}"/></Actors>'
        f'<Maneuver name="maneuver {name}">{inner}</Maneuver></ManeuverGroup></Act>'
        for name, inner in (("A", events), ("B", others))
        if inner
    )
    return (
        '<OpenSCENARIO><FileHeader revMajor="1" revMinor="2" date="2026-01-31T10:00:00" '
        'description="" author=""/><CatalogLocations/><RoadNetwork>'
        '<LogicFile filepath="small.xodr"/></RoadNetwork>'
        f"<Entities>{car('A')}{car('B')}</Entities><Storyboard><Init><Actions>"
        f'<Private entityRef="B">{b}</Private><Private entityRef="A">{a}</Private></Actions></Init>'
        f'<Story name="story">{groups}</Story><StopTrigger><ConditionGroup>{after(END_S)}'
        "</ConditionGroup></StopTrigger></Storyboard></OpenSCENARIO>"
    )


_COUPLED = '<Trailer><TrailerRef entityRef="B"/></Trailer>'


def towing(events: str, start: str, coupled: str = _COUPLED) -> str:
    """Truck A with a trailer B, which esmini wants to know first."""
    cars = car("A"), car("B")
    text = scenario(start, teleport(lane(7)), events).replace('revMinor="2"', 'revMinor="3"')
    if coupled:
        text = re.sub('<Private entityRef="B">.*?</Private>', "", text)
    coupler = '<TrailerCoupler dx="4.5"/>'
    trailer = cars[1].replace('"car"', '"trailer"').replace("</Vehicle>", f"{coupler}</Vehicle>")
    hitch = f'<TrailerHitch dx="-1.2"/>{coupled}</Vehicle>'
    return text.replace("".join(cars), trailer + cars[0].replace("</Vehicle>", hitch))


def trailer_action(inner: str) -> str:
    """Couple, or let go of, a trailer."""
    return private(f"<TrailerAction>{inner}</TrailerAction>")


A = teleport(lane(5)) + speed(10)
B = teleport(lane(120, -3)) + speed(12)
IN_THE_ARC = teleport(lane(520)) + speed(15)
MASTER = teleport(lane(10, -3)) + speed(20)
BRAKING = event("slower", speed(5, "linear", "time", 3), after(3))
LIMITS = '<DynamicConstraints maxAcceleration="3" maxDeceleration="4" maxSpeed="30"/>'
TIMING = '<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'


def small_scenarios() -> Iterator[tuple[str, str]]:
    """Names and texts."""
    for name, start, action in _actions():
        yield name, scenario(start, B, event("e", action, after(1)))
    for name, start, b in _places():
        yield name, scenario(start, b, event("e", teleport(lane(700, -1, 0.4)), after(4)))
    for name, action in _distances():
        yield name, scenario(A, B, event("e", action, after(1)), BRAKING)
    for name, final, speed_mps in _arrivals():
        start = teleport(lane(5)) + speed(speed_mps)
        yield name, scenario(start, MASTER, event("e", synchronize(final), after(1)))
        yield f"{name}, at once", scenario(start, MASTER, event("e", synchronize(final), ""))
    for name, condition in _conditions():
        faster = event("faster", speed(18, "linear", "rate", 3), after(2))
        slower = event("slower", speed(9, "linear", "rate", 3), after(6))
        waiting = event("e", lane_offset(0.5, "sinusoidal"), condition)
        yield name, scenario(A, teleport(lane(80)), waiting + faster + slower)
    for name, events in _events():
        yield name, scenario(A, B, events)
    yield from _trains()


def _places() -> Iterator[tuple[str, str, str]]:
    """Positions relative to B, which drives along the road or against it."""
    oriented = '<Orientation h="0.2" type="relative"/>'
    for lane_id in (-2, 2):
        b = teleport(lane(560, lane_id)) + speed(12)
        for words, attributes in (
            ("Lane", 'dLane="1" ds="20" offset="0.3"'),
            ("Lane", 'dLane="-1" ds="-20"'),
            ("Road", 'ds="20" dt="1"'),
            ("Object", 'dx="20" dy="1"'),
            ("World", 'dx="5" dy="1"'),
        ):
            name = f"Relative{words}Position"
            for inner in ("", oriented) if words != "World" else ("",):
                text = f'<Position><{name} entityRef="B" {attributes}>{inner}</{name}></Position>'
                title = f"{name} {attributes} {inner[13:20]} of lane {lane_id}"
                yield title, teleport(text) + speed(11), b


def _actions() -> Iterator[tuple[str, str, str]]:
    for shape in ("linear", "cubic", "sinusoidal", "step"):
        for dimension, lateral, change in (("time", 3, 2), ("distance", 20, 30), ("rate", 2, 4)):
            words = f"{shape} by {dimension}"
            yield f"lane change {words}", A, lane_change(-1, shape, dimension, lateral)
            yield f"speed {words}", A, speed(20, shape, dimension, change)
            yield f"stop {words}", A, speed(0, shape, dimension, change)
        yield f"lane change {shape} in the arc", IN_THE_ARC, lane_change(-3, shape, "time", 4, 0.3)
        yield f"lane offset {shape}", A, lane_offset(1.2, shape)
        yield f"lane offset {shape} in the arc", IN_THE_ARC, lane_offset(-1.2, shape)
    against = teleport(lane(540, 2)) + speed(10)
    yield "lane change against the road", against, lane_change(3, "sinusoidal", "time", 3)
    yield "backwards", A, speed(-3, "linear", "time", 2)
    line = "".join(f"<Vertex>{world(x, y)}</Vertex>" for x, y in ((15, -6), (85, -3)))
    yield "straight trajectory", A, follow(f"<Polyline>{line}</Polyline>")
    turning = "".join(f"<Vertex>{world(x, y, h)}</Vertex>" for x, y, h in ((15, -6, 0), (70, 2, 1)))
    yield "trajectory with orientations", A, follow(f"<Polyline>{turning}</Polyline>")
    timed = "".join(
        f'<Vertex time="{time}">{world(x, -6)}</Vertex>' for time, x in ((0, 15), (6, 75))
    )
    yield "trajectory with times", A, follow(f"<Polyline>{timed}</Polyline>", TIMING)
    spiral = (
        f'<Clothoid curvature="0.0" curvaturePrime="0.0005" length="60">{world(15, -6)}</Clothoid>'
    )
    yield "clothoid", A, follow(spiral)


def _distances() -> Iterator[tuple[str, str]]:
    for words, attributes in (
        ("distance", 'distance="20" continuous="true" freespace="false"'),
        ("time gap", 'timeGap="2" continuous="true" freespace="true"'),
        ("distance once", 'distance="60" continuous="false" freespace="false"'),
    ):
        yield f"keep {words}", keep_distance(attributes)
        yield f"keep {words} with limits", keep_distance(attributes, LIMITS)
    yield "speed of another", relative_speed(-2, "delta", "true")
    yield "share of the speed of another", relative_speed(0.5, "factor", "false")


def _arrivals() -> Iterator[tuple[str, str, float]]:
    final = '<AbsoluteSpeed value="{}">{}</AbsoluteSpeed>'
    yield "arrive", final.format(15, ""), 10
    yield "arrive slowly", final.format(5, ""), 25
    yield "arrive fast", final.format(30, ""), 3
    steady = '<TargetDistanceSteadyState distance="20"/>'
    yield "arrive steady for a way", final.format(15, steady), 10
    yield "arrive from rest", final.format(5, '<TargetDistanceSteadyState distance="10"/>'), 0
    yield "arrive steady for a time", final.format(15, '<TargetTimeSteadyState time="2"/>'), 10
    master = '<RelativeSpeedToMaster value="-2" speedTargetValueType="delta"/>'
    yield "arrive relative to the master", master, 10


def _conditions() -> Iterator[tuple[str, str]]:
    faster = '<SpeedCondition value="15.001" rule="greaterThan"/>'
    for edge in ("none", "rising", "falling", "risingOrFalling"):
        for delay in (0.0, 0.5):
            yield f"edge {edge}, delay {delay}", by_entity(faster, edge, delay)
    yield "traveled", by_entity('<TraveledDistanceCondition value="20.05"/>')
    collision = '<CollisionCondition><EntityRef entityRef="B"/></CollisionCondition>'
    yield "collision", by_entity(collision)
    reached = f'<ReachPositionCondition tolerance="2.03">{lane(55)}</ReachPositionCondition>'
    yield "reached", by_entity(reached)
    yield "acceleration", by_entity('<AccelerationCondition value="2" rule="greaterThan"/>')
    for lanes, others in (("0", ""), ("0", '<EntityRef entityRef="B"/>'), ("1", "")):
        # Free until B is near; a lane that is always free never stops being so.
        clear = (
            '<RelativeClearanceCondition distanceForward="40.05" distanceBackward="10" '
            f'freeSpace="false" oppositeLanes="false"><RelativeLaneRange from="{lanes}" '
            f'to="{lanes}"/>{others}</RelativeClearanceCondition>'
        )
        yield f"lane {lanes} free of {'B' if others else 'all'}", by_entity(clear, "falling")
        yield f"lane {lanes} is free of {'B' if others else 'all'}", by_entity(clear)
    for freespace in ("true", "false"):
        gap = f'freespace="{freespace}" rule="lessThan"'
        along = 'coordinateSystem="road" relativeDistanceType="longitudinal"'
        for kind in ("longitudinal", "euclidianDistance"):
            yield (
                f"distance {kind}, freespace {freespace}",
                by_entity(
                    f'<RelativeDistanceCondition entityRef="B" relativeDistanceType="{kind}" '
                    f'value="50" {gap}/>'
                ),
            )
        headway = f'<TimeHeadwayCondition entityRef="B" value="4.01" {gap} {along}/>'
        yield f"headway, freespace {freespace}", by_entity(headway)
        collision = (
            f'<TimeToCollisionCondition value="4.01" {gap} {along}><TimeToCollisionConditionTarget>'
            '<EntityRef entityRef="B"/></TimeToCollisionConditionTarget></TimeToCollisionCondition>'
        )
        yield f"time to collision, freespace {freespace}", by_entity(collision)


def _events() -> Iterator[tuple[str, str]]:
    aside = event("e", lane_change(-1, "sinusoidal", "time", 3), after(1))
    faster = speed(20, "linear", "time", 1)
    yield "override", aside + event("f", speed(20), after(2), "override")
    back = lane_change(-2, "sinusoidal", "time", 3)
    yield "override by the same kind", aside + event("f", back, after(2.3), "override")
    yield "parallel of the same kind", aside + event("f", lane_offset(0.5, "cubic"), after(2.3))
    yield "skip", aside + event("f", faster, after(2.5), "skip")
    yield "executions", aside + event("f", faster, after(2), "override", 3)
    chain = event("f", faster, state("event", "e", "completeState"))
    yield (
        "chain",
        aside + chain + event("g", speed(5), state("action", "f action", "endTransition")),
    )
    yield (
        "chain at the beginning",
        (
            event("e", speed(12), "")
            + event("f", speed(14), state("action", "e action", "endTransition"))
            + event("g", speed(16), state("action", "f action", "endTransition"))
        ),
    )


def _trains() -> Iterator[tuple[str, str]]:
    change = event("e", lane_change(-3, "sinusoidal", "time", 3), after(1))
    yield "train changes lanes", towing(change, A)
    yield "train drives into the arc", towing(change, teleport(lane(450)) + speed(15))
    yield "train is put elsewhere", towing(event("e", teleport(lane(520)), after(4)), A)
    coupling = trailer_action('<ConnectTrailerAction trailerRef="B"/>')
    letting_go = trailer_action("<DisconnectTrailerAction/>")
    events = event("e", coupling, after(1)) + event("f", letting_go, after(6))
    yield "trailer is coupled and let go", towing(events, A, "")
