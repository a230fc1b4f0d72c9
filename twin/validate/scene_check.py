"""What is wrong with scene and vehicle files, and with objects that cases of a campaign vary.

Everything that a simulator would refuse is loaded here, mesh files and heightmaps too, before a
case is leased. It needs no Warp.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import msgspec

from schemas.files.yaml_file import YamlError
from schemas.sections.objects import ObjectVariation
from twin.actors.motion import Motion, Still
from twin.actors.objects import script_of
from twin.actors.variations import Variations
from twin.vehicle.masses import Load, masses_of
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import Scene, load_scene
from twin.world.street.standing import overlaps


class Variant(NamedTuple):
    """What a case asks of its scene."""

    scene: str
    """Shipped name, or path of a scene file."""
    objects: Mapping[str, ObjectVariation]


class SceneFindings(NamedTuple):
    """What was found in scenes, one line each."""

    mistakes: list[str]
    notes: list[str]
    """What is left out of files, which is no mistake."""


def check_scenes(variants: Iterable[Variant]) -> SceneFindings:
    """Look at every scene once, and at every variation of its objects."""
    lines: list[str] = []
    notes: list[str] = []
    motions: dict[str, Motion | None] = {}
    varied: set[tuple[str, bytes]] = set()
    for name, objects in variants:
        if name not in motions:
            motions[name], findings = _check_scene(name)
            lines += findings.mistakes
            notes += findings.notes
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
    return SceneFindings(list(dict.fromkeys(lines)), list(dict.fromkeys(notes)))


def vehicle_mistakes(loaded: Iterable[tuple[str, Load]]) -> list[str]:
    """One line per vehicle that cannot be used, or cannot carry a load; each is looked at once."""
    lines = {}
    for name, load in dict.fromkeys(loaded):
        try:
            masses_of(load_vehicle(name), load)
        except (ValueError, YamlError) as error:
            line = str(error)
            lines[line if name in line else f"vehicle {name}: {line}"] = None
    return list(lines)


def _check_scene(name: str) -> tuple[Motion | None, SceneFindings]:
    """The script of a scene, None if there is none, and what was found in the file."""
    try:
        scene: Scene = load_scene(name)
        motion: Motion = script_of(scene.objects) if scene.objects else Still()
    except (ValueError, YamlError) as error:
        line = str(error)
        return None, SceneFindings([line if name in line else f"scene {name}: {line}"], [])
    files = _check_files(scene)
    lines = [*overlaps(scene), *files.mistakes]
    return motion, SceneFindings([f"scene {name}: {line}" for line in lines], files.notes)


def _check_files(scene: Scene) -> SceneFindings:
    """What was found in the files of a scene; the first of them that cannot be used."""
    if scene.opendrive:
        # Roads take libraries that are slow to load, and most scenes have none.
        from twin.world.roadside.roadside import road_mistake

        if mistake := road_mistake(scene):
            return SceneFindings([mistake], [])
    if not scene.meshes and scene.terrain is None:
        return SceneFindings([], [])
    # Most scenes have no files, and reading pictures takes libraries that are slow to load.
    from twin.world.meshes.apart import read_files
    from twin.world.meshes.imports import add_imports

    try:
        imported = add_imports(MeshBuilder(), scene, 0, read_files(scene))
    except ValueError as error:
        return SceneFindings([str(error)], [])
    return SceneFindings([], list(imported.notes))
