"""What rays meet: one static mesh that all slots share, and each slot's movable objects.

Cameras and lidars of a rig share one :class:`Geometry`, so there is one BVH of the street however
many sensors look at it. A movable object is an instance of a kind: a small mesh of its own, moved
by a pose. Rays meet the static mesh first; of the objects only those whose sphere the ray enters.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.world.mesh import Mesh
from twin.world.mirror import Mirror
from twin.world.motion import Placement
from twin.world.street import World

wp.set_module_options({"enable_backward": False})

LEAF_SIZE_CPU, LEAF_SIZE_CUDA = 8, 2
"""Faces in a leaf of the BVH; both measured."""


@wp.struct
class Face:
    """Constant data of one triangle."""

    material: wp.int32
    tag: wp.int32
    instance: wp.int32
    """Object it belongs to, -1 for none; faces of movable kinds say 0 and the pose says who."""
    semantic: wp.int32
    texture: wp.int32
    color: wp.vec3


@wp.struct
class ObjectPose:
    """Where a movable object of a slot is."""

    mesh: wp.uint64
    """Mesh of its kind; 0: it is not there."""
    first_face: wp.int32
    """Of its kind, in the table of faces."""
    instance: wp.int32
    position: wp.vec3
    """Of the kind's origin, world [m]."""
    cosine: wp.float32
    """Of its yaw."""
    sine: wp.float32
    centre: wp.vec3
    """Of the sphere around it, world [m]."""
    radius: wp.float32
    """[m]"""
    velocity: wp.vec3
    """World [m/s]."""
    yaw_rate: wp.float32
    """[rad/s]"""
    brake: wp.float32
    """Brake lamps, 0 or 1."""
    lamps: wp.float32
    """Head and tail lamps, 0 or 1."""


@wp.struct
class Scene:
    """Handle that kernels get."""

    mesh: wp.uint64
    """The static mesh."""
    faces: wp.array(dtype=Face)
    """Of the static mesh, then of each kind."""
    uv: wp.array(dtype=wp.vec2)
    """Texture coordinates of each face's three corners [3 F]."""
    ambient: wp.array(dtype=wp.float32)
    """Share of the sky that each face's three corners see [3 F]."""
    objects: wp.array2d(dtype=ObjectPose)
    """[S, M]"""


@wp.struct
class Hit:
    """What a ray meets first."""

    found: wp.bool
    t: wp.float32
    """Distance along the unit direction [m]."""
    face: wp.int32
    """Row of the table of faces."""
    instance: wp.int32
    """-1: none."""
    object: wp.int32
    """Column of the slot's poses; -1: static."""
    normal: wp.vec3
    """Unit, world, on the side the ray came from."""
    u: wp.float32
    v: wp.float32
    """Barycentric coordinates of the first two corners."""


@wp.func
def _turned(v: wp.vec3, c: wp.float32, s: wp.float32) -> wp.vec3:
    return wp.vec3(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@wp.func
def _enters(pose: ObjectPose, origin: wp.vec3, direction: wp.vec3, far: wp.float32) -> wp.bool:
    """Whether the ray comes into the object's sphere within ``far``."""
    to = pose.centre - origin
    along = wp.dot(to, direction)
    square = wp.dot(to, to) - along * along
    reach = pose.radius * pose.radius
    return square <= reach and along + pose.radius > 0.0 and along - pose.radius < far


@wp.func
def trace(
    scene: Scene, slot: wp.int32, origin: wp.vec3, direction: wp.vec3, far: wp.float32
) -> Hit:
    """What the ray from ``origin`` along unit ``direction`` meets first within ``far`` [m]."""
    hit = Hit()
    hit.t = far
    hit.object = wp.int32(-1)
    hit.instance = wp.int32(-1)
    static = wp.mesh_query_ray(scene.mesh, origin, direction, far)
    if static.result:
        hit.found = True
        hit.t = static.t
        hit.face = static.face
        hit.instance = scene.faces[static.face].instance
        hit.normal = static.normal
        hit.u = static.u
        hit.v = static.v
    for m in range(scene.objects.shape[1]):
        pose = scene.objects[slot, m]
        if pose.mesh != wp.uint64(0) and _enters(pose, origin, direction, hit.t):
            local = _turned(origin - pose.position, pose.cosine, -pose.sine)
            ahead = _turned(direction, pose.cosine, -pose.sine)
            own = wp.mesh_query_ray(pose.mesh, local, ahead, hit.t)
            if own.result:
                hit.found = True
                hit.t = own.t
                hit.face = pose.first_face + own.face
                hit.instance = pose.instance
                hit.object = m
                hit.normal = _turned(own.normal, pose.cosine, pose.sine)
                hit.u = own.u
                hit.v = own.v
    if wp.dot(hit.normal, direction) > 0.0:
        hit.normal = -hit.normal
    return hit


@wp.func
def occluded(
    scene: Scene, slot: wp.int32, origin: wp.vec3, direction: wp.vec3, far: wp.float32
) -> wp.bool:
    """Whether anything lies on the ray within ``far`` [m]."""
    if wp.mesh_query_ray_anyhit(scene.mesh, origin, direction, far):
        return True
    for m in range(scene.objects.shape[1]):
        pose = scene.objects[slot, m]
        if pose.mesh != wp.uint64(0) and _enters(pose, origin, direction, far):
            local = _turned(origin - pose.position, pose.cosine, -pose.sine)
            ahead = _turned(direction, pose.cosine, -pose.sine)
            if wp.mesh_query_ray_anyhit(pose.mesh, local, ahead, far):
                return True
    return False


class Geometry:
    """The meshes of a rig on its device, and where each slot's objects are."""

    def __init__(self, world: World, slots: int, device: wp.Device) -> None:
        self.device = device
        self.slots = slots
        self.classes = wp.array(world.classes, dtype=wp.int32, device=device)
        """Class of each instance, index into :data:`schemas.messages.OBJECT_CLASSES`."""
        self.instances = len(world.classes)
        self._world = world
        self._keep: list[wp.array] = []
        meshes = [world.mesh, *(kind.mesh for kind in world.kinds)]
        built = [self._build(mesh) for mesh in meshes]
        self._meshes = built
        self._first_face = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        self._ids = np.array([0, *(mesh.id for mesh in built[1:])], np.uint64)
        self._spheres = np.array([_sphere(mesh) for mesh in meshes])
        scene = Scene()
        scene.mesh = built[0].id
        scene.faces = wp.array(
            np.concatenate([_face_rows(mesh) for mesh in meshes]), dtype=Face, device=device
        )
        corners = [mesh.faces.ravel() for mesh in meshes]
        uv = np.concatenate([m.uv[c] for m, c in zip(meshes, corners, strict=True)])
        ambient = np.concatenate([m.ambient[c] for m, c in zip(meshes, corners, strict=True)])
        scene.uv = wp.array(uv, dtype=wp.vec2, device=device)
        scene.ambient = wp.array(ambient, dtype=wp.float32, device=device)
        self.poses = Mirror((slots, world.motion.count), ObjectPose, device)
        scene.objects = self.poses.device
        self.scene = scene

    def _build(self, mesh: Mesh) -> wp.Mesh:
        points = wp.array(mesh.points_m, dtype=wp.vec3, device=self.device)
        indices = wp.array(mesh.faces.ravel(), dtype=wp.int32, device=self.device)
        leaf = LEAF_SIZE_CPU if self.device.is_cpu else LEAF_SIZE_CUDA
        return wp.Mesh(points, indices, bvh_constructor="sah", bvh_leaf_size=leaf)

    def place(self, placement: Placement) -> None:
        """Put every slot's objects where ``placement`` says."""
        if not self._world.motion.count:
            return
        rows = self.poses.host
        kind = placement.kind + 1  # 0: not there
        cosine, sine = np.cos(placement.yaw_rad), np.sin(placement.yaw_rad)
        sphere = self._spheres[kind]
        rows["mesh"] = self._ids[kind]
        rows["first_face"] = self._first_face[kind]
        rows["instance"] = self._world.first_mover + np.arange(self._world.motion.count)
        rows["position"] = placement.position_m
        rows["cosine"], rows["sine"] = cosine, sine
        x, y, z = sphere[..., 0], sphere[..., 1], sphere[..., 2]
        rows["centre"][..., 0] = placement.position_m[..., 0] + cosine * x - sine * y
        rows["centre"][..., 1] = placement.position_m[..., 1] + sine * x + cosine * y
        rows["centre"][..., 2] = placement.position_m[..., 2] + z
        rows["radius"] = sphere[..., 3]
        rows["velocity"] = placement.velocity_mps
        rows["yaw_rate"] = placement.yaw_rate_radps
        rows["brake"], rows["lamps"] = placement.brake, placement.lamps
        self.poses.push()


def _face_rows(mesh: Mesh) -> np.ndarray:
    rows = np.zeros(len(mesh.faces), Face.numpy_dtype())
    rows["material"], rows["tag"] = mesh.material, mesh.tag
    rows["instance"], rows["color"] = mesh.instance, mesh.color
    rows["semantic"], rows["texture"] = mesh.semantic, mesh.texture
    return rows


def _sphere(mesh: Mesh) -> tuple[float, float, float, float]:
    """Centre and radius of a sphere around the mesh [m]."""
    low, high = mesh.points_m.min(axis=0), mesh.points_m.max(axis=0)
    centre = (low + high).astype(float) / 2
    radius = np.linalg.norm(mesh.points_m - centre, axis=1).max()
    return (*centre.tolist(), float(radius) * 1.0001)
