"""Made-up traffic in which everybody reacts: for the storyboard bench and for checks of bytes.

Cars drive one behind the other on a ring of a motorway's five lanes. The first of each queue
changes its speed again and again; the others keep a time gap, change lanes when they come too near
and change back. All of it is triggered by conditions on speeds, headways and distances. Cars of
another program follow driver models.
"""

from __future__ import annotations

import math

from twin.road.opendrive.records import (
    Cubic,
    GeometryRecord,
    Lane,
    LaneSection,
    RoadLink,
    RoadNetwork,
    RoadRecord,
)
from twin.scenario.storyboard.program.actions import (
    ControllerAction,
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    LaneChangeAction,
    LongitudinalDistanceAction,
    MotionLimits,
    SpeedAction,
    TeleportAction,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    Condition,
    ConditionEdge,
    DistanceFrame,
    DistanceKind,
    EntityExpression,
    RelativeDistanceCondition,
    SpeedAxis,
    SpeedCondition,
    TimeHeadwayCondition,
    Trigger,
)
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.places import FixedPosition
from twin.scenario.storyboard.program.program import (
    DriverModel,
    ElementKind,
    InitAction,
    Program,
    StoryElement,
)

LANES = 5
LANE_M = 3.5
RADIUS_M = 400.0
QUEUE = 4
"""Cars of a queue: each fourth leads one."""
_RUNS = 1000
_TOGETHER = 3.0


def ring_network() -> RoadNetwork:
    """A ring of two half circles, each a road with five lanes on the right."""
    roads = {}
    for number in range(2):
        other = str(1 - number)
        side = 1.0 if number else -1.0
        length = math.pi * RADIUS_M
        curvature = 1.0 / RADIUS_M
        arc = GeometryRecord(
            *(0.0, length, 0.0, side * RADIUS_M, number * math.pi, "arc"),
            *((curvature, curvature), (0.0,) * 4, (0.0,) * 4, None, 1),
        )
        lanes = tuple(_lane(-k) for k in range(1, LANES + 1))
        section = LaneSection(0.0, length, (), _lane(0), lanes, 1)
        links = (RoadLink("road", other, "end", 1), RoadLink("road", other, "start", 1))
        roads[str(number)] = RoadRecord(
            *(str(number), "", length, "RHT", None, *links, (), (arc,), (), ()),
            *((), (section,), (), (), 1),
        )
    return RoadNetwork("ring", (1, 6), "ring", "", None, roads, {}, ())


def reacting_traffic(cars: int, variant: int = 0) -> Program:
    """A program of ``cars`` cars; variants begin with other speeds and gaps."""
    elements = [
        StoryElement(ElementKind.STORYBOARD, "storyboard", -1),
        StoryElement(ElementKind.STORY, "story", 0),
        StoryElement(ElementKind.ACT, "act", 1),
    ]
    init = []
    for car in range(cars):
        lane = -1 - (car // QUEUE) % LANES
        s = 10.0 + 22.0 * (cars - car) + 3.0 * variant
        init.append(InitAction(TeleportAction(on_ring(s, lane)), car))
        init.append(InitAction(_speed(22.0 + car % 5 + variant, 0.0), car))
        _add_group(elements, car, _reactions(car, lane, variant))
    return Program(
        f"traffic-{cars}-{variant}",
        tuple(_entity(car) for car in range(cars)),
        tuple(elements),
        tuple(init),
    )


def driver_traffic(cars: int) -> Program:
    """Cars with driver models of three kinds, close together on the middle lanes."""
    init = []
    for car in range(cars):
        lane = -2 - car % 3
        init.append(InitAction(TeleportAction(on_ring(10.0 + 9.0 * (cars - car), lane)), car))
        init.append(InitAction(_speed(18.0 + car % 7, 0.0), car))
        init.append(InitAction(ControllerAction(True, True, car % 3), car))
    models = (DriverModel(33.0), DriverModel(22.0, politeness=0.1), DriverModel(28.0, 1.0))
    elements = (StoryElement(ElementKind.STORYBOARD, "storyboard", -1),)
    entities = tuple(_entity(car) for car in range(cars))
    return Program(f"drivers-{cars}", entities, elements, tuple(init), models=models)


def _reactions(car: int, lane: int, variant: int) -> list[tuple[Trigger | None, object]]:
    """Start triggers and actions of a car's events."""
    if car % QUEUE == 0:
        greater, less = ComparisonRule.GREATER, ComparisonRule.LESS
        return [
            (_when(car, SpeedCondition(21.5, greater, SpeedAxis.TOTAL)), _speed(14.0, 5.0)),
            (_when(car, SpeedCondition(14.5, less, SpeedAxis.TOTAL)), _speed(27.0 + variant, 7.0)),
        ]
    ahead = car - 1
    aside = lane - 1 if lane > -LANES else lane + 1
    frame, kind = DistanceFrame.ROAD, DistanceKind.LONGITUDINAL
    near = TimeHeadwayCondition(ahead, 0.8, ComparisonRule.LESS, True, frame, kind)
    far = RelativeDistanceCondition(ahead, 30.0, ComparisonRule.GREATER, True, frame, kind)
    keep = LongitudinalDistanceAction(
        *(ahead, 1.1 + 0.1 * variant, True, True, True, frame, Displacement.BEHIND),
        MotionLimits(3.0, 5.0, 38.0),
    )
    return [
        (None, keep),
        (_when(car, near), _change(aside)),
        (_when(car, far), _change(lane)),
    ]


def _add_group(
    elements: list[StoryElement], car: int, reactions: list[tuple[Trigger | None, object]]
) -> None:
    elements.append(StoryElement(ElementKind.GROUP, f"g{car}", 2, actors=(car,)))
    elements.append(StoryElement(ElementKind.MANEUVER, f"m{car}", len(elements) - 1))
    maneuver = len(elements) - 1
    for number, (start, action) in enumerate(reactions):
        runs = 1 if start is None else _RUNS
        name = f"e{car}.{number}"
        elements.append(
            StoryElement(ElementKind.EVENT, name, maneuver, start=start, executions_max=runs)
        )
        parent = len(elements) - 1
        elements.append(StoryElement(ElementKind.ACTION, name + "a", parent, action=action))  # type: ignore[arg-type]


def _when(car: int, expression: EntityExpression) -> Trigger:
    condition = Condition("c", expression, ConditionEdge.NONE, 0.0, (car,), False)
    return Trigger(((condition,),))


def _speed(speed_mps: float, seconds: float) -> SpeedAction:
    shape = DynamicsShape.SINUSOIDAL if seconds else DynamicsShape.STEP
    return SpeedAction(TransitionDynamics(shape, DynamicsDimension.TIME, seconds), -1, speed_mps)


def _change(lane: int) -> LaneChangeAction:
    dynamics = TransitionDynamics(DynamicsShape.CUBIC, DynamicsDimension.TIME, _TOGETHER)
    return LaneChangeAction(dynamics, -1, lane, 0.0)


def on_ring(s_m: float, lane: int) -> FixedPosition:
    """Middle of a lane on the first half circle."""
    t = (lane + 0.5) * LANE_M
    angle = s_m / RADIUS_M - math.pi / 2
    radius = RADIUS_M - t
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return FixedPosition(x, y, 0.0, angle + math.pi / 2, 0.0, 0.0, 0, s_m, t, lane, 0.0)


def _lane(lane_id: int) -> Lane:
    width = (Cubic(0.0, LANE_M, 0.0, 0.0, 0.0),) if lane_id else ()
    link = (lane_id,) if lane_id else ()
    kind = "driving" if lane_id else "none"
    return Lane(lane_id, kind, False, "standard", width, (), link, link, (), (), (), (), 1)


def _entity(car: int) -> StoryboardEntity:
    box = BodyBox(1.4, 0.0, 0.8, 4.6, 1.9, 1.6)
    return StoryboardEntity(
        f"car{car}", EntityCategory.CAR, box, 70.0, 10.0, 10.0, 2.8, 1500.0, False
    )
