"""Rays through the wide hierarchies of :mod:`twin.render.trace.bvh`, in native code.

A CPU meets all eight children of a node, or all eight triangles of a leaf, with one vector
instruction; a GPU has one ray per thread and nodes of four children, loaded as float4. Edges
are tested with Pluecker coordinates relative to the ray (see Woop, Benthin, Wald 2013): two
faces get the same number with opposite sign for their common edge, so no ray slips between them.

A hit has the same bits on every device: whether a face is met, where and how far away follow from
the ray and the face alone, by the same operations in the same order; of all faces that are met the
nearest counts, of equally near ones that with the lowest number. Hierarchies only choose which
faces are asked. Kernels that call these functions have to say ``fuse_fp=False``.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import QUICK
from twin.render.trace.cutouts import HOLE, Cutouts
from twin.render.trace.eight import BLOCKED8, CLOSEST8
from twin.render.trace.four import BLOCKED4, CLOSEST4, DISTANCE4, KEPT4, VOLUMES4

# Boxes may be met with a rough reciprocal, of normal numbers alone: with others in mind a GPU takes
# eight registers more. What a hit follows from has the bits of an exact division.
DIVISION = f"""
    {QUICK}
    #if defined(__CUDA_ARCH__)
    auto rough = [](float b) -> float {{
        float r;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(b));
        return r;
    }};
    #define TWIN_DIV(a, b) a_over_b(a, b)
    #else
    auto rough = [](float b) -> float {{ return 1.0f / b; }};
    #define TWIN_DIV(a, b) ((a) / (b))
    #endif
"""
_RAY = f"""
    {DIVISION}
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    const float tiny = 1.0e-20f;
    const float rx = rough(dx < tiny && dx > -tiny ? tiny : dx);
    const float ry = rough(dy < tiny && dy > -tiny ? tiny : dy);
    const float rz = rough(dz < tiny && dz > -tiny ? tiny : dz);
    // Planes are met at b / d - o / d, one operation each; hierarchies are padded for its rounding.
    const float mx0 = -ox * rx, my0 = -oy * ry, mz0 = -oz * rz;
    int node = root;
    int top = 0;
    // Boxes are entered a little beyond the nearest hit: the distance of a face that is met at a
    // grazing angle is rounded more coarsely than that of its box.
    const float slack = 1.00390625f;
"""

_SKIPS = {
    "// SKIP8": "if (hole(first_face + face, u, v)) continue;",
    "// EACH8": """
            while (mask) {
                const int k = __builtin_ctz(mask);
                const float share = 1.0f / sum[k];
                const int row = first_face + ((const int*)(c + 9))[k];
                if (!hole(row, W[k] * share, U[k] * share)) return true;
                mask &= mask - 1;
            }""",
    "// SHARE4": """
                        const float share = TWIN_DIV(1.0f, sum);
                        const float u = W * share, v = U * share;""",
    # The second corner's word says whether the face has holes somewhere.
    "// SKIP4": "if (TWIN_BITS(Q.w) && hole(first_face + TWIN_BITS(P.w), u, v)) continue;",
}


def _either(cuda: str, cpu: str) -> str:
    return f"{_RAY}\n#if defined(__CUDA_ARCH__)\n{cuda}\n#else\n{cpu}\n#endif\n"


def _with_holes(text: str) -> str:
    """A traversal that passes the holes of the faces that it meets."""
    for place, skip in _SKIPS.items():
        text = text.replace(place, skip)
    return HOLE + text


def closest_with(volumes: str, distance: str, kept: str, *, holes: bool) -> str:
    """The code of a GPU with another test of a face, for every device.

    Args:
        volumes: defines ``U``, ``V``, ``W`` of the corners ``P``, ``Q``, ``S``.
        distance: defines ``t``.
        kept: sets ``best_u`` and ``best_v``, what is returned beside distance and face.
        holes: the ray passes holes.
    """
    text = _RAY + CLOSEST4.replace(VOLUMES4, volumes).replace(DISTANCE4, distance)
    text = text.replace(KEPT4, kept)
    return _with_holes(text) if holes else text


CLOSEST = _either(CLOSEST4, CLOSEST8)
BLOCKED = _either(BLOCKED4, BLOCKED8)
CLOSEST_THERE, BLOCKED_THERE = _with_holes(CLOSEST), _with_holes(BLOCKED)


@wp.func_native(CLOSEST)
def closest(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.vec4:
    """What a ray meets first from ``near`` to below ``far``: its distance, the barycentric weights
    of the first two corners, and the bits of the face; face -1 and ``far``: nothing."""


@wp.func_native(BLOCKED)
def blocked(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.bool:
    """Whether a ray meets anything from ``near`` to ``far``."""


@wp.func_native(_RAY + CLOSEST4)
def closest_scalar(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.vec4:
    """Closest hit as of :func:`closest`, by the code of a GPU on every device."""


@wp.func_native(_RAY + BLOCKED4)
def blocked_scalar(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    root: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.bool:
    """Answer of :func:`blocked`, by the code of a GPU on every device."""


@wp.func_native(CLOSEST_THERE)
def closest_there(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.vec4:
    """Closest hit as of :func:`closest` of faces with holes; ``first_face``: row of the hierarchy's
    first one in the tables, ``corners``: texture coordinates."""


@wp.func_native(BLOCKED_THERE)
def blocked_there(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.bool:
    """Answer of :func:`blocked` for faces with holes, arguments as of :func:`closest_there`."""


@wp.func_native(_with_holes(_RAY + CLOSEST4))
def closest_there_scalar(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.vec4:
    """Closest hit as of :func:`closest_there`, by the code of a GPU on every device."""


@wp.func_native(_with_holes(_RAY + BLOCKED4))
def blocked_there_scalar(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    root: wp.int32,
    first_face: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    near: wp.float32,
    far: wp.float32,
) -> wp.bool:
    """Answer of :func:`blocked_there`, by the code of a GPU on every device."""


_NEAR = """
    const float* base = spheres.data + ((size_t)slot * spheres.shape[1] + block) * 32;
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    #if defined(__CUDA_ARCH__)
    unsigned mask = 0;
    for (int k = 0; k < 8; ++k) {
        const float x = base[k] - ox, y = base[8 + k] - oy, z = base[16 + k] - oz;
        const float r = base[24 + k];
        // Fused, unlike on a CPU: spheres are wider than what is in them by more than that.
        const float along = fmaf(z, dz, fmaf(y, dy, x * dx));
        const float square = fmaf(-along, along, fmaf(z, z, fmaf(y, y, x * x)));
        if (square <= r * r && along + r > 0.0f && along - r < far) mask |= 1u << k;
    }
    return (int)mask;
    #else
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef int i8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));
    const u8* row = (const u8*)base;
    const f8 x = row[0] - ox, y = row[1] - oy, z = row[2] - oz, r = row[3];
    const f8 along = x * dx + y * dy + z * dz;
    const f8 square = x * x + y * y + z * z - along * along;
    const i8 into = (square <= r * r) & (along + r > 0.0f) & (along - r < far);
    return __builtin_bit_cast(unsigned char, __builtin_convertvector(into, b8));
    #endif
"""


@wp.func_native(_NEAR)
def spheres_entered(
    spheres: wp.array3d(dtype=wp.float32),
    slot: wp.int32,
    block: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.int32:
    """Bits of the eight spheres (x [8], y [8], z [8], radius [8]; below 0: none) of
    ``spheres[slot, block]`` that the ray enters within ``far``."""


_LOWEST = """
    #if defined(__CUDA_ARCH__)
    return __ffs(mask) - 1;
    #else
    return __builtin_ctz(mask);
    #endif
"""


@wp.func_native(_LOWEST)
def lowest_bit(mask: wp.int32) -> wp.int32:
    """Place of the lowest bit of ``mask``, which is not 0."""
