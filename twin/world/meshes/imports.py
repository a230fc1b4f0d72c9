"""A scene's own meshes and terrain -> faces, hulls and textures of the world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.escape import escape
from twin.world.content import MeshFile
from twin.world.meshes import materials
from twin.world.meshes.apart import SceneFiles
from twin.world.meshes.details import FaceLook, Mask
from twin.world.meshes.mesh import MeshBuilder
from twin.world.meshes.mesh_header import FACES_MAX
from twin.world.meshes.part import Part
from twin.world.meshes.terrain import add_terrain
from twin.world.meshes.world_looks import WorldLooks
from twin.world.scene import Scene
from twin.world.street.layout import Hull

REACH_M = 5000.0
"""A placed mesh must end this close to the world's origin [m]."""


@dataclass(frozen=True, slots=True)
class ImportedMeshes:
    """What came from files besides faces."""

    classes: list[str]
    """Object classes of the new instances."""
    hulls: list[Hull]
    textures: tuple[np.ndarray, ...]
    kinds: tuple[int, ...]
    """Of the textures; empty: all are of the usual kind."""
    masks: tuple[Mask, ...]
    looks: tuple[FaceLook, ...]
    notes: tuple[str, ...]
    """What was left out of files: one line per file and feature, escaped."""


def add_imports(
    mesh: MeshBuilder, scene: Scene, first_instance: int, files: SceneFiles
) -> ImportedMeshes:
    """Add terrain and mesh files to the world.

    Args:
        mesh: receives their faces.
        scene: says where they lie.
        first_instance: number of the first object of theirs.
        files: what they hold.

    Raises:
        ValueError: a file that cannot be used; one line.
    """
    if scene.terrain is not None and files.samples is not None:
        add_terrain(mesh, scene.terrain, files.samples)
    classes: list[str] = []
    hulls: list[Hull] = []
    notes: list[str] = list(files.notes)
    looks = WorldLooks()
    faces = 0
    for number, (item, data) in enumerate(zip(scene.meshes, files.meshes, strict=True)):
        try:
            instance = -1
            if item.object_class is not None:
                instance = first_instance + len(classes)
                classes.append(item.object_class)
            moved = [_placed(part.points, item) for part in data.parts]
            _check_reach(moved, item)
        except ValueError as error:
            raise ValueError(f"meshes[{number}]: {error}") from None
        for part, points in zip(data.parts, moved, strict=True):
            faces += len(part.faces)
            _add(mesh, part, points, item, instance, looks)
        if faces > FACES_MAX:
            raise ValueError(f"meshes: together more than {FACES_MAX} faces; simplify them first")
        if item.solid:
            hulls.append(_hull(data.parts, item))
        notes += data.notes
    return ImportedMeshes(
        classes,
        hulls,
        tuple(looks.textures),
        tuple(looks.kinds) if any(looks.kinds) else (),
        tuple(looks.masks),
        tuple(looks.looks),
        tuple(dict.fromkeys(map(escape, notes))),  # a file may stand in several places
    )


def _upright(points: np.ndarray, item: MeshFile) -> np.ndarray:
    """Scaled, with z up, and turned by roll and pitch."""
    p = points * item.scale
    if _up(item) == "y":  # x stays, y becomes z, z becomes -y
        p = np.stack([p[:, 0], -p[:, 2], p[:, 1]], axis=1)
    roll, pitch, _ = np.radians(item.rotation_deg)
    about_x = np.array(
        [(1, 0, 0), (0, math.cos(roll), -math.sin(roll)), (0, math.sin(roll), math.cos(roll))]
    )
    about_y = np.array(
        [(math.cos(pitch), 0, math.sin(pitch)), (0, 1, 0), (-math.sin(pitch), 0, math.cos(pitch))]
    )
    return p @ (about_y @ about_x).T


def _up(item: MeshFile) -> str:
    return item.up or ("y" if Path(item.file).suffix.lower() in (".glb", ".gltf") else "z")


def _placed(points: np.ndarray, item: MeshFile) -> np.ndarray:
    p = _upright(points, item)
    yaw = math.radians(item.rotation_deg[2])
    c, s = math.cos(yaw), math.sin(yaw)
    turned = np.stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]], axis=1)
    return turned + np.array(item.position_m)


def _turn(item: MeshFile) -> np.ndarray:
    """Rotation from the file to the world [3, 3]."""
    axes = _placed(np.vstack([np.zeros(3), np.eye(3)]), item)
    return (axes[1:] - axes[0]).T / item.scale


def _check_reach(moved: list[np.ndarray], item: MeshFile) -> None:
    reach = max(float(np.abs(points).max()) for points in moved)
    if reach > REACH_M:
        raise ValueError(
            f"{item.file}: reaches {reach:.0f} m from the origin, at most {REACH_M:.0f}; "
            "set scale and position_m"
        )


def _hull(parts: list[Part], item: MeshFile) -> Hull:
    """The rectangle around the mesh, along its own yaw."""
    p = np.concatenate([_upright(part.points[np.unique(part.faces)], item) for part in parts])
    low, high = p.min(axis=0), p.max(axis=0)
    yaw = math.radians(item.rotation_deg[2])
    x, y = (low + high)[:2] / 2
    c, s = math.cos(yaw), math.sin(yaw)
    centre = (item.position_m[0] + c * x - s * y, item.position_m[1] + s * x + c * y)
    return (*centre, yaw, (high[0] - low[0]) / 2, (high[1] - low[1]) / 2)


def _add(
    mesh: MeshBuilder,
    part: Part,
    points: np.ndarray,
    item: MeshFile,
    instance: int,
    looks: WorldLooks,
) -> None:
    own_look = item.material is None and item.color is None
    texture = looks.image(part.image, part.wrap) if own_look else -1
    details = looks.details(
        part, _turn(item), own_look=own_look, emission_cd_m2=item.emission_cd_m2
    )
    color = part.color
    if item.color is not None:
        color = np.broadcast_to(np.array(item.color), color.shape)
    elif texture >= 0:  # what the image is multiplied with
        corners = None if part.colors is None else part.colors[part.faces]
        color = np.ones_like(color) if corners is None else corners.mean(axis=1)
    material = materials.PLAIN if item.material is None else materials.NAMES[item.material]
    with mesh.label(item.semantic, instance):
        mesh.add(
            points,
            part.faces,
            material,
            color,
            uv=part.uv if texture >= 0 or details is not None else None,
            texture=texture,
            details=details,
        )
