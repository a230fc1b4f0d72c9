"""Trailers: what hangs on whose hitch, and actions that couple them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    only_child,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.actions import (
    Action,
    ConnectTrailerAction,
    DisconnectTrailerAction,
)
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.scenario.storyboard.program.program import ElementKind, StoryElement


def with_trailers(objects: list[ScenarioElement]) -> list[ScenarioElement]:
    """Entities in the order of the file, each trailer that is written into its tractor after it."""
    every: list[ScenarioElement] = []
    for item in objects:
        every.append(item)
        holder = _holder(item)
        if holder is not None:
            child = only_child(holder)
            if child.type_name == "ScenarioObject":
                every += with_trailers([child])
    return every


def _holder(item: ScenarioElement) -> ScenarioElement | None:
    """The ``Trailer`` element of a vehicle."""
    first = only_child(item)
    return first.first("Trailer") if first.type_name == "Vehicle" else None


def coupled(
    entities: Sequence[StoryboardEntity], objects: Sequence[ScenarioElement], context: Compilation
) -> tuple[StoryboardEntity, ...]:
    """Entities with what they hang on (``Vehicle.trailer``)."""
    tractors: dict[int, int] = {}
    for tractor, item in enumerate(objects):
        holder = _holder(item)
        if holder is None:
            continue
        with context.collecting(holder):
            child = only_child(holder)
            named = child.type_name == "EntityRef"
            trailer = context.entity(child) if named else context.entities[child.label][0]
            check_coupling(child, entities[tractor], entities[trailer])
            if trailer in tractors:
                raise RefusalError(child, f"{entities[trailer].name} hangs on two hitches")
            tractors[trailer] = tractor
            at: int | None = tractor
            while at is not None:
                if at == trailer:
                    raise RefusalError(child, f"{entities[trailer].name} would tow itself")
                at = tractors.get(at)
    return tuple(
        replace(entity, tractor=tractors.get(number, -1)) for number, entity in enumerate(entities)
    )


def check_coupling(
    element: ScenarioElement, tractor: StoryboardEntity, trailer: StoryboardEntity
) -> None:
    """Refuse what cannot be coupled."""
    if tractor.hitch_x_m is None:
        raise RefusalError(element, f"{tractor.name} has no TrailerHitch")
    if trailer.coupler_x_m is None:
        raise RefusalError(element, f"{trailer.name} has no TrailerCoupler")


def check_connections(
    file_element: ScenarioElement,
    entities: Sequence[StoryboardEntity],
    elements: Sequence[StoryElement],
    context: Compilation,
) -> None:
    """Note connections of actors without a hitch, and of trailers without a coupler."""
    for tractor, trailer, line in _connections(elements):
        words = ""
        if entities[tractor].hitch_x_m is None:
            words = f"{entities[tractor].name} has no TrailerHitch"
        elif entities[trailer].coupler_x_m is None:
            words = f"{entities[trailer].name} has no TrailerCoupler"
        elif tractor == trailer:
            words = f"{entities[trailer].name} would tow itself"
        if words:
            context.mistakes.add(file_element.file, line, f"ConnectTrailerAction: {words}")


def _connections(elements: Sequence[StoryElement]) -> Iterator[tuple[int, int, int]]:
    """Tractor, trailer and line of each action that connects."""
    for element in elements:
        if isinstance(element.action, ConnectTrailerAction):
            group = element
            while group.kind is not ElementKind.GROUP:
                group = elements[group.parent]
            for actor in group.actors:
                yield actor, element.action.trailer, element.line


def _connect(element: ScenarioElement, context: Compilation) -> Action:
    return ConnectTrailerAction(context.entity(element, "trailerRef"))


def _disconnect(_element: ScenarioElement, _context: Compilation) -> Action:
    return DisconnectTrailerAction()


TRAILERS: dict[str, Handler] = {
    "ConnectTrailerAction": _connect,
    "DisconnectTrailerAction": _disconnect,
}
"""Handlers of couplings by element type."""
