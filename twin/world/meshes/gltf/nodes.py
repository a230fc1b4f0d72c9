"""Where the nodes of a glTF scene put their meshes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.world.meshes.gltf.document import Document, GltfError

NODES_MAX = 1 << 20
"""Most nodes of a scene."""


@dataclass(frozen=True, slots=True)
class PlacedMesh:
    """A mesh in the scene."""

    mesh: int
    skin: int | None
    weights: list[float] | None
    """Of its morph targets, if the node has its own."""
    from_mesh: np.ndarray
    """World from mesh, float64 [4, 4]."""


def placed_meshes(document: Document) -> list[PlacedMesh]:
    """Meshes of the default scene, in the order of its tree.

    Raises:
        GltfError: the nodes are no tree, or one has a broken transform.
    """
    return [
        PlacedMesh(node["mesh"], node.get("skin"), node.get("weights"), matrix)
        for _, node, matrix in _walk(document)
        if "mesh" in node
    ]


def world_of_nodes(document: Document) -> dict[int, np.ndarray]:
    """World from node, by number, float64 [4, 4].

    Raises:
        GltfError: as :func:`placed_meshes`.
    """
    return {index: matrix for index, _, matrix in _walk(document)}


def _walk(document: Document) -> Iterator[tuple[int, dict[str, Any], np.ndarray]]:
    waiting = [(root, np.eye(4)) for root in reversed(_roots(document))]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        node = document.row("nodes", index)
        if index in seen:
            raise GltfError(f"nodes[{index}] has two parents, or is its own")
        seen.add(index)
        if len(seen) > NODES_MAX:
            raise GltfError(f"more than {NODES_MAX} nodes")
        matrix = parent @ _local(node, index)
        yield index, node, matrix
        children = node.get("children", [])
        if not isinstance(children, list):
            raise GltfError(f"nodes[{index}]: 'children' is no list")
        waiting += [(child, matrix) for child in reversed(children)]


def _roots(document: Document) -> list[int]:
    """Roots of the default scene; of a file without scenes, all nodes that are no child."""
    if document.rows("scenes"):
        roots = document.row("scenes", document.data.get("scene", 0)).get("nodes", [])
        if not isinstance(roots, list):
            raise GltfError("a scene's 'nodes' is no list")
        return roots
    nodes = document.rows("nodes")
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _local(node: dict[str, Any], index: int) -> np.ndarray:
    """Parent from node (glTF 2.0, 3.5.2): a matrix in columns, or translation, rotation, scale."""
    try:
        if "matrix" in node:
            found = np.array(node["matrix"], np.float64).reshape(4, 4).T
        else:
            found = np.eye(4)
            found[:3, :3] = _rotation(np.array(node.get("rotation", (0, 0, 0, 1)), np.float64))
            found[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
            found[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    except (TypeError, ValueError):
        raise GltfError(f"nodes[{index}] has a transform that is none") from None
    if not np.isfinite(found).all():
        raise GltfError(f"nodes[{index}] has a transform that is not finite")
    return found


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation of a quaternion x, y, z, w; one of length 0 turns nothing."""
    x, y, z, w = quaternion.reshape(4) / (np.linalg.norm(quaternion) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
