"""Looks of a road file's objects by their type and subtype."""

from __future__ import annotations

from dataclasses import dataclass

from twin.road.opendrive.furniture import RoadObject
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color

STEEL: Color = (0.40, 0.41, 0.42)
CONCRETE: Color = (0.36, 0.35, 0.33)
_BRICK: Color = (0.33, 0.17, 0.12)
_HEDGE: Color = (0.05, 0.09, 0.03)
_STONE: Color = (0.40, 0.40, 0.39)
_RENDER: Color = (0.50, 0.46, 0.40)
_PANEL: Color = (0.26, 0.30, 0.25)
_ORANGE: Color = (0.55, 0.20, 0.03)
_GREY: Color = (0.33, 0.33, 0.33)


@dataclass(frozen=True, slots=True)
class ObjectLook:
    """Surface of an object."""

    semantic: str
    """Class of its pixels, of :data:`schemas.messages.SEMANTIC_CLASSES`."""
    material: int
    color: Color
    solid: bool
    """Vehicles collide with it."""


_BY_TYPE: dict[str, ObjectLook] = {
    "barrier": ObjectLook("wall", materials.PLAIN, STEEL, True),
    "building": ObjectLook("building", materials.FACADE, _RENDER, True),
    "gantry": ObjectLook("pole", materials.PLAIN, STEEL, True),
    "obstacle": ObjectLook("unlabelled", materials.PLAIN, _ORANGE, True),
    "pole": ObjectLook("pole", materials.PLAIN, STEEL, True),
    "railing": ObjectLook("wall", materials.PLAIN, STEEL, True),
    "soundBarrier": ObjectLook("wall", materials.PLAIN, _PANEL, True),
    "streetLamp": ObjectLook("pole", materials.PLAIN, STEEL, True),
    "trafficIsland": ObjectLook("sidewalk", materials.PLAIN, _STONE, False),
    "tree": ObjectLook("vegetation", materials.FOLIAGE, _HEDGE, True),
    "vegetation": ObjectLook("vegetation", materials.FOLIAGE, _HEDGE, False),
}
_BY_SUBTYPE: dict[tuple[str, str], ObjectLook] = {
    ("barrier", "hedge"): ObjectLook("vegetation", materials.FOLIAGE, _HEDGE, True),
    ("barrier", "jerseyBarrier"): ObjectLook("wall", materials.PLAIN, CONCRETE, True),
    ("barrier", "wall"): ObjectLook("wall", materials.BRICK, _BRICK, True),
}
_OTHER = ObjectLook("unlabelled", materials.PLAIN, _GREY, False)
_UNSEEN = frozenset({"patch", "roadMark", "wind"})


def look_of(thing: RoadObject) -> ObjectLook | None:
    """The look of an object; None: it is not drawn."""
    if thing.type in _UNSEEN:
        return None
    return _BY_SUBTYPE.get((thing.type, thing.subtype)) or _BY_TYPE.get(thing.type, _OTHER)
