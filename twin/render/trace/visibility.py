"""What every pixel sees, and whether the sun reaches it: the part of a picture that traces rays.

Kept apart from shading: a traversal needs few registers, so many rays are under way at once.
Threads run over (slot, 8x4 tile of pixels): a GPU warp is one tile, and a CPU core stays in the
same part of the hierarchy. What is found is stored in the order of the threads.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from twin.base.portable.quick import ahead_of, dot, of_axes, reciprocal
from twin.render.build import NONE, Features, KernelOptions
from twin.render.light.light import SlotLight
from twin.render.look_pixels import PARTS
from twin.render.look_surface import smooth_point
from twin.render.surface import is_ground, may_mirror
from twin.render.trace.geometry import RayScene, out_of_object, rays_of
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.sun_packet import LANES, Lanes, unblocked

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE_COLUMNS, TILE_ROWS = 8, 4
_TILE_COLUMNS = wp.constant(TILE_COLUMNS)
_TILE_ROWS = wp.constant(TILE_ROWS)
_TILE = wp.constant(TILE_COLUMNS * TILE_ROWS)
_LANES = wp.constant(LANES)
SUN_RANGE_M = wp.constant(400.0)
"""Distance at which something may still cast a shadow [m]."""

SECOND_RANGE_M = wp.constant(40.0)
"""Farther glass and lacquer mirror nothing but the sky [m]."""
# A film of water reflects less than a fifth of what meets it more steeply.
_WET_COSINE = wp.constant(0.3)

NOTHING = wp.constant(-1)
"""Face of a pixel that sees the sky."""
OUTSIDE = wp.constant(-2)
"""Face of a pixel where the lens sees nothing."""
LIT = wp.constant(1 << 16)
"""Flag: the sun reaches the point."""
ASKED = wp.constant(1 << 17)
"""Flag: a ray to the sun was traced."""
MIRRORED = wp.constant(1 << 18)
"""Flag: second rays were followed."""
DETAILED = wp.constant(1 << 19)
"""Flag: the face has details."""
CURVED = wp.constant(1 << 20)
"""Flag, of pixels that are drawn: the face has normals at its corners."""
OBJECT_MASK = wp.constant((1 << 16) - 1)
"""Bits of the flags that hold the object + 1; 0: static."""

BYTES_PER_PIXEL = 26
"""Size of a pixel of :class:`PixelsSeen` [bytes]."""
DETAIL_BYTES_PER_PIXEL = 68
"""What is added where materials come from files [bytes]."""
CHUNK_PIXELS = 1 << 24
"""Pixels that are under way at once: 436 MB of :class:`PixelsSeen`, and 403 MB of what second rays
meet."""


@wp.struct
class PixelsSeen:
    """What the pixels of some slots see."""

    t: wp.array(dtype=wp.float32)
    """Distance along the ray [m]."""
    face: wp.array(dtype=wp.int32)
    flags: wp.array(dtype=wp.int32)
    bary: wp.array(dtype=wp.int32)
    """Barycentric weights of the first two corners, 16 bits each, of 65535."""
    listed: wp.array(dtype=wp.int32)
    """Threads whose pixels need second rays, in any order."""
    listed_count: wp.array(dtype=wp.int32)
    """Number of listed pixels, and how many of them :func:`next_of_list` has given out [2]."""
    second: wp.array2d(dtype=wp.float16)
    """Luminance that comes by mirrors and through glass, RGB, where flagged [cd/m^2]."""
    detailed: wp.array(dtype=wp.int32)
    """Threads whose pixels see faces with details, in any order."""
    detailed_count: wp.array(dtype=wp.int32)
    """Number of these pixels, and how many have been given out [2]."""
    look: wp.array2d(dtype=wp.vec4)
    """What the materials of such faces say, see :mod:`twin.render.look_pixels`."""


@wp.struct
class Pixel:
    """Which pixel a thread works on."""

    slot: wp.int32
    row: wp.int32
    column: wp.int32
    inside: wp.bool


def threads(slots: int, height: int, width: int) -> int:
    """Threads for the pictures of ``slots``."""
    tiles = -(-width // TILE_COLUMNS) * -(-height // TILE_ROWS)
    return slots * tiles * TILE_COLUMNS * TILE_ROWS


def allocate_seen(
    slots: int,
    height: int,
    width: int,
    device: wp.Device,
    second: bool = True,
    features: Features = NONE,
) -> PixelsSeen:
    """Buffers for ``slots`` at once; ``second``: for second rays as well."""
    count = threads(slots, height, width)
    seen = PixelsSeen()
    seen.t = wp.empty(count, dtype=wp.float32, device=device)
    seen.face = wp.empty(count, dtype=wp.int32, device=device)
    seen.flags = wp.zeros(count, dtype=wp.int32, device=device)
    seen.bary = wp.empty(count, dtype=wp.int32, device=device)
    listed = count if second else 1
    seen.listed = wp.empty(listed, dtype=wp.int32, device=device)
    seen.listed_count = wp.zeros(2, dtype=wp.int32, device=device)
    seen.second = wp.empty((listed, 3), dtype=wp.float16, device=device)
    detailed = count if features.looks else 1
    seen.detailed = wp.empty(detailed, dtype=wp.int32, device=device)
    seen.detailed_count = wp.zeros(2, dtype=wp.int32, device=device)
    seen.look = wp.empty((PARTS, detailed), dtype=wp.vec4, device=device)
    return seen


def rays_traced(seen: PixelsSeen, count: int) -> int:
    """Rays behind the first ``count`` threads' results: to what is seen, and to the sun; pixels
    with second rays once more."""
    face, flags = seen.face.numpy()[:count], seen.flags.numpy()[:count]
    seen_any = np.count_nonzero(face != int(OUTSIDE))
    listed = int(seen.listed_count.numpy()[0])
    return seen_any + np.count_nonzero((face >= 0) & (flags & int(ASKED) != 0)) + listed


# The threads of a warp take their places together. The order differs from run to run, what is found
# for a pixel does not.
_LIST = """
    #if defined(__CUDA_ARCH__)
    const unsigned mates = __activemask();
    unsigned lane;
    asm("mov.u32 %0, %%laneid;" : "=r"(lane));
    const int leader = __ffs(mates) - 1;
    int first = 0;
    if (lane == leader) first = atomicAdd(count.data, __popc(mates));
    first = __shfl_sync(mates, first, leader);
    places.data[first + __popc(mates & ((1u << lane) - 1u))] = thread;
    #else
    places.data[count.data[0]++] = thread;
    #endif
"""


@wp.func_native(_LIST)
def put_on_list(
    places: wp.array(dtype=wp.int32), count: wp.array(dtype=wp.int32), thread: wp.int32
):
    """Append ``thread`` to the first ``count[0]`` of ``list``."""


# All threads of a warp wait for each other here.
_NEXT = """
    #if defined(__CUDA_ARCH__)
    unsigned lane;
    asm("mov.u32 %0, %%laneid;" : "=r"(lane));
    int first = 0;
    if (lane == 0) first = atomicAdd(count.data + 1, 32);
    return __shfl_sync(0xffffffffu, first, 0) + (int)lane;
    #else
    return count.data[1]++;
    #endif
"""


@wp.func_native(_NEXT)
def next_of_list(count: wp.array(dtype=wp.int32)) -> wp.int32:
    """Next place on a list that no thread has worked on, perhaps beyond its end: a GPU's warps take
    32 at a time, as they get done, so that none is left with the longest rays of all."""


@wp.func
def list_is_done(place: wp.int32, count: wp.int32) -> wp.bool:
    """Whether the whole warp of a thread that got ``place`` has nothing left of ``count``."""
    return place - place % 32 >= count


@wp.func
def reach_of(optics: Optics, ray: wp.vec3) -> wp.vec2:
    """Nearest and farthest distance along a ray, in the camera's axes, that a picture shows [m]."""
    if optics.spherical != 0:
        return wp.vec2(optics.near, optics.far)
    if ray[2] > 1.0e-3:
        stretch = reciprocal(ray[2])
        return wp.vec2(optics.near * stretch, wp.min(optics.far * stretch, 4.0 * optics.far))
    return wp.vec2(0.0, optics.far)


@wp.func
def share_of(weight: wp.int32) -> wp.float32:
    """A barycentric weight as :class:`PixelsSeen` has it."""
    return wp.float32(weight) * 1.5259022e-5


@wp.func
def needs_second_rays(
    material: wp.int32, wetness: wp.float32, cosine: wp.float32, distance: wp.float32
) -> wp.bool:
    """Whether mirrors and glass are worth a ray: near, and on wet ground at grazing angles."""
    needs = may_mirror(material) and distance < SECOND_RANGE_M
    if wetness > 0.5 and is_ground(material):
        needs = cosine < _WET_COSINE
    return needs


@wp.func
def pixel_of(thread: wp.int32, first_slot: wp.int32, optics: Optics) -> Pixel:
    """The pixel of a thread."""
    pixel = Pixel()
    tiles_x = (optics.width + _TILE_COLUMNS - 1) / _TILE_COLUMNS
    tiles_y = (optics.height + _TILE_ROWS - 1) / _TILE_ROWS
    tile = thread / _TILE
    place = thread - tile * _TILE
    slot = tile / (tiles_x * tiles_y)
    tile = tile - slot * tiles_x * tiles_y
    line = tile / tiles_x
    pixel.slot = first_slot + slot
    pixel.row = line * _TILE_ROWS + place / _TILE_COLUMNS
    pixel.column = (tile - line * tiles_x) * _TILE_COLUMNS + place % _TILE_COLUMNS
    pixel.inside = pixel.row < optics.height and pixel.column < optics.width
    return pixel


@cache
def visibility_kernel(build: KernelOptions, second: bool, features: Features = NONE) -> wp.Kernel:
    """The kernel, compiled as ``build`` says for worlds with such ``features``; ``second``: it
    lists pixels for second rays."""
    looks = features.looks
    trace, occluded = rays_of(features)

    @wp.kernel(**build.arguments())
    def first_kernel(
        # model
        scene: RayScene,
        optics: Optics,
        rays: wp.array2d(dtype=wp.vec3),
        # state in
        lights: wp.array(dtype=SlotLight),
        poses: wp.array(dtype=SlotPose),
        # args
        first_slot: wp.int32,
        # out
        seen: PixelsSeen,
    ):
        """Trace every pixel of the slots from ``first_slot`` on, and the sun from where it ends."""
        thread = wp.tid()
        pixel = pixel_of(thread, first_slot, optics)
        if not pixel.inside:
            return
        slot = pixel.slot
        if lights[slot].active == 0:
            return
        ray = rays[pixel.row, pixel.column]
        if ray[2] == 0.0 and ray[0] == 0.0 and ray[1] == 0.0:
            seen.face[thread] = OUTSIDE
            return
        direction = of_axes(ray, poses[slot].right, poses[slot].down, poses[slot].ahead)
        reach = reach_of(optics, ray)
        near = reach[0]
        far = reach[1]
        eye = poses[slot].eye
        hit = trace(scene, slot, eye, direction, near, far)
        if not hit.found:
            seen.face[thread] = NOTHING
            return
        u = wp.int32(wp.clamp(hit.u, 0.0, 1.0) * 65535.0 + 0.5)
        v = wp.int32(wp.clamp(hit.v, 0.0, 1.0) * 65535.0 + 0.5)
        flags = hit.object + 1
        if wp.static(looks):
            detailed = scene.faces[hit.face].uv_per_m < 0.0
            if detailed:
                flags = flags | DETAILED
                put_on_list(seen.detailed, seen.detailed_count, thread)
        if lights[slot].shadows != 0:
            sun = lights[slot].sun_direction
            facing = hit.normal
            start = ahead_of(ahead_of(eye, direction, hit.t), hit.normal, 0.02)
            if wp.static(looks):  # noqa: SIM102 (resolved before the kernel is compiled)
                if detailed:
                    # As coarse as it is stored, so that a picture that is drawn has the same.
                    smooth = smooth_point(
                        scene, slot, hit.face, hit.object, share_of(u), share_of(v), hit.normal
                    )
                    facing = smooth.n
                    start = start + smooth.lift
            if dot(facing, sun) > 0.0:
                flags = flags | ASKED
                if not occluded(scene, slot, start, sun, SUN_RANGE_M):
                    flags = flags | LIT
        seen.t[thread] = hit.t
        seen.face[thread] = hit.face
        seen.flags[thread] = flags
        if wp.static(second):
            material = scene.faces[hit.face].material
            cosine = -dot(hit.normal, direction)
            needs = needs_second_rays(material, lights[slot].wetness, cosine, hit.t)
            if wp.static(looks):
                needs = needs and not detailed
            if needs:
                put_on_list(seen.listed, seen.listed_count, thread)
        seen.bary[thread] = (u << 16) | v

    return first_kernel


@wp.struct
class SunQuestion:
    """Whether the sun reaches what a pixel sees."""

    asked: wp.bool
    """It may: the place faces it."""
    start: wp.vec3
    """Where the ray to the sun begins [m]."""


@cache
def _question(second: bool, features: Features) -> Any:
    """The function that says what is to be asked of a pixel that was drawn."""
    looks = features.looks

    @wp.func
    def sun_question(
        scene: RayScene,
        rays: wp.array2d(dtype=wp.vec3),
        light: SlotLight,
        pose: SlotPose,
        slot: wp.int32,
        row: wp.int32,
        column: wp.int32,
        thread: wp.int32,
        seen: PixelsSeen,
    ) -> SunQuestion:
        question = SunQuestion()
        face = seen.face[thread]
        if face < 0:
            return question
        ray = rays[row, column]
        direction = of_axes(ray, pose.right, pose.down, pose.ahead)
        flags = seen.flags[thread]
        if wp.static(looks):
            detailed = (flags & DETAILED) != 0
        normal = scene.faces[face].normal
        m = (flags & OBJECT_MASK) - 1
        if m >= 0:
            normal = out_of_object(normal, scene.objects[slot, m])
        if dot(normal, direction) > 0.0:
            normal = -normal
        if wp.static(second):
            material = scene.faces[face].material
            cosine = -dot(normal, direction)
            needs = needs_second_rays(material, light.wetness, cosine, seen.t[thread])
            if wp.static(looks):
                needs = needs and not detailed
            if needs:
                put_on_list(seen.listed, seen.listed_count, thread)
        if light.shadows == 0:
            return question
        facing = normal
        question.start = ahead_of(ahead_of(pose.eye, direction, seen.t[thread]), normal, 0.02)
        if wp.static(looks):  # noqa: SIM102 (resolved before the kernel is compiled)
            if (flags & CURVED) != 0:
                bary = seen.bary[thread]
                u = share_of((bary >> 16) & 65535)
                v = share_of(bary & 65535)
                smooth = smooth_point(scene, slot, face, m, u, v, normal)
                facing = smooth.n
                question.start = question.start + smooth.lift
        question.asked = dot(facing, light.sun_direction) > 0.0
        return question

    return sun_question


@cache
def sun_kernel(build: KernelOptions, second: bool, features: Features = NONE) -> wp.Kernel:
    """The kernel that asks for the sun after drawing, for the CPU; arguments as of
    :func:`visibility_kernel`, a thread per :data:`~twin.render.trace.sun_packet.LANES` pixels."""
    _, occluded = rays_of(features)
    sun_question = _question(second, features)
    packets = not features.holes

    @wp.kernel(**build.arguments())
    def shadow_kernel(
        # model
        scene: RayScene,
        optics: Optics,
        rays: wp.array2d(dtype=wp.vec3),
        # state in
        lights: wp.array(dtype=SlotLight),
        poses: wp.array(dtype=SlotPose),
        # args
        first_slot: wp.int32,
        # out
        seen: PixelsSeen,
    ):
        """Trace the sun from what the slots from ``first_slot`` on see."""
        first = wp.tid() * _LANES
        corner = pixel_of(first, first_slot, optics)
        slot = corner.slot
        light = lights[slot]
        if light.active == 0:
            return
        if wp.static(not second):  # noqa: SIM102 (resolved before the kernel is compiled)
            if light.shadows == 0:  # nothing to ask, nothing to list
                return
        pose = poses[slot]
        x, y, z = Lanes(), Lanes(), Lanes()
        asked = wp.int32(0)
        lane = wp.int32(0)
        while lane < _LANES:
            row = corner.row + lane / _TILE_COLUMNS
            column = corner.column + lane % _TILE_COLUMNS
            if row < optics.height and column < optics.width:
                question = sun_question(
                    scene, rays, light, pose, slot, row, column, first + lane, seen
                )
                if question.asked:
                    asked = asked | (1 << lane)
                    x[lane] = question.start[0]
                    y[lane] = question.start[1]
                    z[lane] = question.start[2]
            lane += 1
        if asked == 0:
            return
        sun = light.sun_direction
        lit = wp.int32(0)
        if wp.static(packets):
            lit = unblocked(scene, slot, x, y, z, asked, sun, SUN_RANGE_M)
        lane = wp.int32(0)
        while lane < _LANES:
            if ((asked >> lane) & 1) != 0:
                if wp.static(not packets):
                    start = wp.vec3(x[lane], y[lane], z[lane])
                    if not occluded(scene, slot, start, sun, SUN_RANGE_M):
                        lit = lit | (1 << lane)
                flags = seen.flags[first + lane] | ASKED
                if ((lit >> lane) & 1) != 0:
                    flags = flags | LIT
                seen.flags[first + lane] = flags
            lane += 1

    return shadow_kernel
