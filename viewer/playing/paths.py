"""Entity paths of a played scenario's recording, and its colours."""

from __future__ import annotations

from schemas.files.played_scenario import BodyCategory, PlayFile
from viewer.recording import naming
from viewer.recording.scenery import Color

APP = "twin_play"
"""Application id; blueprints belong to it."""

ROOT = "world"
LANES = "world/lanes"
MARKS = "world/marks"
PATHS = "world/paths"
FIRED = "world/fired"
"""Points at which events began."""
ENTITIES = "world/entities"
"""An entity below it is a pose, with its body."""
NAMES = "world/names"
"""Below it those that a view shows, by the key of its eye."""
TRAILS = "world/trails"
CENTRE = "world/centre"
"""Moves with the ego and does not turn: what the view from above follows."""
SPEEDS = "speed_mps"
EVENTS = "events"
SUMMARY = "summary"

EGO_COLOR: Color = (255, 214, 0)
CATEGORY_COLORS: dict[BodyCategory, Color] = {
    "car": (90, 200, 220),
    "van": (80, 160, 255),
    "truck": (255, 160, 80),
    "trailer": (214, 130, 60),
    "semitrailer": (214, 130, 60),
    "bus": (0, 210, 150),
    "motorcycle": (190, 130, 255),
    "bicycle": (245, 110, 180),
    "train": (150, 170, 120),
    "tram": (150, 190, 120),
    "pedestrian": (255, 90, 90),
    "child": (255, 130, 110),
    "wheelchair": (255, 110, 160),
    "animal": (205, 165, 105),
    "obstacle": (170, 175, 185),
}
"""Colours of bodies; the ego has its own."""

_SHADES = (1.0, 0.82, 0.68)
"""Bodies of one category follow one another in these."""


def entity_names(play: PlayFile) -> list[str]:
    """Last part of each entity's paths; of a name that is none, letters only and a digest."""
    return [
        f"{number:03d}-{naming.safe_id(entity.name)[-60:]}"
        for number, entity in enumerate(play.entities)
    ]


def entity_colors(play: PlayFile) -> list[Color]:
    """Colour of each entity."""
    counts: dict[str, int] = {}
    colors = []
    for entity in play.entities:
        if entity.ego:
            colors.append(EGO_COLOR)
            continue
        count = counts.get(entity.category, 0)
        counts[entity.category] = count + 1
        shade = _SHADES[count % len(_SHADES)]
        red, green, blue = CATEGORY_COLORS[entity.category]
        colors.append((int(red * shade), int(green * shade), int(blue * shade)))
    return colors


def followed(play: PlayFile) -> int:
    """Number of the entity that the view follows: the ego, else the first that was there; -1:
    there is none."""
    there = [number for number, entity in enumerate(play.entities) if entity.poses]
    egos = [number for number in there if play.entities[number].ego]
    return (egos or there or [-1])[0]
