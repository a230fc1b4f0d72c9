"""Entities: vehicles, pedestrians and other objects, and selections of them.

The ego is the entity named Ego or Hero (in any case), else the first whose controller is named so.
"""

from __future__ import annotations

from msgspec.structs import replace

from twin.scenario.storyboard.compile.context import Compilation, Handler, RefusalError, only_child
from twin.scenario.storyboard.compile.trailers import coupled, with_trailers
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity

EGO_NAMES = ("ego", "hero")
CHILD_HEIGHT_M = 1.4
"""A pedestrian of less height is a child."""
_VEHICLES = {
    "bicycle": EntityCategory.BICYCLE,
    "bus": EntityCategory.BUS,
    "car": EntityCategory.CAR,
    "motorbike": EntityCategory.MOTORCYCLE,
    "semitrailer": EntityCategory.SEMITRAILER,
    "trailer": EntityCategory.TRAILER,
    "train": EntityCategory.TRAIN,
    "tram": EntityCategory.TRAM,
    "truck": EntityCategory.TRUCK,
    "van": EntityCategory.VAN,
}
_PEDESTRIANS = {
    "animal": EntityCategory.ANIMAL,
    "pedestrian": EntityCategory.PEDESTRIAN,
    "wheelchair": EntityCategory.WHEELCHAIR,
}


def compile_entities(
    element: ScenarioElement, context: Compilation
) -> tuple[StoryboardEntity, ...]:
    """All entities in order; their names and those of selections become known."""
    objects = with_trailers(element.all("ScenarioObject"))
    for index, item in enumerate(objects):
        if item.label in context.entities:
            words = f"the name '{item.label}' is given to a second entity"
            context.mistakes.add(item.file, item.line, words)
        context.entities[item.label] = (index,)
    entities = []
    for item in objects:
        with context.collecting(item):
            entities.append(_entity(item, context))
    for selection in element.all("EntitySelection"):
        with context.collecting(selection):
            context.entities[selection.label] = _selected(selection, objects, context)
    if len(entities) == len(objects):
        entities = list(coupled(entities, objects, context))
    ego = _ego(objects)
    return tuple(
        replace(entity, ego=True) if index == ego else entity
        for index, entity in enumerate(entities)
    )


def _ego(objects: list[ScenarioElement]) -> int:
    for index, item in enumerate(objects):
        if item.label.lower() in EGO_NAMES:
            return index
    for index, item in enumerate(objects):
        for holder in item.all("ObjectController"):
            if holder.children and only_child(holder).label.lower() in EGO_NAMES:
                return index
    return -1


def _entity(item: ScenarioElement, context: Compilation) -> StoryboardEntity:
    first = only_child(item)
    for holder in item.all("ObjectController"):
        if item.label.lower() not in EGO_NAMES:
            context.note(holder, "no controller is started; the default controller moves the body")
    entity: StoryboardEntity = context.compile(first)
    reference = item.children[0]
    name = str(reference.values.get("entryName", first.label))
    return replace(entity, name=item.label, catalog_entry=name)


def _vehicle(element: ScenarioElement, _context: Compilation) -> StoryboardEntity:
    performance, axles = element.first("Performance"), element.first("Axles")
    assert performance is not None
    assert axles is not None
    front, rear = axles.first("FrontAxle"), axles.first("RearAxle")
    wheelbase = 0.0
    if front is not None and rear is not None:
        wheelbase = float(front.values["positionX"]) - float(rear.values["positionX"])
    speed, faster, slower = (
        float(performance.values[key]) for key in ("maxSpeed", "maxAcceleration", "maxDeceleration")
    )
    if min(speed, faster, slower) < 0.0:
        raise RefusalError(performance, "limits must not be negative")
    return StoryboardEntity(
        element.label,
        _VEHICLES[str(element.values["vehicleCategory"])],
        _box(element),
        speed,
        faster,
        slower,
        wheelbase,
        float(element.values.get("mass", 0.0)),
        False,
        hitch_x_m=_hitch(element),
        coupler_x_m=_coupler(element),
    )


def _hitch(element: ScenarioElement) -> float | None:
    hitch = element.first("TrailerHitch")
    return None if hitch is None else float(hitch.values["dx"])


def _coupler(element: ScenarioElement) -> float | None:
    coupler = element.first("TrailerCoupler")
    if coupler is None:
        return None
    way_m = float(coupler.values["dx"])
    if not way_m > 0.0:
        raise RefusalError(coupler, f"dx is {way_m:g} m, it must lie before the axle (above 0)")
    return way_m


def _pedestrian(element: ScenarioElement, _context: Compilation) -> StoryboardEntity:
    box = _box(element)
    category = _PEDESTRIANS[str(element.values["pedestrianCategory"])]
    if category is EntityCategory.PEDESTRIAN and box.height_m < CHILD_HEIGHT_M:
        category = EntityCategory.CHILD
    return _unlimited(element, category, box)


def _misc_object(element: ScenarioElement, _context: Compilation) -> StoryboardEntity:
    return _unlimited(element, EntityCategory.OBSTACLE, _box(element))


def _unlimited(
    element: ScenarioElement, category: EntityCategory, box: BodyBox
) -> StoryboardEntity:
    most = float("inf")
    mass = float(element.values["mass"])
    return StoryboardEntity(element.label, category, box, most, most, most, 0.0, mass, False)


def _box(element: ScenarioElement) -> BodyBox:
    box = element.first("BoundingBox")
    assert box is not None
    centre, size = box.first("Center"), box.first("Dimensions")
    assert centre is not None
    assert size is not None
    sides = [float(size.values[key]) for key in ("length", "width", "height")]
    if any(not 0.0 <= side < 1000.0 for side in sides):
        raise RefusalError(size, "sides must be 0 or more and below 1000 m")
    return BodyBox(*(float(centre.values[key]) for key in "xyz"), *sides)


def _selected(
    selection: ScenarioElement, objects: list[ScenarioElement], context: Compilation
) -> tuple[int, ...]:
    members = selection.first("Members")
    assert members is not None
    numbers: dict[int, None] = {}
    for child in members.children:
        if child.type_name == "EntityRef":
            numbers |= dict.fromkeys(context.members(child))
        else:
            numbers |= dict.fromkeys(
                index
                for index, item in enumerate(objects)
                if object_type(item) == child.values["objectType"]
            )
    return tuple(sorted(numbers))


def object_type(item: ScenarioElement) -> str:
    """Word of ``ObjectType`` for a scenario object."""
    kinds = {"Vehicle": "vehicle", "Pedestrian": "pedestrian", "MiscObject": "miscellaneous"}
    return kinds.get(only_child(item).type_name, "external")


ENTITIES: dict[str, Handler] = {
    "Vehicle": _vehicle,
    "Pedestrian": _pedestrian,
    "MiscObject": _misc_object,
}
"""Handlers of entities by element type."""
