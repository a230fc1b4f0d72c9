"""Rays whose hits have the same bits on CPU and GPU.

The traversals of :mod:`twin.render.trace.traverse` divide quickly on a GPU, off by two units in the
last place, and of faces at the same distance, as those of an edge that a ray meets, they take the
one that comes first in a device's hierarchy. These divide exactly and take the face with the lowest
number, for sensors whose bytes are the same on every device; kernels that call them have to say
``fuse_fp=False``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from twin.render.build import Features
from twin.render.trace import traverse
from twin.render.trace.cutouts import Cutouts
from twin.render.trace.geometry import ray_functions

_QUICK = "__fdividef(a, b)"
_FIRST = {
    "& (t < far);": "& (t <= far);",
    "if (t[k] < far) {": """
                if (t[k] < far || (t[k] == far && ((const int*)(c + 9))[k] < best)) {""",
    "&& t >= 0.0f && t < far) {": """
                        && t >= 0.0f && (t < far || (t == far && TWIN_BITS(P.w) < best))) {""",
}
"""Where the closest hit is chosen, on a CPU and on a GPU, and what is said there instead."""


def exact(text: str) -> str:
    """A traversal's code with exact divisions."""
    assert _QUICK in text
    return text.replace(_QUICK, "__fdiv_rn(a, b)")


def exact_closest(text: str) -> str:
    """Code that finds the closest hit, as :func:`exact`; faces at one distance go by number."""
    for first, lowest in _FIRST.items():
        text = text.replace(first, lowest)
    return exact(text)


@wp.func_native(exact_closest(traverse.CLOSEST))
def closest_exact(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.vec4:
    """Closest hit as of :func:`twin.render.trace.traverse.closest`."""


@wp.func_native(exact(traverse.BLOCKED))
def blocked_exact(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.bool:
    """Answer of :func:`twin.render.trace.traverse.blocked`."""


@wp.func_native(exact_closest(traverse.CLOSEST_THERE))
def closest_there_exact(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.vec4:
    """Closest hit as of :func:`twin.render.trace.traverse.closest_there`."""


@wp.func_native(exact(traverse.BLOCKED_THERE))
def blocked_there_exact(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.bool:
    """Answer of :func:`twin.render.trace.traverse.blocked_there`."""


@cache
def exact_rays_of(features: Features) -> tuple[Any, Any]:
    """``trace`` and ``occluded`` as of :func:`twin.render.trace.geometry.rays_of`."""
    if not features.holes:
        return ray_functions(closest_exact, blocked_exact)
    return ray_functions(closest_there_exact, blocked_there_exact, holes=True)
