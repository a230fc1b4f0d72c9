"""What the handlers of all elements share while one scenario is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from schemas.validation import suggest
from twin.road.opendrive.lane_graph import LaneGraph
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.openscenario.element import ScenarioElement, ScenarioMistakes
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    Position,
    RelativePosition,
    RoadRoute,
    Trajectory,
)
from twin.scenario.storyboard.program.program import ProgramVariable, StoryboardEnvironment
from twin.scenario.storyboard.program.signals import SignalController

Handler = Callable[[ScenarioElement, "Compilation"], Any]
"""Compiles one element; raises :class:`RefusalError` where it cannot be expressed."""


class RefusalError(ValueError):
    """An element that a program cannot express; file and line are those of the element."""

    def __init__(self, element: ScenarioElement, words: str) -> None:
        super().__init__(words)
        self.element = element


@dataclass(slots=True)
class Compilation:
    """State of one compilation: names with their numbers, and what was collected so far."""

    handlers: Mapping[str, Handler]
    """Of every element type that is compiled."""
    minor: int
    """Minor version of the scenario file."""
    mistakes: ScenarioMistakes = field(default_factory=ScenarioMistakes)
    notes: dict[str, None] = field(default_factory=dict)
    """What has knowingly no effect, a line each, in order."""
    roads: RoadMap | None = None
    graph: LaneGraph | None = None
    road_numbers: dict[str, int] = field(default_factory=dict)
    """Index of a road in the order of the file, by its id."""
    entities: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Indices by name: one of an entity, those of its members of a selection."""
    elements: dict[tuple[str, str], int] = field(default_factory=dict)
    """Storyboard elements by their type's word and path, ``story::act``."""
    variables: dict[str, int] = field(default_factory=dict)
    """Index by kind and name, ``variable name``."""
    variable_list: list[ProgramVariable] = field(default_factory=list)
    words: dict[str, int] = field(default_factory=dict)
    trajectories: dict[Trajectory, int] = field(default_factory=dict)
    routes: dict[RoadRoute, int] = field(default_factory=dict)
    environments: dict[StoryboardEnvironment, int] = field(default_factory=dict)
    controllers: dict[str, SignalController] = field(default_factory=dict)
    """Of traffic signals, by name, in the order of the file."""

    @contextmanager
    def collecting(self, element: ScenarioElement) -> Iterator[None]:
        """Note what is wrong inside as a mistake, and go on."""
        try:
            yield
        except RefusalError as refusal:
            place = refusal.element
            self.mistakes.add(place.file, place.line, f"{place.name}: {refusal}")
        except ValueError as error:
            self.mistakes.add(element.file, element.line, f"{element.name}: {error}")

    def note(self, element: ScenarioElement, words: str) -> None:
        """Say that something has no effect."""
        self.notes[f"{element.file}:{element.line}: {element.name}: {words}"] = None

    def compile(self, element: ScenarioElement) -> Any:
        """What the handler of its type makes of an element."""
        handler = self.handlers.get(element.type_name)
        if handler is None:
            raise RefusalError(element, "it is not played here")
        return handler(element, self)

    def position(self, element: ScenarioElement) -> Position:
        """The position in an element of type ``Position``."""
        position: Position = self.compile(only_child(element))
        return position

    def fixed(self, element: ScenarioElement) -> FixedPosition:
        """As :meth:`position`, where nothing relative to an entity can stand."""
        position = self.position(element)
        if isinstance(position, RelativePosition):
            words = "a position relative to an entity cannot stand here; give a fixed one"
            raise RefusalError(only_child(element), words)
        return position

    def entity(self, element: ScenarioElement, key: str = "entityRef") -> int:
        """The entity that an attribute names; selections are refused."""
        members = self.members(element, key)
        if len(members) != 1:
            raise RefusalError(element, f"{key} must name one entity, not a selection")
        return members[0]

    def members(self, element: ScenarioElement, key: str = "entityRef") -> tuple[int, ...]:
        """The entities that an attribute names."""
        name = str(element.values[key])
        if name not in self.entities:
            raise RefusalError(element, f"no entity is named '{name}'")
        return self.entities[name]

    def part(self, element: ScenarioElement) -> int:
        """The storyboard element that a condition names.

        The whole path counts first, then the end of a path; of several the one that is met first.
        """
        word = str(element.values["storyboardElementType"])
        name = str(element.values["storyboardElementRef"]).replace("/", "::")
        if (word, name) in self.elements:
            return self.elements[word, name]
        for (kind, path), number in self.elements.items():
            if kind == word and path.endswith(f"::{name}"):
                return number
        raise RefusalError(element, f"no {word} is named '{name}'")

    def road_map(self, element: ScenarioElement) -> RoadMap:
        """The roads of the scenario."""
        if self.roads is None:
            raise RefusalError(element, "the scenario has no road network (RoadNetwork/LogicFile)")
        return self.roads

    def word(self, text: str) -> float:
        """The number of a word."""
        return float(self.words.setdefault(text, len(self.words)))

    def declare(self, kind: str, name: str, value: float, *, text: bool) -> int:
        """Add a variable of a kind, with its first value."""
        number = len(self.variable_list)
        self.variables[f"{kind} {name}"] = number
        self.variable_list.append(ProgramVariable(f"{kind} {name}", value, text))
        return number

    def variable(self, element: ScenarioElement, kind: str, name: str) -> int:
        """The index of a variable."""
        key = f"{kind} {name}"
        if key not in self.variables:
            known = [other.partition(" ")[2] for other in self.variables if other.startswith(kind)]
            raise RefusalError(element, f"no {kind} is named '{name}'; {suggest(name, known)}")
        return self.variables[key]

    def number(self, element: ScenarioElement, variable: int, value: Value) -> float:
        """A value as that variable holds it: a number, or the number of a word."""
        if self.variable_list[variable].text:
            return self.word(str(value))
        return as_number(element, value)

    def trajectory(self, trajectory: Trajectory) -> int:
        """Index of a trajectory; equal ones have one."""
        return self.trajectories.setdefault(trajectory, len(self.trajectories))

    def route(self, route: RoadRoute) -> int:
        """Index of a route; equal ones have one."""
        return self.routes.setdefault(route, len(self.routes))

    def environment(self, environment: StoryboardEnvironment) -> int:
        """Index of an environment; equal ones have one."""
        return self.environments.setdefault(environment, len(self.environments))


def as_number(element: ScenarioElement, value: Value) -> float:
    """A number, a boolean (0 or 1) or a date and time (seconds since 1970)."""
    if isinstance(value, str):
        text = value.strip()
        if text in ("true", "false"):
            return float(text == "true")
        try:
            return float(text)
        except ValueError:
            pass
        try:
            return seconds_of(text)
        except ValueError:
            raise RefusalError(element, f"'{text[:40]}' is no number") from None
    return float(value)


def seconds_of(date_time: str, *, zone: bool = True) -> float:
    """Seconds since 1970 of a date and time; UTC where it has no time zone, or ``zone`` is not to
    count."""
    moment = datetime.fromisoformat(date_time)
    return (moment if moment.tzinfo and zone else moment.replace(tzinfo=UTC)).timestamp()


def only_child(element: ScenarioElement, *names: str) -> ScenarioElement:
    """The one child of these names, or of any name, entries of catalogs in place of references."""
    children = element.all(*names) if names else list(element.children)
    if not children:
        raise RefusalError(element, "it is empty")
    child = children[0]
    return child.target if child.target is not None else child


def number_of(element: ScenarioElement, key: str, default: float) -> float:
    """An attribute, or the default where it is not given."""
    return float(element.values.get(key, default))
