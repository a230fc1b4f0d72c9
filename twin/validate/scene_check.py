"""What is wrong with scene files, and with objects that cases of a campaign vary; without Warp."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import msgspec

from schemas.files.yaml_file import YamlError
from schemas.sections.objects import ObjectVariation
from twin.actors.motion import Motion, Still
from twin.actors.objects import script_of
from twin.actors.variations import Variations
from twin.world.scene import Scene, load_scene
from twin.world.street.standing import overlaps


class Variant(NamedTuple):
    """What a case asks of its scene."""

    scene: str
    """Shipped name, or path of a scene file."""
    objects: Mapping[str, ObjectVariation]


def mistakes_of(variants: Iterable[Variant]) -> list[str]:
    """One line per mistake, each once; every scene is looked at once."""
    lines: list[str] = []
    motions: dict[str, Motion | None] = {}
    varied: set[tuple[str, bytes]] = set()
    for name, objects in variants:
        if name not in motions:
            motions[name], mistakes = _scene_mistakes(name)
            lines += mistakes
        motion = motions[name]
        for object_name, variation in objects.items():
            key = name, msgspec.json.encode((object_name, variation))
            if motion is None or key in varied:
                continue
            varied.add(key)
            try:
                Variations(motion.actors, 1).begin(0, {object_name: variation})
            except ValueError as error:
                lines.append(f"scene {name}: {error}")
    return list(dict.fromkeys(lines))


def _scene_mistakes(name: str) -> tuple[Motion | None, list[str]]:
    """The script of a scene, None if there is none, and what is wrong with the file."""
    try:
        scene: Scene = load_scene(name)
        motion: Motion = script_of(scene.objects) if scene.objects else Still()
    except (ValueError, YamlError) as error:
        line = str(error)
        return None, [line if name in line else f"scene {name}: {line}"]
    return motion, [f"scene {name}: {line}" for line in overlaps(scene)]
