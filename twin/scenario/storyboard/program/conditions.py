"""Conditions and triggers of a storyboard program.

A condition has a logical expression, an edge and a delay. The kernel evaluates the expression once
per step on the states at the beginning of the step (ASAM OpenSCENARIO XML 1.3, section 7.6).
Distances along a road count in the direction of the triggering entity.
"""

from __future__ import annotations

from enum import IntEnum

from twin.scenario.storyboard.program.places import Position
from twin.scenario.storyboard.program.record import ProgramRecord


class ComparisonRule(IntEnum):
    """Rule of a comparison."""

    EQUAL = 0
    GREATER = 1
    LESS = 2
    GREATER_OR_EQUAL = 3
    LESS_OR_EQUAL = 4
    NOT_EQUAL = 5


class ConditionEdge(IntEnum):
    """Which change of its expression makes a condition true."""

    NONE = 0
    """The expression itself."""
    RISING = 1
    FALLING = 2
    EITHER = 3


class DistanceFrame(IntEnum):
    """Coordinate system of a distance."""

    ENTITY = 0
    ROAD = 1
    LANE = 2
    TRAJECTORY = 3
    WORLD = 4


class DistanceKind(IntEnum):
    """What is measured between two places."""

    EUCLIDEAN = 0
    LONGITUDINAL = 1
    LATERAL = 2


class SpeedAxis(IntEnum):
    """Component of a velocity or acceleration, in the axes of the entity."""

    TOTAL = 0
    LONGITUDINAL = 1
    LATERAL = 2
    VERTICAL = 3


class AngleKind(IntEnum):
    """Which angle of a body."""

    HEADING = 0
    PITCH = 1
    ROLL = 2


class ElementState(IntEnum):
    """State or transition of a storyboard element."""

    STANDBY = 0
    RUNNING = 1
    COMPLETE = 2
    START_TRANSITION = 3
    END_TRANSITION = 4
    STOP_TRANSITION = 5
    SKIP_TRANSITION = 6


class EndOfRoadCondition(ProgramRecord, frozen=True):
    """Has been at the end of a road for a time."""

    duration_s: float


class CollisionCondition(ProgramRecord, frozen=True):
    """Boxes overlap with an entity (index) or, where it is -1, with any of a category.

    -1: any; -2: vehicles (car to tram); -3: pedestrians (pedestrian to animal); -4: other objects.
    """

    entity: int
    category: int
    """An :class:`EntityCategory`, or one of the numbers above."""


class OffroadCondition(ProgramRecord, frozen=True):
    """Has been on no lane for a time."""

    duration_s: float


class TimeHeadwayCondition(ProgramRecord, frozen=True):
    """Distance to another entity, divided by the own speed."""

    entity: int
    value_s: float
    rule: ComparisonRule
    freespace: bool
    frame: DistanceFrame
    kind: DistanceKind


class TimeToCollisionCondition(ProgramRecord, frozen=True):
    """Distance to an entity (index) or, where it is -1, a position, divided by closing speed."""

    entity: int
    position: Position | None
    value_s: float
    rule: ComparisonRule
    freespace: bool
    frame: DistanceFrame
    kind: DistanceKind


class AccelerationCondition(ProgramRecord, frozen=True):
    """Acceleration compared with a value."""

    value_mps2: float
    rule: ComparisonRule
    axis: SpeedAxis


class StandStillCondition(ProgramRecord, frozen=True):
    """Has not moved for a time."""

    duration_s: float


class SpeedCondition(ProgramRecord, frozen=True):
    """Speed compared with a value."""

    value_mps: float
    rule: ComparisonRule
    axis: SpeedAxis


class RelativeSpeedCondition(ProgramRecord, frozen=True):
    """Own speed minus that of another entity."""

    entity: int
    value_mps: float
    rule: ComparisonRule
    axis: SpeedAxis


class TraveledDistanceCondition(ProgramRecord, frozen=True):
    """Has moved at least so far since the scenario began."""

    value_m: float


class ReachPositionCondition(ProgramRecord, frozen=True):
    """Within a radius of a position."""

    position: Position
    tolerance_m: float


class DistanceCondition(ProgramRecord, frozen=True):
    """Distance to a position."""

    position: Position
    value_m: float
    rule: ComparisonRule
    freespace: bool
    frame: DistanceFrame
    kind: DistanceKind


class RelativeDistanceCondition(ProgramRecord, frozen=True):
    """Distance to another entity."""

    entity: int
    value_m: float
    rule: ComparisonRule
    freespace: bool
    frame: DistanceFrame
    kind: DistanceKind


class AngleCondition(ProgramRecord, frozen=True):
    """An angle of the body within a tolerance, in the world or relative to the road."""

    kind: AngleKind
    angle_rad: float
    tolerance_rad: float
    frame: DistanceFrame


class RelativeAngleCondition(ProgramRecord, frozen=True):
    """An angle relative to that of another entity."""

    entity: int
    kind: AngleKind
    angle_rad: float
    tolerance_rad: float


class LaneRange(ProgramRecord, frozen=True):
    """Lanes counted to the left of an entity's own, which is 0; both ends belong to the range."""

    first: int
    last: int


class RelativeClearanceCondition(ProgramRecord, frozen=True):
    """Lanes beside an entity's own, or its own, are free of others so far ahead and behind."""

    ahead_m: float
    """From the entity's origin, along the middle of its own lane."""
    behind_m: float
    freespace: bool
    """Whole boxes of others count; else their origins."""
    opposite: bool
    """Lanes that are driven the other way count, too."""
    entities: tuple[int, ...] = ()
    """Whom the lanes must be free of; none: everybody else."""
    ranges: tuple[LaneRange, ...] = ()
    """None: all lanes."""


class SimulationTimeCondition(ProgramRecord, frozen=True):
    """Time since the scenario began."""

    value_s: float
    rule: ComparisonRule


class TimeOfDayCondition(ProgramRecord, frozen=True):
    """Time of the environment's clock [s since 1970]."""

    value_s: float
    rule: ComparisonRule


class VariableCondition(ProgramRecord, frozen=True):
    """A variable, parameter or user-defined value; words are compared by their number."""

    variable: int
    value: float
    rule: ComparisonRule


class ElementStateCondition(ProgramRecord, frozen=True):
    """A storyboard element is in a state, or went through a transition in this step."""

    element: int
    state: ElementState


class TrafficSignalCondition(ProgramRecord, frozen=True):
    """A traffic signal shows a state; the states of signals are variables."""

    variable: int
    value: float


EntityExpression = (
    EndOfRoadCondition
    | CollisionCondition
    | OffroadCondition
    | TimeHeadwayCondition
    | TimeToCollisionCondition
    | AccelerationCondition
    | StandStillCondition
    | SpeedCondition
    | RelativeSpeedCondition
    | TraveledDistanceCondition
    | ReachPositionCondition
    | DistanceCondition
    | RelativeDistanceCondition
    | AngleCondition
    | RelativeAngleCondition
    | RelativeClearanceCondition
)
ValueExpression = (
    SimulationTimeCondition
    | TimeOfDayCondition
    | VariableCondition
    | ElementStateCondition
    | TrafficSignalCondition
)


class Condition(ProgramRecord, frozen=True):
    """One condition of a group."""

    name: str
    expression: EntityExpression | ValueExpression
    edge: ConditionEdge
    delay_s: float
    entities: tuple[int, ...] = ()
    """Triggering entities; none for a :data:`ValueExpression`."""
    all_entities: bool = False
    """All of them must fulfil it; else any one."""


class Trigger(ProgramRecord, frozen=True):
    """True if all conditions of any group are."""

    groups: tuple[tuple[Condition, ...], ...]
