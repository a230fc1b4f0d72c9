"""What materials from files say of the pixels that see them: a kernel between visibility and
shading.

It runs over a list of those pixels, so that the threads of a warp are all busy with images and
normal maps, and the kernels that shade need no registers for any of it. What both second rays and
pictures ask for is worked out once.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from twin.base.portable.quick import dot, of_axes
from twin.render.build import KernelOptions
from twin.render.light.light import SlotLight
from twin.render.look_pixels import keep_look, keep_ruffle
from twin.render.look_surface import look_mirrors, look_ruffle, smooth_point
from twin.render.shading import look_of, place_of
from twin.render.trace.geometry import RayScene
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.visibility import (
    SECOND_RANGE_M,
    PixelsSeen,
    list_is_done,
    needs_second_rays,
    next_of_list,
    pixel_of,
    put_on_list,
)
from twin.world.meshes.details import MIRROR_MIN

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_MIRROR_MIN = wp.constant(MIRROR_MIN)


@cache
def look_kernel(build: KernelOptions, second: bool) -> wp.Kernel:
    """The kernel, compiled as ``build`` says; ``second``: it lists pixels for second rays."""

    @wp.kernel(**build.arguments())
    def details_kernel(
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
        """Work out the points of the pixels on the list; the launch may be shorter than it."""
        count = seen.detailed_count[0]
        while True:
            place = next_of_list(seen.detailed_count)
            if list_is_done(place, count):
                break
            if place >= count:
                continue
            thread = seen.detailed[place]
            pixel = pixel_of(thread, first_slot, optics)
            slot = pixel.slot
            pose = poses[slot]
            ray = rays[pixel.row, pixel.column]
            direction = of_axes(ray, pose.right, pose.down, pose.ahead)
            at = place_of(scene, slot, seen, thread, pose.eye, direction)
            # Light is written before the normal is worked out: fewer registers are held.
            own = look_of(scene, optics, at, direction)
            flags = keep_look(seen.look, thread, own)
            smooth = smooth_point(scene, slot, at.face, at.object, at.u, at.v, at.n)
            ruffle = look_ruffle(
                scene, slot, at.face, at.object, at.n, smooth.n, at.u, at.v, own.bump, direction
            )
            flags = flags | keep_ruffle(seen.look, thread, ruffle)
            seen.flags[thread] = seen.flags[thread] | flags
            if wp.static(second):
                cosine = -dot(at.n, direction)
                material = scene.faces[at.face].material
                needs = needs_second_rays(material, lights[slot].wetness, cosine, at.distance)
                if own.mirror >= _MIRROR_MIN and at.distance < SECOND_RANGE_M:
                    needs = needs or look_mirrors(scene, at.face)
                if needs:
                    put_on_list(seen.listed, seen.listed_count, thread)

    return details_kernel
