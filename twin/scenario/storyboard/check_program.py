"""What the types of a storyboard program cannot say: whether it can be played, whoever made it.

Numbers name entities, elements, trajectories and so on; a kernel that reads what is not there reads
memory of others. So every program that comes from another process, or from a compiler of another
format, is looked through before it is packed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice
from typing import Any

from msgspec.structs import fields

from twin.scenario.storyboard.player.columns import (
    CONDITIONS_MAX,
    ELEMENTS_MAX,
    ENTITIES_MAX,
    INSTANCES_MAX,
    POOL_MAX,
)
from twin.scenario.storyboard.program import actions, conditions
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RelativePosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
    TrajectoryPiece,
)
from twin.scenario.storyboard.program.program import (
    ENVIRONMENT_LIMITS,
    DriverModel,
    ElementKind,
    InitAction,
    Program,
    StoryboardEnvironment,
    StoryElement,
)
from twin.scenario.storyboard.program.record import ProgramRecord
from twin.scenario.storyboard.program.signals import SignalController

MISTAKES_MAX = 100
"""Mistakes of one program that are told."""
VARIABLES_MAX = 4096
"""Variables of a program, its parameters among them."""
CONTROLLERS_MAX = 1024
"""Controllers of traffic signals of a program."""
WAYS_MAX = 200_000
"""Trajectories, and routes, of a program."""
NAME_CHARS_MAX = 10_000
"""Longest name or word [characters]."""
_WHOLE_MAX = 2**31 - 1
_ANY_FINITE = (-1e300, 1e300)
_CATEGORY_GROUPS = (-4, -3, -2, -1)
_FINITE = (FixedPosition, RelativePosition, TrajectoryPiece, RouteLeg, BodyBox)
"""Records in which every number is finite; elsewhere infinite means that there is no limit."""
_ANY_NUMBER = (
    *((actions.SetVariableAction, "value"), (conditions.VariableCondition, "value")),
    *((conditions.TrafficSignalCondition, "value"),),
)
"""Fields that may also be NaN: of a variable without a value."""
_PARENTS = {
    ElementKind.STORY: (ElementKind.STORYBOARD,),
    ElementKind.ACT: (ElementKind.STORY,),
    ElementKind.GROUP: (ElementKind.ACT,),
    ElementKind.MANEUVER: (ElementKind.GROUP,),
    ElementKind.EVENT: (ElementKind.MANEUVER,),
    ElementKind.ACTION: (ElementKind.EVENT,),
}
_GLOBAL = actions.GlobalAction


def program_mistakes(program: Program) -> list[str]:
    """Why a program cannot be played, a line each, at most 100; empty: it can.

    A program is within the limits of the player, its elements stand in depth-first order below the
    kind of element where they belong, every index names something, and its numbers are finite where
    they must be.
    """
    check = _Check(program)
    return list(islice(check.mistakes(), MISTAKES_MAX))


class _Check:
    """Looks through one program."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._counts = {
            "entity": len(program.entities),
            "element": len(program.elements),
            "trajectory": len(program.trajectories),
            "route": len(program.routes),
            "variable": len(program.variables),
            "environment": len(program.environments),
            "model": len(program.models),
            "light": len(actions.LIGHTS),
            "controller": len(program.controllers),
        }
        roads = program.network.roads.values() if program.network is not None else ()
        self._lanes = [
            max((max(len(s.left), len(s.right)) for s in road.sections), default=0)
            for road in roads
        ]
        """Most lanes on one side of each road."""
        self._conditions = 0

    def mistakes(self) -> Iterator[str]:
        """Everything that is wrong, in the order of the program."""
        program = self._program
        yield from self._sizes()
        for number, entity in enumerate(program.entities):
            yield from self._named(f"entity {number}", self._entity(entity))
        yield from self._order()
        for number, element in enumerate(program.elements):
            yield from self._named(f"element {number}", self._element(element))
        for number, init in enumerate(program.init):
            yield from self._named(f"init {number}", self._init(init))
        for number, trajectory in enumerate(program.trajectories):
            yield from self._named(f"trajectory {number}", self._trajectory(trajectory))
        for number, route in enumerate(program.routes):
            yield from self._named(f"route {number}", self._route(route))
        for number, model in enumerate(program.models):
            yield from self._named(f"model {number}", self._model(model))
        for number, place in enumerate(program.environments):
            yield from self._named(f"environment {number}", self._environment(place))
        for number, controller in enumerate(program.controllers):
            yield from self._named(f"controller {number}", self._controller(controller))
        for number, variable in enumerate(program.variables):
            if variable.text and not self._is_word(variable.value):
                yield f"variable {number}: its value names no word"

    def _named(self, place: str, mistakes: Iterator[str]) -> Iterator[str]:
        return (f"{place}: {words}" for words in mistakes)

    def _sizes(self) -> Iterator[str]:
        program = self._program
        for name, least, most in (
            ("entities", 0, ENTITIES_MAX),
            ("elements", 1, ELEMENTS_MAX),
            ("init", 0, INSTANCES_MAX),
            ("variables", 0, VARIABLES_MAX),
            ("trajectories", 0, WAYS_MAX),
            ("routes", 0, WAYS_MAX),
            ("environments", 0, WAYS_MAX),
            ("models", 0, WAYS_MAX),
            ("words", 0, POOL_MAX),
            ("controllers", 0, CONTROLLERS_MAX),
        ):
            count = len(getattr(program, name))
            if not least <= count <= most:
                yield f"{count} {name}; {least} to {most} are played"
        pieces = sum(len(trajectory.pieces) for trajectory in program.trajectories)
        legs = sum(len(route.legs) for route in program.routes)
        for name, count in (("pieces of trajectories", pieces), ("legs of routes", legs)):
            if count > POOL_MAX:
                yield f"{count} {name}; at most {POOL_MAX} are played"
        names = [program.name, *(variable.name for variable in program.variables), *program.words]
        names += [entity.name for entity in program.entities]
        names += [element.name for element in program.elements]
        if any(len(name) > NAME_CHARS_MAX for name in names):
            yield f"a name has more than {NAME_CHARS_MAX} characters"
        if len({entity.name for entity in program.entities}) != len(program.entities):
            yield "two entities have one name"

    def _entity(self, entity: StoryboardEntity) -> Iterator[str]:
        yield from self._record(entity)
        if min(entity.box.length_m, entity.box.width_m, entity.box.height_m) < 0.0:
            yield "its box has a negative size"
        if entity.coupler_x_m is not None and not entity.coupler_x_m > 0.0:
            yield f"its coupler is {entity.coupler_x_m:g} m before its axle"
        if entity.tractor >= 0:
            yield from self._train(entity)

    def _train(self, entity: StoryboardEntity) -> Iterator[str]:
        """Whether the train before a trailer has an end."""
        entities = self._program.entities
        if entity.coupler_x_m is None:
            yield "it is towed and has no coupler"
        for _ in entities:
            if not 0 <= entity.tractor < len(entities):
                return
            entity = entities[entity.tractor]
        yield "it would tow itself"

    def _order(self) -> Iterator[str]:
        """Depth-first: an element's parent is the one before it, or one of that one's parents."""
        open_elements: list[int] = []
        for number, element in enumerate(self._program.elements):
            if number == 0:
                if element.kind is not ElementKind.STORYBOARD or element.parent != -1:
                    yield "element 0: it is not the storyboard"
                    return
            elif element.kind is ElementKind.STORYBOARD:
                yield f"element {number}: a second storyboard"
                return
            else:
                while open_elements and open_elements[-1] != element.parent:
                    open_elements.pop()
                if not open_elements:
                    yield f"element {number}: it does not stand behind its parent {element.parent}"
                    return
                if self._program.elements[element.parent].kind not in _PARENTS[element.kind]:
                    yield f"element {number}: its parent {element.parent} is of the wrong kind"
            open_elements.append(number)

    def _element(self, element: StoryElement) -> Iterator[str]:
        if not 0 <= element.executions_max <= _WHOLE_MAX:
            yield f"it has {element.executions_max} executions"
        yield from self._indices("entity", element.actors)
        if len(set(element.actors)) != len(element.actors):
            yield "an actor is named twice"
        for trigger in (element.start, element.stop):
            for group in trigger.groups if trigger is not None else ():
                for condition in group:
                    yield from self._condition(condition)
        if element.kind is ElementKind.ACTION:
            if element.action is None:
                yield "it has no action"
            else:
                yield from self._record(element.action)
        elif element.action is not None:
            yield "it has an action and is none"

    def _condition(self, condition: conditions.Condition) -> Iterator[str]:
        self._conditions += 1
        if self._conditions == CONDITIONS_MAX + 1:
            yield f"more than {CONDITIONS_MAX} conditions"
        if not 0.0 <= condition.delay_s < math.inf:
            yield f"a delay of {condition.delay_s:g} s"
        yield from self._indices("entity", condition.entities)
        by_entity = isinstance(condition.expression, conditions.EntityExpression)
        if by_entity != bool(condition.entities):
            yield "a condition has triggering entities and needs none, or has none and needs some"
        yield from self._record(condition.expression)

    def _init(self, init: InitAction) -> Iterator[str]:
        if isinstance(init.action, _GLOBAL):
            if init.actor != -1:
                yield "a global action has an actor"
        else:
            yield from self._index("entity", init.actor)
        yield from self._record(init.action)

    def _trajectory(self, trajectory: Trajectory) -> Iterator[str]:
        if not trajectory.pieces:
            yield "it has no pieces"
        before = -math.inf
        for piece in trajectory.pieces:
            yield from self._record(piece)
            if piece.length_m < 0.0 or piece.duration_s < 0.0:
                yield "a piece has a negative length or duration"
            if piece.start_s_m < before:
                yield "its pieces do not ascend"
            before = piece.start_s_m

    def _route(self, route: RoadRoute) -> Iterator[str]:
        if not route.legs:
            yield "it has no legs"
        for leg in route.legs:
            yield from self._record(leg)
            if leg.road < 0:
                yield "a leg lies on no road"

    def _model(self, model: DriverModel) -> Iterator[str]:
        yield from self._record(model)
        if not 0 <= model.exponent <= 100:
            yield f"an exponent of {model.exponent}"

    def _controller(self, controller: SignalController) -> Iterator[str]:
        yield from self._record(controller)
        durations = [phase.duration_s for phase in controller.phases]
        if not sum(durations) > 0.0 or min(durations) < 0.0:
            yield "its phases take no time"
        if not 0.0 <= controller.delay_s < math.inf:
            yield f"a delay of {controller.delay_s:g} s"

    def _environment(self, place: StoryboardEnvironment) -> Iterator[str]:
        for field in fields(place):
            value = getattr(place, field.name)
            if not isinstance(value, float):
                continue
            low, high = ENVIRONMENT_LIMITS.get(field.name, _ANY_FINITE)
            if not low <= value <= high:
                yield f"{field.name} is {value:g}"

    def _record(self, record: ProgramRecord) -> Iterator[str]:
        """Everything in a record that stands for something else, and its numbers."""
        finite = isinstance(record, _FINITE)
        for name in record.__struct_fields__:
            value = getattr(record, name)
            if isinstance(value, float):
                fits = math.isfinite(value) or not (finite or math.isnan(value))
                if not fits and (type(record), name) not in _ANY_NUMBER:
                    yield f"{name} is {value:g}"
            elif isinstance(value, bool | str):
                if isinstance(value, str) and len(value) > NAME_CHARS_MAX:
                    yield f"{name} has more than {NAME_CHARS_MAX} characters"
            elif isinstance(value, int):
                yield from self._whole(record, name, value)
            elif isinstance(value, ProgramRecord):
                yield from self._record(value)
            elif isinstance(value, tuple):
                yield from self._several(record, name, value)
        if isinstance(record, FixedPosition | RouteLeg):
            yield from self._lane(record.road, record.lane)

    def _several(self, record: ProgramRecord, name: str, values: tuple[Any, ...]) -> Iterator[str]:
        for value in values:
            if isinstance(value, ProgramRecord):
                yield from self._record(value)
            elif isinstance(value, float) and not math.isfinite(value):
                yield f"{name} has {value:g}"
        if isinstance(record, conditions.RelativeClearanceCondition) and name == "entities":
            yield from self._indices("entity", values)
        if isinstance(record, actions.AcquirePositionAction):
            yield from self._indices("route", values, least=-1)
            if len(values) not in (0, 2 * len(self._lanes)):
                yield f"{len(values)} routes of {len(self._lanes)} roads"

    def _whole(self, record: ProgramRecord, name: str, value: int) -> Iterator[str]:
        if abs(value) > _WHOLE_MAX:
            yield f"{name} is {value}"
        elif isinstance(record, conditions.CollisionCondition) and name == "category":
            if value not in _CATEGORY_GROUPS and not 0 <= value <= max(EntityCategory):
                yield f"category is {value}"
        elif isinstance(record, actions.LightAction) and name == "mode":
            if value not in (1, 2, 3):
                yield f"mode is {value}"
        elif isinstance(record, actions.SignalPhaseAction) and name == "phase":
            known = self._program.controllers[record.controller : record.controller + 1]
            if not 0 <= value < max((len(c.phases) for c in known), default=0):
                yield f"phase {value} does not exist"
        elif kind := REFERENCES.get(name):
            least = -1 if (type(record), name) in _OPTIONAL else 0
            yield from self._index(kind, value, least)

    def _index(self, kind: str, value: int, least: int = 0) -> Iterator[str]:
        if not least <= value < self._counts[kind]:
            yield f"{kind} {value} does not exist"

    def _indices(self, kind: str, values: tuple[int, ...], least: int = 0) -> Iterator[str]:
        for value in values:
            yield from self._index(kind, value, least)

    def _lane(self, road: int, lane: int) -> Iterator[str]:
        if not -1 <= road < len(self._lanes):
            yield f"road {road} does not exist"
        elif road >= 0 and abs(lane) > self._lanes[road]:
            yield f"road {road} has no lane {lane}"

    def _is_word(self, value: float) -> bool:
        return value.is_integer() and 0 <= value < len(self._program.words)


REFERENCES = {
    **dict.fromkeys(("entity", "master", "trailer", "tractor"), "entity"),
    **dict.fromkeys(("trajectory", "master_trajectory"), "trajectory"),
    **{name: name for name in ("element", "route", "variable", "environment", "model", "light")},
    "controller": "controller",
}
"""What a field of a name counts."""
_OPTIONAL = {
    *((actions.SpeedAction, "entity"), (actions.SpeedProfileAction, "entity")),
    *((actions.LaneChangeAction, "entity"), (actions.LaneOffsetAction, "entity")),
    *((actions.SynchronizeAction, "trajectory"), (actions.SynchronizeAction, "master_trajectory")),
    (actions.ControllerAction, "model"),
    (StoryboardEntity, "tractor"),
    *((conditions.CollisionCondition, "entity"), (conditions.TimeToCollisionCondition, "entity")),
}
"""Fields that may be -1: there is none."""
