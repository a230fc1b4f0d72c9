"""What materials from files say of pixels, kept in memory between the kernel that works it out and
those that shade.

Each of :data:`PARTS` vectors of a thread stands beside those of its neighbours, so that a GPU moves
a warp's with one instruction and in whole lines. What a material does not have is neither written
nor read.
"""

from __future__ import annotations

import warp as wp

from twin.render.light.light import SlotLight
from twin.render.look_surface import LookPoint
from twin.render.surface import SurfacePoint, snow_share

wp.set_module_options({"enable_backward": False})

PARTS = 4
"""Albedo and reflectance of the mirror part; what is added to the normal; own light; tint of the
mirror part."""
_LIGHT, _NORMAL, _GLOW, _TINT = (wp.constant(part) for part in range(PARTS))
BENT = wp.constant(1 << 21)
"""Flag: something is added to the normal of the face."""
GLOWS = wp.constant(1 << 22)
"""Flag: the material has a light of its own."""

_PUT = """
    #if defined(__CUDA_ARCH__)
    ((float4*)kept.data)[part * kept.shape[1] + thread] = make_float4(v[0], v[1], v[2], w);
    #else
    kept.data[part * kept.shape[1] + thread] = wp::vec4(v[0], v[1], v[2], w);
    #endif
"""
_GET = """
    #if defined(__CUDA_ARCH__)
    const float4 v = ((const float4*)kept.data)[part * kept.shape[1] + thread];
    return wp::vec4(v.x, v.y, v.z, v.w);
    #else
    return kept.data[part * kept.shape[1] + thread];
    #endif
"""


@wp.func_native(_PUT)
def _put(
    kept: wp.array2d(dtype=wp.vec4), part: wp.int32, thread: wp.int32, v: wp.vec3, w: wp.float32
):
    """Write a vector at once."""


@wp.func_native(_GET)
def _get(kept: wp.array2d(dtype=wp.vec4), part: wp.int32, thread: wp.int32) -> wp.vec4:
    """Read a vector at once."""


@wp.func
def keep_look(kept: wp.array2d(dtype=wp.vec4), thread: wp.int32, at: LookPoint) -> wp.int32:
    """Write what a thread's material says of light; the flags of what was written."""
    flags = wp.int32(0)
    _put(kept, _LIGHT, thread, at.albedo, at.mirror)
    if at.emission[0] != 0.0 or at.emission[1] != 0.0 or at.emission[2] != 0.0:
        _put(kept, _GLOW, thread, at.emission, 0.0)
        flags = GLOWS
    if at.mirror > 0.0:
        _put(kept, _TINT, thread, at.tint, 0.0)
    return flags


@wp.func
def keep_ruffle(kept: wp.array2d(dtype=wp.vec4), thread: wp.int32, ruffle: wp.vec3) -> wp.int32:
    """Write what a thread's material adds to the normal; the flag of it if it adds anything."""
    if ruffle[0] == 0.0 and ruffle[1] == 0.0 and ruffle[2] == 0.0:
        return 0
    _put(kept, _NORMAL, thread, ruffle, 0.0)
    return BENT


@wp.func
def kept_albedo(kept: wp.array2d(dtype=wp.vec4), thread: wp.int32) -> wp.vec4:
    """Albedo and reflectance of the mirror part that were written for a thread."""
    return _get(kept, _LIGHT, thread)


@wp.func
def with_kept_look(
    s: SurfacePoint,
    kept: wp.array2d(dtype=wp.vec4),
    thread: wp.int32,
    flags: wp.int32,
    mirror: wp.float32,
    flat: wp.vec3,
    light: SlotLight,
) -> SurfacePoint:
    """``s``, a surface of the kept albedo, with the rest of what was written; unchanged where
    nothing was.

    Args:
        s: with the colour of :func:`kept_albedo`.
        kept: that of all threads.
        thread: of the pixel.
        flags: of the pixel.
        mirror: reflectance as of :func:`kept_albedo`; 0 where the face has no details.
        flat: normal of the face.
        light: of the slot.
    """
    if (flags & BENT) != 0:
        ruffle = _get(kept, _NORMAL, thread)
        s.ruffle = wp.vec3(ruffle[0], ruffle[1], ruffle[2])
    if (flags & GLOWS) != 0:
        emission = _get(kept, _GLOW, thread)
        s.emission = s.emission + wp.vec3(emission[0], emission[1], emission[2])
    if mirror > 0.0:
        tint = _get(kept, _TINT, thread)
        s.mirror = mirror * (1.0 - snow_share(flat, light))
        s.tint = wp.vec3(tint[0], tint[1], tint[2])
    return s
