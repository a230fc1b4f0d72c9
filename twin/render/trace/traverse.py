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

from twin.render.trace.cutouts import HOLE, Cutouts

# A GPU's exact division is a subroutine that costs a third of the registers. Boxes may be met with
# a quick one. What a hit follows from is divided by hand: with a reciprocal of the full precision,
# a quotient that is mended by its remainder is the nearest float (Markstein, "Computation of
# elementary functions on the IBM RISC System/6000 processor", 1990) unless something overflows or
# is subnormal on the way, which areas and distances of a world are not.
DIVISION = """
    #if defined(__CUDA_ARCH__)
    #define TWIN_QUICK(a, b) __fdividef(a, b)
    auto divided = [](float a, float b) -> float {
        float r;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(b));
        r = fmaf(fmaf(-b, r, 1.0f), r, r);
        float q = a * r;
        q = fmaf(fmaf(-b, q, a), r, q);
        return fmaf(fmaf(-b, q, a), r, q);
    };
    #define TWIN_DIV(a, b) divided(a, b)
    #else
    #define TWIN_QUICK(a, b) ((a) / (b))
    #define TWIN_DIV(a, b) ((a) / (b))
    #endif
"""
_RAY = f"""
    {DIVISION}
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    const float tiny = 1.0e-20f;
    const float rx = TWIN_QUICK(1.0f, (dx == 0.0f ? tiny : dx));
    const float ry = TWIN_QUICK(1.0f, (dy == 0.0f ? tiny : dy));
    const float rz = TWIN_QUICK(1.0f, (dz == 0.0f ? tiny : dz));
    // Planes are met at b / d - o / d, one operation each; hierarchies are padded for its rounding.
    const float mx0 = -ox * rx, my0 = -oy * ry, mz0 = -oz * rz;
    int node = root;
    int top = 0;
    // Boxes are entered a little beyond the nearest hit: the distance of a face that is met at a
    // grazing angle is rounded more coarsely than that of its box.
    const float slack = 1.00390625f;
"""

# ---- eight at once, CPU --------------------------------------------------------------------------

_VECTORS = """
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef int i8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    const int nx = rx < 0.0f ? 3 : 0, ny = ry < 0.0f ? 4 : 1, nz = rz < 0.0f ? 5 : 2;
    const int fx = 3 - nx, fy = 5 - ny, fz = 7 - nz;
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));  // arrays may begin anywhere
    const f8 RX = rx, RY = ry, RZ = rz, MX = mx0, MY = my0, MZ = mz0;
    int stack[320];
"""

_CHILDREN8 = """
            const float* base = nodes.data + (size_t)node * 56;
            const u8* box = (const u8*)base;
            const f8 ax = __builtin_elementwise_fma((f8)box[nx], RX, MX);
            const f8 bx = __builtin_elementwise_fma((f8)box[fx], RX, MX);
            const f8 ay = __builtin_elementwise_fma((f8)box[ny], RY, MY);
            const f8 by = __builtin_elementwise_fma((f8)box[fy], RY, MY);
            const f8 az = __builtin_elementwise_fma((f8)box[nz], RZ, MZ);
            const f8 bz = __builtin_elementwise_fma((f8)box[fz], RZ, MZ);
            const f8 zero = 0.0f;
            const f8 limit = far * slack;
            const f8 near8 = __builtin_elementwise_max(
                __builtin_elementwise_max(ax, ay), __builtin_elementwise_max(az, zero));
            const f8 far8 = __builtin_elementwise_min(__builtin_elementwise_min(
                __builtin_elementwise_min(bx, by), bz), limit);
            const b8 into = __builtin_convertvector(near8 <= far8, b8);
            unsigned mask = __builtin_bit_cast(unsigned char, into);
            const int* child = (const int*)(base + 48);
"""

_LEAF8 = """
            const u8* c = (const u8*)(leaves.data + (size_t)(-1 - node) * 80);
            const f8 px = c[0] - ox, py = c[1] - oy, pz = c[2] - oz;
            const f8 qx = c[3] - ox, qy = c[4] - oy, qz = c[5] - oz;
            const f8 sx = c[6] - ox, sy = c[7] - oy, sz = c[8] - oz;
            const f8 ex = sx - px, ey = sy - py, ez = sz - pz;
            const f8 gx = px - qx, gy = py - qy, gz = pz - qz;
            const f8 hx = qx - sx, hy = qy - sy, hz = qz - sz;
            const f8 ax = sx + px, ay = sy + py, az = sz + pz;
            const f8 bx = px + qx, by = py + qy, bz = pz + qz;
            const f8 kx = qx + sx, ky = qy + sy, kz = qz + sz;
            const f8 U = (ey * az - ez * ay) * dx + (ez * ax - ex * az) * dy
                + (ex * ay - ey * ax) * dz;
            const f8 V = (gy * bz - gz * by) * dx + (gz * bx - gx * bz) * dy
                + (gx * by - gy * bx) * dz;
            const f8 W = (hy * kz - hz * ky) * dx + (hz * kx - hx * kz) * dy
                + (hx * ky - hy * kx) * dz;
            const f8 least = __builtin_elementwise_min(U, __builtin_elementwise_min(V, W));
            const f8 most = __builtin_elementwise_max(U, __builtin_elementwise_max(V, W));
            const f8 mx = ey * gz - ez * gy, my = ez * gx - ex * gz, mz = ex * gy - ey * gx;
            const f8 slope = mx * dx + my * dy + mz * dz;
            const f8 t = (px * mx + py * my + pz * mz) / slope;
            const f8 sum = U + V + W;
            const i8 meets = ((least >= 0.0f) | (most <= 0.0f)) & (sum != 0.0f) & (t >= near)
                & (t <= far);
            const b8 found = __builtin_convertvector(meets, b8);
            unsigned mask = __builtin_bit_cast(unsigned char, found);
"""

# Children that are met go on the stack farthest first.
_CLOSEST8 = f"""
    {_VECTORS}
    float entry[320];
    float best_u = 0.0f, best_v = 0.0f;
    int best = -1;
    while (true) {{
        if (node >= 0) {{
            {_CHILDREN8}
            if (mask) {{
                int first = __builtin_ctz(mask);
                mask &= mask - 1;
                int nearest = child[first];
                float t0 = near8[first];
                const int bottom = top;
                while (mask) {{
                    const int k = __builtin_ctz(mask);
                    mask &= mask - 1;
                    float tk = near8[k];
                    int other = child[k];
                    if (tk < t0) {{
                        const float swap_t = t0; t0 = tk; tk = swap_t;
                        const int swap = nearest; nearest = other; other = swap;
                    }}
                    int at = top++;
                    while (at > bottom && entry[at - 1] < tk) {{
                        entry[at] = entry[at - 1];
                        stack[at] = stack[at - 1];
                        --at;
                    }}
                    entry[at] = tk;
                    stack[at] = other;
                }}
                node = nearest;
                continue;
            }}
        }} else {{
            {_LEAF8}
            while (mask) {{
                const int k = __builtin_ctz(mask);
                mask &= mask - 1;
                const int face = ((const int*)(c + 9))[k];
                if (t[k] < far || (t[k] == far && face < best)) {{
                    const float share = 1.0f / sum[k];
                    const float u = W[k] * share, v = U[k] * share;
                    // SKIP8
                    far = t[k];
                    best_u = u;
                    best_v = v;
                    best = face;
                }}
            }}
        }}
        do {{
            if (top == 0) return wp::vec4(far, best_u, best_v, __builtin_bit_cast(float, best));
            node = stack[--top];
        }} while (entry[top] > far * slack);
    }}
"""

_BLOCKED8 = f"""
    {_VECTORS}
    while (true) {{
        if (node >= 0) {{
            {_CHILDREN8}
            while (mask) {{
                const int k = __builtin_ctz(mask);
                mask &= mask - 1;
                stack[top++] = child[k];
            }}
        }} else {{
            {_LEAF8}
            // EACH8
            if (mask) return true;
        }}
        if (top == 0) return false;
        node = stack[--top];
    }}
"""

# ---- one ray, nodes of four, GPU -----------------------------------------------------------------

_SCALARS = """
    #if defined(__CUDA_ARCH__)
    #define TWIN_MIN(a, b) fminf(a, b)
    #define TWIN_MAX(a, b) fmaxf(a, b)
    #define TWIN_FMA(a, b, c) fmaf(a, b, c)
    #define TWIN_LOAD(p) __ldg((const float4*)(p))
    typedef float4 v4;
    #define TWIN_BITS(f) __float_as_int(f)
    #define TWIN_FLOAT(i) __int_as_float(i)
    #else
    struct f4 { float x, y, z, w; };
    #define TWIN_MIN(a, b) ((a) < (b) ? (a) : (b))
    #define TWIN_MAX(a, b) ((a) > (b) ? (a) : (b))
    #define TWIN_FMA(a, b, c) __builtin_fmaf(a, b, c)
    #define TWIN_LOAD(p) (*(const f4*)(p))
    typedef f4 v4;
    #define TWIN_BITS(f) __builtin_bit_cast(int, f)
    #define TWIN_FLOAT(i) __builtin_bit_cast(float, i)
    #endif
    #define TWIN_LINK(key) ((unsigned)TWIN_BITS((key) & 2u ? ((key) & 1u ? child.w : child.z) \\
        : ((key) & 1u ? child.y : child.x)))
    const bool mirror_x = rx < 0.0f, mirror_y = ry < 0.0f, mirror_z = rz < 0.0f;
    unsigned long long stack[128];
"""

_CHILD4 = """
            {{
                const float near4 = TWIN_MAX(TWIN_MAX(TWIN_FMA(lx.{k}, rx, mx0),
                    TWIN_FMA(ly.{k}, ry, my0)), TWIN_MAX(TWIN_FMA(lz.{k}, rz, mz0), 0.0f));
                const float far4 = TWIN_MIN(TWIN_MIN(TWIN_FMA(hx.{k}, rx, mx0),
                    TWIN_FMA(hy.{k}, ry, my0)), TWIN_MIN(TWIN_FMA(hz.{k}, rz, mz0), limit));
                {use}
            }}
"""

_BOXES4 = """
            const float* base = nodes.data + (size_t)node * 28;
            const v4 lx = TWIN_LOAD(base + (mirror_x ? 12 : 0));
            const v4 ly = TWIN_LOAD(base + (mirror_y ? 16 : 4));
            const v4 lz = TWIN_LOAD(base + (mirror_z ? 20 : 8));
            const v4 hx = TWIN_LOAD(base + (mirror_x ? 0 : 12));
            const v4 hy = TWIN_LOAD(base + (mirror_y ? 4 : 16));
            const v4 hz = TWIN_LOAD(base + (mirror_z ? 8 : 20));
            const v4 child = TWIN_LOAD(base + 24);
            const float limit = far * slack;
"""

_CORNERS4 = """
                const float* corner = leaves.data + (size_t)face * 12;
                const v4 P = TWIN_LOAD(corner), Q = TWIN_LOAD(corner + 4);
                const v4 S = TWIN_LOAD(corner + 8);
"""
_VOLUMES4 = """
                const float px = P.x - ox, py = P.y - oy, pz = P.z - oz;
                const float qx = Q.x - ox, qy = Q.y - oy, qz = Q.z - oz;
                const float sx = S.x - ox, sy = S.y - oy, sz = S.z - oz;
                const float ex = sx - px, ey = sy - py, ez = sz - pz;
                const float gx = px - qx, gy = py - qy, gz = pz - qz;
                const float hx = qx - sx, hy = qy - sy, hz = qz - sz;
                const float ax = sx + px, ay = sy + py, az = sz + pz;
                const float bx = px + qx, by = py + qy, bz = pz + qz;
                const float kx = qx + sx, ky = qy + sy, kz = qz + sz;
                const float U = (ey * az - ez * ay) * dx + (ez * ax - ex * az) * dy
                    + (ex * ay - ey * ax) * dz;
                const float V = (gy * bz - gz * by) * dx + (gz * bx - gx * bz) * dy
                    + (gx * by - gy * bx) * dz;
                const float W = (hy * kz - hz * ky) * dx + (hz * kx - hx * kz) * dy
                    + (hx * ky - hy * kx) * dz;
"""
_DISTANCE4 = """
                    const float mx = ey * gz - ez * gy, my = ez * gx - ex * gz;
                    const float mz = ex * gy - ey * gx;
                    const float slope = mx * dx + my * dy + mz * dz;
                    const float t = TWIN_DIV(px * mx + py * my + pz * mz, slope);
"""
_FACE4 = f"""
                {_CORNERS4}
                {_VOLUMES4}
                const float least = TWIN_MIN(U, TWIN_MIN(V, W));
                const float most = TWIN_MAX(U, TWIN_MAX(V, W));
                if (least >= 0.0f || most <= 0.0f) {{
                    {_DISTANCE4}
                    const float sum = U + V + W;
                    if (sum != 0.0f && t >= near && NEARER4) {{
"""

# Of faces at one distance the one with the lowest number, however a hierarchy has them.
_NEARER4 = "(t < far || (t == far && TWIN_BITS(P.w) < best))"


def _keys() -> str:
    """Code that makes one sortable word per child: entry distance with the child's number in its
    lowest bits; all ones: missed."""
    text = "unsigned k0 = ~0u, k1 = ~0u, k2 = ~0u, k3 = ~0u;"
    for i, k in enumerate("xyzw"):
        use = f"if (near4 <= far4) k{i} = ((unsigned)TWIN_BITS(near4) & ~3u) | {i}u;"
        text += _CHILD4.format(k=k, use=use)
    return text


def _push(key: str) -> str:
    return f"if ({key} != ~0u) stack[top++] = ((unsigned long long){key} << 32) | TWIN_LINK({key});"


def _pushes() -> str:
    return "".join(
        _CHILD4.format(
            k=k, use=f"if (near4 <= far4) stack[top++] = (unsigned)TWIN_BITS(child.{k});"
        )
        for k in "xyzw"
    )


def _order(a: str, b: str) -> str:
    return f"{{ const unsigned s = {a} < {b} ? {a} : {b}; {b} = {a} < {b} ? {b} : {a}; {a} = s; }}"


_SORT4 = "\n".join(_order(f"k{a}", f"k{b}") for a, b in ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)))

_CLOSEST4 = f"""
    {_SCALARS}
    float best_u = 0.0f, best_v = 0.0f;
    int best = -1;
    while (true) {{
        if (node >= 0) {{
            {_BOXES4}
            {_keys()}
            {_SORT4}
            if (k0 != ~0u) {{
                {_push("k3")}
                {_push("k2")}
                {_push("k1")}
                node = (int)TWIN_LINK(k0);
                continue;
            }}
        }} else {{
            const int link = -1 - node;
            const int last = (link >> 4) + (link & 15);
            for (int face = link >> 4; face < last; ++face) {{
                {_FACE4.replace("NEARER4", _NEARER4)}
                        const float share = TWIN_DIV(1.0f, sum);
                        const float u = W * share, v = U * share;
                        // SKIP4
                        far = t;
                        best_u = u;
                        best_v = v;
                        best = TWIN_BITS(P.w);
                    }}
                }}
            }}
        }}
        unsigned long long next;
        do {{
            if (top == 0) return wp::vec4(far, best_u, best_v, TWIN_FLOAT(best));
            next = stack[--top];
        }} while (TWIN_FLOAT((int)(next >> 32)) > far * slack);
        node = (int)(unsigned)next;
    }}
"""

_BLOCKED4 = f"""
    {_SCALARS.replace("unsigned long long stack", "int stack")}
    while (true) {{
        if (node >= 0) {{
            {_BOXES4}
            {_pushes()}
        }} else {{
            const int link = -1 - node;
            const int last = (link >> 4) + (link & 15);
            for (int face = link >> 4; face < last; ++face) {{
                {_FACE4.replace("NEARER4", "t <= far")}
                        // SHARE4
                        // SKIP4
                        return true;
                    }}
                }}
            }}
        }}
        if (top == 0) return false;
        node = (int)stack[--top];
    }}
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
    "// SKIP4": "if (hole(first_face + TWIN_BITS(P.w), u, v)) continue;",
}


def _either(cuda: str, cpu: str) -> str:
    return f"{_RAY}\n#if defined(__CUDA_ARCH__)\n{cuda}\n#else\n{cpu}\n#endif\n"


def _with_holes(text: str) -> str:
    """A traversal that passes the holes of the faces that it meets."""
    for place, skip in _SKIPS.items():
        text = text.replace(place, skip)
    return HOLE + text


def closest_with(volumes: str, distance: str, *, holes: bool) -> str:
    """The code of a GPU with another test of a face, for every device.

    Args:
        volumes: defines ``U``, ``V``, ``W`` of the corners ``P``, ``Q``, ``S``.
        distance: defines ``t``.
        holes: the ray passes holes.
    """
    text = _RAY + _CLOSEST4.replace(_VOLUMES4, volumes).replace(_DISTANCE4, distance)
    return _with_holes(text) if holes else text


CLOSEST = _either(_CLOSEST4, _CLOSEST8)
BLOCKED = _either(_BLOCKED4, _BLOCKED8)
CLOSEST_THERE, BLOCKED_THERE = _with_holes(CLOSEST), _with_holes(BLOCKED)


@wp.func_native(f"{DIVISION} return TWIN_DIV(a, b);")
def divided(a: wp.float32, b: wp.float32) -> wp.float32:
    """The float that is nearest to ``a / b``, as hits are divided."""


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


@wp.func_native(_RAY + _CLOSEST4)
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


@wp.func_native(_RAY + _BLOCKED4)
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


@wp.func_native(_with_holes(_RAY + _CLOSEST4))
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


@wp.func_native(_with_holes(_RAY + _BLOCKED4))
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
        const float along = x * dx + y * dy + z * dz;
        const float square = x * x + y * y + z * z - along * along;
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
