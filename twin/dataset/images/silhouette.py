"""Pixels that an object would have if nothing stood before it.

The rays of the camera are cast again, those inside the rectangle around the object alone, and they
meet the object alone: its own small hierarchy, the same triangles that the camera's picture shows.
So the share of visible pixels is a ratio of like and like, whatever the lens. It costs a fraction
of the picture: no shading, no shadows, no street.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from twin.dataset.images.eyepoint import Eyepoint, EyeView, Outline, Shape, rotated
from twin.render.trace import bvh, traverse
from twin.render.trace.geometry import turned
from twin.world.kernel_loading import load_kernels
from twin.world.meshes.materials import SIGN
from twin.world.meshes.mesh import DECAL, Mesh
from twin.world.street.build import World

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FIELDS = 6
_FAR = np.iinfo(np.int32).max


@wp.struct
class Item:
    """One object before one camera."""

    root: wp.int32
    """Root of its hierarchy."""
    low_x: wp.int32
    """Rectangle of pixels to look through; the high ones are not in it."""
    low_y: wp.int32
    high_x: wp.int32
    high_y: wp.int32
    position: wp.vec3
    """Position of its mesh [m]."""
    cosine: wp.float32
    sine: wp.float32
    eye: wp.vec3
    right: wp.vec3
    down: wp.vec3
    ahead: wp.vec3


@wp.kernel
def silhouette_kernel(
    # model
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    rays: wp.array2d(dtype=wp.vec3),
    near: wp.float32,
    far: wp.float32,
    # state in
    items: wp.array(dtype=Item),
    # out
    found_out: wp.array2d(dtype=wp.int32),
):
    """Per item: x min, y min, x max, y max, number of pixels, nearest distance [0.1 mm]; [N, 6]."""
    i, row = wp.tid()
    item = items[i]
    if row < item.low_y or row >= item.high_y:
        return
    origin = turned(item.eye - item.position, item.cosine, -item.sine)
    count = wp.int32(0)
    low = wp.int32(2147483647)
    nearest = far
    high = wp.int32(-1)
    for column in range(item.low_x, item.high_x):
        ray = rays[row, column]
        if wp.dot(ray, ray) > 0.0:
            direction = ray[0] * item.right + ray[1] * item.down + ray[2] * item.ahead
            local = turned(direction, item.cosine, -item.sine)
            hit = traverse.closest(nodes, leaves, item.root, origin + local * near, local, 0.0, far)
            if wp.cast(hit[3], wp.int32) >= 0:
                count += 1
                nearest = wp.min(nearest, near + hit[0])
                low = wp.min(low, column)
                high = wp.max(high, column)
    if count > 0:
        wp.atomic_min(found_out, i, 0, low)
        wp.atomic_min(found_out, i, 1, row)
        wp.atomic_max(found_out, i, 2, high)
        wp.atomic_max(found_out, i, 3, row)
        wp.atomic_add(found_out, i, 4, count)
        wp.atomic_min(found_out, i, 5, wp.int32(nearest * 10000.0))


@dataclass(frozen=True, slots=True)
class ObjectBody:
    """The triangles of one object or kind, in axes of its own."""

    points_m: np.ndarray
    """float64 [V, 3]"""
    faces: np.ndarray
    """Three points each [F, 3]."""


def bodies_of(world: World) -> list[ObjectBody]:
    """Bodies of the kinds, without their shade on the ground, then of static instances in world
    axes."""
    bodies = [_body(kind.mesh, kind.mesh.tag != DECAL) for kind in world.kinds]
    own = world.mesh.instance
    bodies += [_body(world.mesh, own == instance) for instance in range(world.instances)]
    return bodies


def sign_fronts(world: World) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Fronts of traffic signs by instance: the middle of the face [m], and where it looks."""
    mesh = world.mesh
    found = {}
    for instance in np.unique(mesh.instance[mesh.material == SIGN]).tolist():
        faces = mesh.faces[(mesh.instance == instance) & (mesh.material == SIGN)]
        a, b, c = mesh.points_m[faces].astype(float).transpose(1, 0, 2)
        found[instance] = ((a + b + c).mean(axis=0) / 3.0, np.cross(b - a, c - a).sum(axis=0))
    return found


def _body(mesh: Mesh, own: np.ndarray) -> ObjectBody:
    used, faces = np.unique(mesh.faces[own], return_inverse=True)
    return ObjectBody(mesh.points_m[used].astype(float), faces.reshape(-1, 3))


@dataclass(frozen=True, slots=True)
class Subject:
    """An object to be counted: which body, where, seen by whom."""

    body: int
    position_m: np.ndarray
    yaw_rad: float
    eyepoint: Eyepoint

    def shape(self, bodies: list[ObjectBody]) -> Shape:
        """Points of the object in the camera's frame, and its triangles."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        body = bodies[self.body]
        world = rotated(body.points_m, turn) + self.position_m
        return self.eyepoint.camera_from_world(world), body.faces


class Silhouettes:
    """Counts the pixels of single objects."""

    def __init__(self, bodies: list[ObjectBody], device: wp.Device) -> None:
        self._device = device
        shape = bvh.CPU if device.is_cpu else bvh.CUDA
        nodes, leaves, roots = [], [], []
        node = leaf = 0
        for body in bodies:
            built = bvh.build_bvh(body.points_m.astype(np.float32), body.faces, shape)
            words = built.words(node, leaf, shape)
            nodes.append(words[0])
            leaves.append(words[1])
            roots.append(node)
            node += len(built.nodes)
            leaf += len(built.leaves)
        self._nodes = wp.array(np.concatenate(nodes), dtype=wp.float32, device=device)
        self._leaves = wp.array(np.concatenate(leaves), dtype=wp.float32, device=device)
        self._roots = roots
        load_kernels(device, [silhouette_kernel])

    def count(
        self, subjects: list[Subject], outlines: list[Outline], rays: wp.array, view: EyeView
    ) -> np.ndarray:
        """Boxes, pixels and distances of the subjects, each as if it were alone: int32 [N, 6].

        Args:
            outlines: of each, where to look.
            rays: the camera's table [H, W].
        """
        if not subjects:
            return np.zeros((0, _FIELDS), np.int32)
        rows = np.zeros(len(subjects), Item.numpy_dtype())
        for row, subject, outline in zip(rows, subjects, outlines, strict=True):
            seat = subject.eyepoint
            row["root"] = self._roots[subject.body]
            row["low_x"], row["low_y"], row["high_x"], row["high_y"] = outline.bounds_px
            row["position"] = subject.position_m
            row["cosine"], row["sine"] = np.cos(subject.yaw_rad), np.sin(subject.yaw_rad)
            row["eye"] = seat.eye_m
            row["right"], row["down"], row["ahead"] = seat.world_from_camera.T
        items = wp.array(rows, dtype=Item, device=self._device)
        empty = np.tile(np.array([_FAR, _FAR, -1, -1, 0, _FAR], np.int32), (len(rows), 1))
        found = wp.array(empty, dtype=wp.int32, device=self._device)
        wp.launch(
            silhouette_kernel,
            (len(rows), view.height),
            inputs=[self._nodes, self._leaves, rays, view.lens.near_m, view.lens.far_m, items],
            outputs=[found],
            device=self._device,
        )
        return found.numpy()
