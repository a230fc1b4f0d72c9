"""Scenario files become storyboard programs.

Each actor of an event has a maneuver group of its own, so that conditions and orders stay those of
one actor; all of them have the event's trigger. An event that has ended stays ended, so `after`
counts from then on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from schemas.validation import suggest
from twin.road.shipped.library import road_path, roads_of
from twin.scenario.storyboard.check_program import program_mistakes
from twin.scenario.storyboard.native.actions import (
    ARRIVE,
    AT_ONCE,
    SPEED,
    ActionCompiler,
    line_points,
    path_heading,
)
from twin.scenario.storyboard.native.bodies import BODIES, ActorBody, entity_of
from twin.scenario.storyboard.native.conditions import (
    Groups,
    all_of,
    at_time,
    condition,
    element_in,
    reach_expression,
    watch_conditions,
)
from twin.scenario.storyboard.native.document import NativeDocument, raise_mistakes
from twin.scenario.storyboard.native.ground import (
    NativeMistakes,
    ScenarioGround,
    SpotError,
    scenario_ground,
)
from twin.scenario.storyboard.native.orders import ActorOrders
from twin.scenario.storyboard.native.sections import NativeScenario, ScenarioEnd, StoryEvent
from twin.scenario.storyboard.native.starts import StartPlace, places_of, turned_place
from twin.scenario.storyboard.native.surroundings import (
    SurroundingsAction,
    SurroundingsCompiler,
)
from twin.scenario.storyboard.program import conditions as conditions_of
from twin.scenario.storyboard.program.actions import PrivateAction, SpeedAction
from twin.scenario.storyboard.program.conditions import ComparisonRule, ElementState, Trigger
from twin.scenario.storyboard.program.program import (
    ElementKind,
    InitAction,
    Program,
    StoryElement,
)

_STORY = 1
"""Index of the story; 0 is the storyboard, 2 the act."""
_ACT = 2
_STARTED = (ElementState.RUNNING, ElementState.COMPLETE)


Named = list[tuple[str, PrivateAction | SurroundingsAction]]


@dataclass(frozen=True, slots=True)
class _Follower:
    """An event that belongs to another one, and begins when something of that has ended."""

    name: str
    after: int
    """What has ended: 0 the event, n its n-th action."""
    actions: Named


@dataclass(frozen=True, slots=True)
class _Part:
    """One actor's part of an event."""

    event: str
    actor: str
    actions: Named
    followers: tuple[_Follower, ...]
    first: int
    """Index of its group; its maneuver and event follow."""

    @property
    def maneuver(self) -> int:
        """Index of the maneuver, which is over when its events are."""
        return self.first + 1

    @property
    def element(self) -> int:
        """Index of the event."""
        return self.first + 2


def compile_native(document: NativeDocument, ego: ActorBody = BODIES["car"]) -> Program:
    """The storyboard program of a scenario file.

    Args:
        document: the file.
        ego: body of the ego, from whose middle its places and from whose ends gaps count.

    Raises:
        ValueError: something is wrong; a line for each mistake with file and path.
    """
    scenario = document.scenario
    mistakes = NativeMistakes([])
    ground = _ground(document, mistakes)
    raise_mistakes(document.file, mistakes.mistakes)
    assert ground is not None
    places = places_of(scenario, ego, ground, mistakes)
    _check_order(scenario, mistakes)
    _check_towed(scenario, mistakes)
    _face(scenario, ground, places)
    names = ["ego", *scenario.actors]
    numbers = {name: number for number, name in enumerate(names)}
    compiler = ActionCompiler(scenario, ground, places, numbers, mistakes)
    first = compiler.begin()
    surroundings = SurroundingsCompiler(ground, mistakes)
    parts = _parts(scenario, compiler, surroundings)
    triggers = {name: _trigger(name, scenario, parts, compiler) for name in scenario.events}
    stop = _stop(scenario.end, ground, places, mistakes, bool(scenario.events))
    raise_mistakes(document.file, mistakes.mistakes)
    kinds = {name: start.kind for name, start in scenario.actors.items()}
    tractors = {
        name: numbers[start.towed_by] for name, start in scenario.actors.items() if start.towed_by
    }
    program = Program(
        name=scenario.scenario,
        entities=tuple(
            entity_of(
                name,
                kinds.get(name, "car"),
                place.body,
                place.origin,
                ego=name == "ego",
                tractor=tractors.get(name, -1),
            )
            for name, place in places.items()
        ),
        elements=tuple(_elements(parts, triggers, stop, numbers)),
        init=tuple(InitAction(action, numbers[name]) for name in names for action in first[name]),
        trajectories=tuple(compiler.trajectories),
        routes=tuple(compiler.routes),
        variables=tuple(surroundings.variables),
        words=tuple(surroundings.words) if surroundings.variables else (),
        environments=tuple(surroundings.environments),
        models=tuple(compiler.models),
        network=ground.network,
    )
    if wrong := program_mistakes(program):
        raise ValueError("\n".join(f"{document.file}: {line}" for line in wrong))
    return program


def _ground(document: NativeDocument, mistakes: NativeMistakes) -> ScenarioGround | None:
    try:
        path = road_path(document.scenario.road, document.file.parent)
        return scenario_ground(roads_of(path))
    except ValueError as error:
        mistakes.add("road", str(error))
        return None


def _face(scenario: NativeScenario, ground: ScenarioGround, places: dict[str, StartPlace]) -> None:
    """Turn actors to what they are told: to a heading, or along their first path."""
    for name, place in places.items():
        start = scenario.actors.get(name)
        if start is None or start.heading_deg is not None:
            continue
        for event in scenario.events.values():
            orders = event.do.get(name)
            if orders is None or not (orders.path or orders.cross_to):
                continue
            try:
                points = line_points(place, orders, ground, None)
            except SpotError:
                break  # told where the path is compiled
            turn = path_heading(points) - place.travel_rad
            places[name] = turned_place(place, ground, math.remainder(turn, 2.0 * math.pi))
            break


def _names(after: list[str] | str) -> list[str]:
    return [after] if isinstance(after, str) and after else list(after)


def _check_order(scenario: NativeScenario, mistakes: NativeMistakes) -> None:
    """Events that wait for events that do not exist, or in a circle."""
    waits: dict[str, list[str]] = {}
    for name, event in scenario.events.items():
        for key in ("after", "after_start"):
            for before in _names(getattr(event, key)):
                if before not in scenario.events:
                    others = [other for other in scenario.events if other != name]
                    words = f"no event '{before}'; {suggest(before, others)}"
                    mistakes.add(f"events.{name}.{key}", words)
                elif key == "after" and _endless(scenario.events[before]):
                    words = f"'{before}' never ends: it keeps a gap for ever; use after_start"
                    mistakes.add(f"events.{name}.{key}", words)
                else:
                    waits.setdefault(name, []).append(before)
    done: set[str] = set()
    for name in scenario.events:
        circle = _circle(name, waits, [], done)
        if circle:
            words = " -> ".join(circle)
            mistakes.add(f"events.{name}.after", f"events wait for each other: {words}")
            return


def _check_towed(scenario: NativeScenario, mistakes: NativeMistakes) -> None:
    """Orders to trailers that would move them."""
    towed = {name: start.towed_by for name, start in scenario.actors.items() if start.towed_by}
    for name, tractor in towed.items():
        first = next(other for other, its_tractor in towed.items() if its_tractor == tractor)
        if first != name:
            mistakes.add(f"actors.{name}.towed_by", f"'{first}' hangs there already")
    for event, what in scenario.events.items():
        for actor, orders in what.do.items():
            moves = {key for key in orders.__struct_fields__ if getattr(orders, key)}
            if actor in towed and moves - {"lamps", "visible", "at_end"}:
                words = f"a towed trailer goes where '{towed[actor]}' goes: give the orders to that"
                mistakes.add(f"events.{event}.do.{actor}", words)


def _endless(event: StoryEvent) -> bool:
    return any(orders.keep is not None for orders in event.do.values())


def _circle(name: str, waits: dict[str, list[str]], trail: list[str], done: set[str]) -> list[str]:
    """The events from ``name`` back to itself; empty: there is no circle."""
    if name in trail:
        return [*trail[trail.index(name) :], name]
    if name in done:
        return []
    for before in waits.get(name, []):
        circle = _circle(before, waits, [*trail, name], done)
        if circle:
            return circle
    done.add(name)
    return []


def _parts(
    scenario: NativeScenario, compiler: ActionCompiler, surroundings: SurroundingsCompiler
) -> list[_Part]:
    parts: list[_Part] = []
    index = _ACT + 1
    for name, event in scenario.events.items():
        for actor, orders in event.do.items():
            ordered: Named = [*compiler.orders(f"events.{name}.do.{actor}", actor, orders)]
            actions, followers = _in_turn(name, orders, ordered)
            parts.append(_Part(name, actor, actions, followers, index))
            # Group, maneuver, event and its actions; each event that follows, and its actions.
            index += 3 + len(actions) + sum(1 + len(one.actions) for one in followers)
        around: Named = [*surroundings.actions(name, event)]
        if around:
            parts.append(_Part(name, "ego", around, (), index))
            index += 3 + len(around)
    return parts


def _in_turn(name: str, orders: ActorOrders, actions: Named) -> tuple[Named, tuple[_Follower, ...]]:
    """Actions of an event, and what begins after them."""
    followers = []
    if {SPEED, ARRIVE} <= {words for words, _ in actions}:
        arrive = [row for row in actions if row[0] == ARRIVE]
        actions = [row for row in actions if row[0] != ARRIVE]
        speed = 1 + [words for words, _ in actions].index(SPEED)
        followers.append(_Follower(f"{name} arrives", speed, arrive))
    if (orders.path or orders.cross_to is not None) and orders.at_end == "stop":
        stop: Named = [("stop", SpeedAction(AT_ONCE, -1, 0.0))]
        followers.append(_Follower(f"{name} stops", 0, stop))
    return actions, tuple(followers)


def _trigger(
    name: str, scenario: NativeScenario, parts: list[_Part], compiler: ActionCompiler
) -> Trigger | None:
    """What an event waits for."""
    event = scenario.events[name]
    waits: list[Groups] = []
    if event.at_s is not None:
        waits.append(((at_time(event.at_s + event.delay_s),),))
    for actor, watch in event.when.items():
        rows = watch_conditions(
            f"events.{name}.when.{actor}",
            actor,
            watch,
            event.delay_s,
            compiler.ground,
            compiler.places,
            compiler.numbers,
            compiler.mistakes,
        )
        waits.append((tuple(rows),))
    for names, ended in ((_names(event.after), True), (_names(event.after_start), False)):
        for before in names:
            for part in parts:
                if part.event == before:
                    waits.append(_state_of(part, ended, event.delay_s))
    if not waits and event.delay_s > 0.0:
        waits.append(((at_time(event.delay_s),),))
    return all_of(waits)


def _state_of(part: _Part, ended: bool, delay_s: float) -> Groups:
    """A part of an event has ended, or has started."""
    if ended:
        name = f"{part.event} has ended"
        return ((element_in(name, part.maneuver, ElementState.COMPLETE, delay_s),),)
    name = f"{part.event} has started"
    return tuple((element_in(name, part.element, state, delay_s),) for state in _STARTED)


def _stop(
    end: ScenarioEnd,
    ground: ScenarioGround,
    places: dict[str, StartPlace],
    mistakes: NativeMistakes,
    events: bool,
) -> Trigger:
    groups = [(at_time(end.after_s),)]
    if end.ego_reaches is not None and "ego" in places:
        spot = end.ego_reaches
        there = mistakes.attempt(
            "end.ego_reaches", lambda: reach_expression(spot, ground, places["ego"])
        )
        groups += [(condition(f"ego reaches {spot.s_m:g} m", there, 0.0, 0),)] if there else []
    if end.ego_stands_s is not None:
        stands = conditions_of.StandStillCondition(end.ego_stands_s)
        groups.append((condition(f"ego stands for {end.ego_stands_s:g} s", stands, 0.0, 0),))
    if end.collision_s is not None:
        touch = conditions_of.CollisionCondition(-1, -1)
        groups.append((condition("ego has touched something", touch, end.collision_s, 0),))
    if end.all_done_s is not None:
        if not events:
            mistakes.add("end.all_done_s", "there are no events that could be done")
        done = element_in("all events have ended", _STORY, ElementState.COMPLETE, end.all_done_s)
        groups.append((done,))
    return Trigger(tuple(groups))


def _begun() -> Trigger:
    """After time 0: players evaluate the storyboard at time 0 with a step of no length, in which a
    synchronisation could only stop its actor."""
    after = conditions_of.SimulationTimeCondition(0.0, ComparisonRule.GREATER)
    return Trigger(((condition("the scenario has begun", after),),))


def _elements(
    parts: list[_Part],
    triggers: dict[str, Trigger | None],
    stop: Trigger,
    numbers: dict[str, int],
) -> list[StoryElement]:
    elements = [StoryElement(ElementKind.STORYBOARD, "storyboard", -1, stop=stop)]
    if not parts:
        return elements
    elements.append(StoryElement(ElementKind.STORY, "events", 0))
    elements.append(StoryElement(ElementKind.ACT, "act", _STORY, start=_begun()))
    for part in parts:
        assert len(elements) == part.first
        group = StoryElement(ElementKind.GROUP, part.actor, _ACT, actors=(numbers[part.actor],))
        elements += [
            group,
            StoryElement(ElementKind.MANEUVER, part.event, part.first),
            StoryElement(ElementKind.EVENT, part.event, part.first + 1, start=triggers[part.event]),
        ]
        elements += [
            StoryElement(ElementKind.ACTION, words, part.element, action=action)
            for words, action in part.actions
        ]
        for follower in part.followers:
            before = element_in(
                "what comes before has ended",
                part.element + follower.after,
                ElementState.COMPLETE,
                0.0,
            )
            elements.append(
                StoryElement(
                    ElementKind.EVENT, follower.name, part.maneuver, start=Trigger(((before,),))
                )
            )
            event = len(elements) - 1
            elements += [
                StoryElement(ElementKind.ACTION, words, event, action=action)
                for words, action in follower.actions
            ]
    return elements
