"""What rays meet: one static mesh that all slots share, and each slot's movable objects.

Cameras and lidars of a rig share one :class:`Geometry`, so there is one hierarchy of the street
however many sensors look at it. A movable object is an instance of a kind: a small mesh of its
own, moved by a pose. Rays meet the static mesh first; of the objects only those whose sphere they
enter.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from twin.actors.motion import Placement
from twin.base.portable.host import sine_cosine
from twin.base.portable.quick import dot
from twin.render.build import Features
from twin.render.looks import LookTables, has_looks, pack_looks
from twin.render.texture import Textures, pack_textures
from twin.render.trace import bvh, traverse
from twin.render.trace.cutouts import Cutouts, mark_holes, masks_of_faces, pack_cutouts
from twin.world.kept import kept
from twin.world.meshes.mesh import DECAL, Mesh
from twin.world.mirror import Mirror
from twin.world.street.build import World

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BLOCK = 8  # spheres that are met together
_NOWHERE_M = 1e9


DECAL_TAG = wp.constant(DECAL)
"""Tag of faces that are painted on: the shade below an object is no part of it."""


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
    normal: wp.vec3
    """Unit, in the mesh's own axes."""
    uv_per_m: wp.float32
    """Texture coordinates per metre, the square root of the ratio of areas [1/m]; below 0: the face
    has a row of details (:class:`twin.render.looks.LookTables`), which is at hand here."""


@wp.struct
class ObjectPose:
    """Pose of a movable object of a slot."""

    root: wp.int32
    """Root of its kind's hierarchy; 0: it is not there."""
    first_face: wp.int32
    """First face of its kind, in the table of faces."""
    instance: wp.int32
    position: wp.vec3
    """Position of the kind's origin, world [m]."""
    cosine: wp.float32
    """Cosine of its yaw."""
    sine: wp.float32
    tilt: wp.vec4
    """Sine and cosine of its pitch, then of its roll; it stands level where both sines are 0."""
    centre: wp.vec3
    """Centre of the sphere around it, world [m]."""
    radius: wp.float32
    """[m]"""
    half: wp.vec2
    """Half its length and width [m]."""
    velocity: wp.vec3
    """World [m/s]."""
    yaw_rate: wp.float32
    """[rad/s]"""
    brake: wp.float32
    """Brake lamps, 0 or 1."""
    lamps: wp.float32
    """Head and tail lamps, 0 or 1."""
    lights: wp.int32
    """Bit of each :class:`twin.actors.lamps.VehicleLamp` that is on."""


@wp.struct
class RayScene:
    """Handle that kernels get."""

    nodes: wp.array(dtype=wp.float32)
    """Hierarchies of the static mesh, then of each kind; see :mod:`twin.render.trace.bvh`."""
    leaves: wp.array(dtype=wp.float32)
    faces: wp.array(dtype=Face)
    """Faces of the static mesh, then of each kind."""
    uv: wp.array(dtype=wp.vec2)
    """Texture coordinates of each face's three corners [3 F]."""
    ambient: wp.array(dtype=wp.float32)
    """Share of the sky that each face's three corners see [3 F]."""
    textures: Textures
    cuts: Cutouts
    """Faces with holes."""
    looks: LookTables
    """Materials from files."""
    objects: wp.array2d(dtype=ObjectPose)
    """[S, M]"""
    spheres: wp.array3d(dtype=wp.float32)
    """Around the objects [S, B, 32], eight to a block; see
    :func:`twin.render.trace.traverse.spheres_entered`."""
    signals: wp.array2d(dtype=wp.int32)
    """Lamps of traffic lights that are on: bit 0 red, 1 amber, 2 green [S, K]."""


@wp.struct
class RayHit:
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
def turned(v: wp.vec3, c: wp.float32, s: wp.float32) -> wp.vec3:
    """``v`` after a yaw with cosine ``c`` and sine ``s``."""
    return wp.vec3(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@wp.func
def into_object(v: wp.vec3, pose: ObjectPose) -> wp.vec3:
    """A direction of the world in an object's own axes.

    The axes are turned about z by the yaw, then about y by the pitch, then about x by the roll
    (ISO 8855): the nose of an object with a positive pitch points down.
    """
    own = turned(v, pose.cosine, -pose.sine)
    if pose.tilt[0] != 0.0 or pose.tilt[2] != 0.0:
        x = pose.tilt[1] * own[0] - pose.tilt[0] * own[2]
        z = pose.tilt[0] * own[0] + pose.tilt[1] * own[2]
        y = pose.tilt[3] * own[1] + pose.tilt[2] * z
        own = wp.vec3(x, y, pose.tilt[3] * z - pose.tilt[2] * own[1])
    return own


@wp.func
def out_of_object(v: wp.vec3, pose: ObjectPose) -> wp.vec3:
    """A direction in an object's own axes in those of the world; the inverse of
    :func:`into_object`."""
    level = v
    if pose.tilt[0] != 0.0 or pose.tilt[2] != 0.0:
        z = pose.tilt[2] * v[1] + pose.tilt[3] * v[2]
        y = pose.tilt[3] * v[1] - pose.tilt[2] * v[2]
        x = pose.tilt[1] * v[0] + pose.tilt[0] * z
        level = wp.vec3(x, y, pose.tilt[1] * z - pose.tilt[0] * v[0])
    return turned(level, pose.cosine, pose.sine)


def ray_functions(closest: Any, blocked: Any, *, holes: bool = False) -> tuple[Any, Any]:
    """``trace`` and ``occluded`` on traversals like those of :mod:`twin.render.trace.traverse`;
    ``holes``: like those that pass holes."""

    @wp.func
    def trace(
        scene: RayScene,
        slot: wp.int32,
        origin: wp.vec3,
        direction: wp.vec3,
        near: wp.float32,
        far: wp.float32,
    ) -> RayHit:
        """What the ray from ``origin`` along unit ``direction`` meets first, from ``near`` to below
        ``far`` [m]."""
        hit = RayHit()
        hit.object = wp.int32(-1)
        hit.instance = wp.int32(-1)
        if wp.static(holes):
            found = closest(
                scene.nodes, scene.leaves, scene.uv, scene.cuts, 0, 0, origin, direction, near, far
            )
        else:
            found = closest(scene.nodes, scene.leaves, 0, origin, direction, near, far)
        hit.face = wp.cast(found[3], wp.int32)
        for block in range(scene.spheres.shape[1]):
            mask = traverse.spheres_entered(scene.spheres, slot, block, origin, direction, found[0])
            while mask != 0:
                k = traverse.lowest_bit(mask)
                mask = mask & (mask - 1)
                m = block * 8 + k
                pose = scene.objects[slot, m]
                local = into_object(origin - pose.position, pose)
                ahead = into_object(direction, pose)
                if wp.static(holes):
                    own = closest(
                        scene.nodes,
                        scene.leaves,
                        scene.uv,
                        scene.cuts,
                        pose.root,
                        pose.first_face,
                        local,
                        ahead,
                        near,
                        found[0],
                    )
                else:
                    own = closest(
                        scene.nodes, scene.leaves, pose.root, local, ahead, near, found[0]
                    )
                face = wp.cast(own[3], wp.int32)
                if face >= 0:
                    found = own
                    hit.face = pose.first_face + face
                    hit.object = m
        hit.t = found[0]
        hit.u = found[1]
        hit.v = found[2]
        if hit.face >= 0:
            hit.found = True
            hit.normal = scene.faces[hit.face].normal
            hit.instance = scene.faces[hit.face].instance
            if hit.object >= 0:
                if scene.faces[hit.face].tag != DECAL_TAG:
                    hit.instance = scene.objects[slot, hit.object].instance
                hit.normal = out_of_object(hit.normal, scene.objects[slot, hit.object])
            if dot(hit.normal, direction) > 0.0:
                hit.normal = -hit.normal
        return hit

    @wp.func
    def occluded(
        scene: RayScene, slot: wp.int32, origin: wp.vec3, direction: wp.vec3, far: wp.float32
    ) -> wp.bool:
        """Whether anything lies on the ray within ``far`` [m]."""
        if wp.static(holes):
            if blocked(
                scene.nodes, scene.leaves, scene.uv, scene.cuts, 0, 0, origin, direction, 0.0, far
            ):
                return True
        else:
            if blocked(scene.nodes, scene.leaves, 0, origin, direction, 0.0, far):
                return True
        for block in range(scene.spheres.shape[1]):
            mask = traverse.spheres_entered(scene.spheres, slot, block, origin, direction, far)
            while mask != 0:
                m = block * 8 + traverse.lowest_bit(mask)
                mask = mask & (mask - 1)
                pose = scene.objects[slot, m]
                local = into_object(origin - pose.position, pose)
                ahead = into_object(direction, pose)
                if wp.static(holes):
                    if blocked(
                        scene.nodes,
                        scene.leaves,
                        scene.uv,
                        scene.cuts,
                        pose.root,
                        pose.first_face,
                        local,
                        ahead,
                        0.0,
                        far,
                    ):
                        return True
                else:
                    if blocked(scene.nodes, scene.leaves, pose.root, local, ahead, 0.0, far):
                        return True
        return False

    return trace, occluded


trace, occluded = ray_functions(traverse.closest, traverse.blocked)


@cache
def rays_of(features: Features) -> tuple[Any, Any]:
    """``trace`` and ``occluded`` for worlds with such ``features``."""
    if not features.holes:
        return trace, occluded
    return ray_functions(traverse.closest_there, traverse.blocked_there, holes=True)


class Geometry:
    """The meshes of a rig on its device, and where each slot's objects are."""

    def __init__(
        self, world: World, slots: int, device: wp.Device, shape: bvh.BvhWidth | None = None
    ) -> None:
        """``shape`` of the hierarchies: by default the one that the device's traversal expects."""
        self.device = device
        self.slots = slots
        self.world = world
        self.classes = wp.array(world.classes, dtype=wp.int32, device=device)
        """Class of each instance, index into :data:`schemas.messages.OBJECT_CLASSES`."""
        self.instances = len(world.classes)
        meshes = [world.mesh, *(kind.mesh for kind in world.kinds)]
        self._first_face = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        self._spheres = np.array([_sphere(mesh) for mesh in meshes])
        halves = [(0.0, 0.0), *((k.half_length_m, k.half_width_m) for k in world.kinds)]
        self._halves = np.array(halves)
        scene = RayScene()
        shape = shape or (bvh.CPU if device.is_cpu else bvh.CUDA)
        nodes, leaves, self._roots = _hierarchies_of(world, shape)
        of_face = masks_of_faces(meshes, [look.mask for look in world.looks])
        if world.masks and not shape.packed:
            leaves = mark_holes(leaves, of_face, self._first_face)
        scene.nodes = wp.array(nodes, dtype=wp.float32, device=device)
        scene.leaves = wp.array(leaves, dtype=wp.float32, device=device)
        self.features = Features(holes=bool(world.masks), looks=has_looks(world))
        """What the materials of the world ask of kernels."""
        rows = np.concatenate([_face_rows(mesh, self.features) for mesh in meshes])
        scene.faces = wp.array(rows, dtype=Face, device=device)
        corners = [mesh.faces.ravel() for mesh in meshes]
        uv = np.concatenate([m.uv[c] for m, c in zip(meshes, corners, strict=True)])
        ambient = np.concatenate([m.ambient[c] for m, c in zip(meshes, corners, strict=True)])
        scene.uv = wp.array(uv, dtype=wp.vec2, device=device)
        scene.ambient = wp.array(ambient, dtype=wp.float32, device=device)
        scene.textures = pack_textures(world.textures, device, world.texture_kinds)
        scene.cuts = pack_cutouts(of_face, world.masks, device)
        scene.looks = pack_looks(meshes, world, device)
        count = world.motion.count
        self.poses = Mirror((slots, count), ObjectPose, device)
        scene.objects = self.poses.device
        blocks = -(-count // _BLOCK)
        self._around = Mirror((slots, blocks, 4 * _BLOCK), wp.float32, device)
        self._around.host.reshape(slots, blocks, 4, _BLOCK)[:, :, :2] = _NOWHERE_M
        self._around.host.reshape(slots, blocks, 4, _BLOCK)[:, :, 3] = -1.0
        scene.spheres = self._around.device
        self.signals = Mirror((slots, len(world.signals)), wp.int32, device)
        """Lamps of the traffic lights; pushed by :meth:`place`."""
        scene.signals = self.signals.device
        self.scene = scene

    def place(self, placement: Placement) -> None:
        """Put every slot's objects where ``placement`` says."""
        world, count = self.world, self.world.motion.count
        if placement.signals is not None and placement.signals.size:
            self.signals.host[...] = placement.signals
            self.signals.push()
        if not count:
            return
        rows = self.poses.host
        kind = placement.kind + 1  # 0: not there
        sine, cosine = sine_cosine(placement.yaw_rad)
        sphere = self._spheres[kind]
        rows["root"] = np.where(kind > 0, self._roots[kind], 0)
        rows["first_face"] = self._first_face[kind]
        rows["instance"] = world.first_mover + np.arange(count)
        if placement.class_index is not None:
            rows["instance"] += count * placement.class_index
        rows["position"] = placement.position_m
        rows["cosine"], rows["sine"] = cosine, sine
        x, y, z = sphere[..., 0], sphere[..., 1], sphere[..., 2]
        rows["tilt"] = (0.0, 1.0, 0.0, 1.0)
        if placement.pitch_rad is not None and placement.roll_rad is not None:
            up_sine, up_cosine = sine_cosine(placement.pitch_rad)
            side_sine, side_cosine = sine_cosine(placement.roll_rad)
            rows["tilt"] = np.stack([up_sine, up_cosine, side_sine, side_cosine], axis=-1)
            y, z = side_cosine * y - side_sine * z, side_sine * y + side_cosine * z
            x, z = up_cosine * x + up_sine * z, up_cosine * z - up_sine * x
        rows["centre"][..., 0] = placement.position_m[..., 0] + cosine * x - sine * y
        rows["centre"][..., 1] = placement.position_m[..., 1] + sine * x + cosine * y
        rows["centre"][..., 2] = placement.position_m[..., 2] + z
        rows["radius"] = sphere[..., 3]
        rows["half"] = self._halves[kind] if placement.half_m is None else placement.half_m
        rows["velocity"] = placement.velocity_mps
        rows["yaw_rate"] = placement.yaw_rate_radps
        rows["brake"], rows["lamps"] = placement.brake, placement.lamps
        rows["lights"] = 0 if placement.lights is None else placement.lights
        around = self._around.host.reshape(self.slots, -1, 4, _BLOCK)
        # A sphere that no ray enters stands for an object that is not there.
        balls = np.full((self.slots, around.shape[1] * _BLOCK, 4), _NOWHERE_M, np.float32)
        balls[:, :, 3] = -1.0
        there = kind > 0
        balls[:, :count, :3] = np.where(there[..., None], rows["centre"], _NOWHERE_M)
        balls[:, :count, 3] = np.where(there, rows["radius"], -1.0)
        around[...] = balls.reshape(self.slots, -1, _BLOCK, 4).transpose(0, 1, 3, 2)
        self.poses.push()
        self._around.push()


_Hierarchies = tuple[np.ndarray, np.ndarray, np.ndarray]
_last: list[tuple[World, bvh.BvhWidth, _Hierarchies]] = []
"""The world that was prepared last: a process builds several rigs of one world."""


def _hierarchies_of(world: World, shape: bvh.BvhWidth) -> _Hierarchies:
    if not (_last and _last[0][0] is world and _last[0][1] == shape):
        meshes = [world.mesh, *(kind.mesh for kind in world.kinds)]

        def build() -> _Hierarchies:
            return _hierarchies(meshes, shape)

        key = world.key + repr(shape).encode()
        built = kept("hierarchies", key, build) if world.key else build()
        _last[:] = [(world, shape, built)]
    return _last[0][2]


def _hierarchies(
    meshes: list[Mesh], shape: bvh.BvhWidth
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All meshes' hierarchies as flat words, and the node each begins with."""
    nodes, leaves, roots = [], [], []
    node, leaf = 0, 0
    for mesh in meshes:
        built = bvh.build_bvh(mesh.points_m, mesh.faces, shape)
        words = built.words(node, leaf, shape)
        nodes.append(words[0])
        leaves.append(words[1])
        roots.append(node)
        node += len(built.nodes)
        leaf += len(built.leaves)
    return np.concatenate(nodes), np.concatenate(leaves), np.array(roots)


def _face_rows(mesh: Mesh, features: Features) -> np.ndarray:
    rows = np.zeros(len(mesh.faces), Face.numpy_dtype())
    rows["material"], rows["tag"] = mesh.material, mesh.tag
    rows["instance"], rows["color"] = mesh.instance, mesh.color
    rows["semantic"], rows["texture"] = mesh.semantic, mesh.texture
    a, b, c = mesh.points_m[mesh.faces].astype(float).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows["normal"] = normal / np.maximum(length, 1e-30)
    p, q, r = mesh.uv[mesh.faces].astype(float).transpose(1, 0, 2)
    d, e = q - p, r - p
    area = np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
    rows["uv_per_m"] = np.sqrt(area / np.maximum(length[:, 0], 1e-30))
    if features.looks and mesh.details is not None:
        there = mesh.details.row >= 0
        rows["uv_per_m"][there] = -np.maximum(rows["uv_per_m"][there], 1e-30)
    return rows


def _sphere(mesh: Mesh) -> tuple[float, float, float, float]:
    """Centre and radius of a sphere around the mesh [m]."""
    low, high = mesh.points_m.min(axis=0), mesh.points_m.max(axis=0)
    centre = (low + high).astype(float) / 2
    radius = np.linalg.norm(mesh.points_m - centre, axis=1).max()
    # Wider than the mesh by more than a ray's place is rounded far away.
    return (*centre.tolist(), float(radius) * 1.005 + 0.005)
