"""Rays to the sun from sixteen neighbouring pixels at once, for the CPU.

All of them go the same way, so most nodes of a hierarchy are met or passed by bounds that hold for
the whole packet. A ray is asked about a leaf if it enters its box, by the test of
:mod:`twin.render.trace.eight`. A box within another is never entered earlier or left later, and
products and sums are rounded in the order of what is rounded: so the faces that a ray is asked
about are those that it would be asked about alone, and the answer is that of
:func:`twin.render.trace.traverse.blocked` to the last bit.
"""

from __future__ import annotations

import warp as wp

from twin.render.trace.eight import FUSED8, LESSER
from twin.render.trace.geometry import RayScene

LANES = 16
"""Rays of a packet."""
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)
"""A number of each ray of a packet."""

_TYPES = f"""
    {FUSED8}
    {LESSER}
    typedef float F __attribute__((ext_vector_type({LANES})));
    typedef int I __attribute__((ext_vector_type({LANES})));
    typedef bool B __attribute__((ext_vector_type({LANES})));
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef int i8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));  // arrays may begin anywhere
    #define FUSED16(a, b, c) __builtin_elementwise_fma((F)(a), (F)(b), (F)(c))
    #define BITS16(i) __builtin_bit_cast(unsigned short, __builtin_convertvector(i, B))
    const F zero = 0.0f;
"""

# One ray, eight faces: the text of `eight`. `base` are the words of the leaf.
_ONE = """
    auto one_blocked = [&](const float* base, float ox, float oy, float oz,
                           float dx, float dy, float dz) -> bool {
        const u8* c = (const u8*)base;
        const f8 px = c[0] - ox, py = c[1] - oy, pz = c[2] - oz;
        const f8 qx = c[3] - ox, qy = c[4] - oy, qz = c[5] - oz;
        const f8 sx = c[6] - ox, sy = c[7] - oy, sz = c[8] - oz;
        const f8 ex = sx - px, ey = sy - py, ez = sz - pz;
        const f8 gx = px - qx, gy = py - qy, gz = pz - qz;
        const f8 hx = qx - sx, hy = qy - sy, hz = qz - sz;
        const f8 ax = sx + px, ay = sy + py, az = sz + pz;
        const f8 bx = px + qx, by = py + qy, bz = pz + qz;
        const f8 kx = qx + sx, ky = qy + sy, kz = qz + sz;
        const f8 U = TWIN_DOT(TWIN_LESS(ey, az, ez, ay), dx,
            TWIN_LESS(ez, ax, ex, az), dy, TWIN_LESS(ex, ay, ey, ax), dz);
        const f8 V = TWIN_DOT(TWIN_LESS(gy, bz, gz, by), dx,
            TWIN_LESS(gz, bx, gx, bz), dy, TWIN_LESS(gx, by, gy, bx), dz);
        const f8 W = TWIN_DOT(TWIN_LESS(hy, kz, hz, ky), dx,
            TWIN_LESS(hz, kx, hx, kz), dy, TWIN_LESS(hx, ky, hy, kx), dz);
        const f8 least = lesser(U, lesser(V, W)), most = greater(U, greater(V, W));
        const f8 mx = TWIN_LESS(ey, gz, ez, gy), my = TWIN_LESS(ez, gx, ex, gz);
        const f8 mz = TWIN_LESS(ex, gy, ey, gx);
        const f8 slope = TWIN_SUM(mx, dx, my, dy, mz, dz);
        const f8 t = TWIN_SUM(px, mx, py, my, pz, mz) / slope;
        const f8 sum = U + V + W;
        const i8 meets = ((least >= 0.0f) | (most <= 0.0f)) & (sum != 0.0f) & (t >= 0.0f)
            & (t <= far);
        return __builtin_bit_cast(unsigned char, __builtin_convertvector(meets, b8)) != 0;
    };
"""

_WALK = """
    // Lanes of `lanes` that anything below `root` blocks.
    auto walk = [&](int root, F ox, F oy, F oz, float dx, float dy, float dz,
                    unsigned lanes) -> unsigned {
        const float tiny = 1.0e-20f, slack = 1.00390625f;  // as in twin.render.trace.traverse
        const float rx = 1.0f / (dx == 0.0f ? tiny : dx);
        const float ry = 1.0f / (dy == 0.0f ? tiny : dy);
        const float rz = 1.0f / (dz == 0.0f ? tiny : dz);
        const float limit = far * slack;
        const int nx = rx < 0.0f ? 3 : 0, ny = ry < 0.0f ? 4 : 1, nz = rz < 0.0f ? 5 : 2;
        const int fx = 3 - nx, fy = 5 - ny, fz = 7 - nz;
        // Who asks nothing stands where somebody else does, so that bounds stay narrow.
        const int some = __builtin_ctz(lanes);
        for (int i = 0; i < 16; ++i)
            if (!(lanes >> i & 1u)) {
                ox[i] = ox[some];
                oy[i] = oy[some];
                oz[i] = oz[some];
            }
        const F MX = -ox * rx, MY = -oy * ry, MZ = -oz * rz;
        const f8 RX = rx, RY = ry, RZ = rz;
        const f8 x0 = __builtin_reduce_min(MX), x1 = __builtin_reduce_max(MX);
        const f8 y0 = __builtin_reduce_min(MY), y1 = __builtin_reduce_max(MY);
        const f8 z0 = __builtin_reduce_min(MZ), z1 = __builtin_reduce_max(MZ);
        const f8 zero8 = 0.0f, limit8 = limit;
        unsigned blocked = 0;
        int stack[320];
        int top = 0, node = root;
        while (true) {
            const float* base = scene.nodes.data + (size_t)node * 56;
            const u8* box = (const u8*)base;
            const int* child = (const int*)(base + 48);
            const f8 near8 = greater(TWIN_FUSED(box[nx], RX, x0),
                greater(TWIN_FUSED(box[ny], RY, y0),
                    greater(TWIN_FUSED(box[nz], RZ, z0), zero8)));
            const f8 far8 = lesser(TWIN_FUSED(box[fx], RX, x1),
                lesser(TWIN_FUSED(box[fy], RY, y1), lesser(TWIN_FUSED(box[fz], RZ, z1), limit8)));
            unsigned mask = __builtin_bit_cast(
                unsigned char, __builtin_convertvector(near8 <= far8, b8));
            while (mask) {
                const int k = __builtin_ctz(mask);
                mask &= mask - 1;
                const int next = child[k];
                if (next >= 0) {
                    stack[top++] = next;
                    continue;
                }
                if (next == (int)0x80000000) break;  // no child any more
                const float* b = base + k;
                const F from = greater(FUSED16(b[8 * nx], rx, MX),
                    greater(FUSED16(b[8 * ny], ry, MY), greater(FUSED16(b[8 * nz], rz, MZ), zero)));
                const F to = lesser(FUSED16(b[8 * fx], rx, MX),
                    lesser(FUSED16(b[8 * fy], ry, MY),
                        lesser(FUSED16(b[8 * fz], rz, MZ), (F)limit)));
                unsigned in = BITS16((I)(from <= to)) & lanes & ~blocked;
                if (!in) continue;
                const float* leaf = scene.leaves.data + (size_t)(-1 - next) * 80;
                while (in) {
                    const int i = __builtin_ctz(in);
                    in &= in - 1;
                    if (one_blocked(leaf, ox[i], oy[i], oz[i], dx, dy, dz)) blocked |= 1u << i;
                }
                if (blocked == lanes) return blocked;
            }
            if (top == 0) return blocked;
            node = stack[--top];
        }
    };
"""

# The steps of `spheres_entered` and `into_object`, for all lanes at once.
_ASK = """
    F ox, oy, oz;
    for (int i = 0; i < 16; ++i) {
        ox[i] = x[i];
        oy[i] = y[i];
        oz[i] = z[i];
    }
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    unsigned left = (unsigned)asked;
    left &= ~walk(0, ox, oy, oz, dx, dy, dz, left);
    for (int block = 0; block < scene.spheres.shape[1]; ++block) {
        const float* ball = wp::address(scene.spheres, slot, block, 0);
        for (int k = 0; left && k < 8; ++k) {
            const float r = ball[24 + k];
            const F sx = ball[k] - ox, sy = ball[8 + k] - oy, sz = ball[16 + k] - oz;
            const F along = sx * dx + sy * dy + sz * dz;
            const F square = sx * sx + sy * sy + sz * sz - along * along;
            const I into = (I)(square <= r * r) & (I)(along + r > 0.0f) & (I)(along - r < far);
            const unsigned lanes = BITS16(into) & left;
            if (!lanes) continue;
            const auto* thing = wp::address(scene.objects, slot, 8 * block + k);
            const float c = thing->cosine, s = thing->sine;
            const wp::vec4 tilt = thing->tilt;
            const bool tilted = tilt[0] != 0.0f || tilt[2] != 0.0f;
            auto turn = [&](auto& a, auto& b, auto& e) {
                const auto own = c * a + s * b, side = c * b - s * a;
                a = own;
                b = side;
                if (tilted) {
                    a = tilt[1] * own - tilt[0] * e;
                    const auto up = tilt[0] * own + tilt[1] * e;
                    b = tilt[3] * side + tilt[2] * up;
                    e = tilt[3] * up - tilt[2] * side;
                }
            };
            F ex = ox - thing->position[0], ey = oy - thing->position[1];
            F ez = oz - thing->position[2];
            float ux = dx, uy = dy, uz = dz;
            turn(ex, ey, ez);
            turn(ux, uy, uz);
            left &= ~walk(thing->root, ex, ey, ez, ux, uy, uz, lanes);
        }
    }
    return (int)left;
"""

_CODE = _TYPES + _ONE + _WALK + _ASK


@wp.func_native(f"#if !defined(__CUDA_ARCH__)\n{_CODE}\n#else\nreturn 0;\n#endif\n")
def unblocked(
    scene: RayScene,
    slot: wp.int32,
    x: Lanes,
    y: Lanes,
    z: Lanes,
    asked: wp.int32,
    direction: wp.vec3,
    far: wp.float32,
) -> wp.int32:
    """Bits of the rays of ``asked``, which is not 0, that meet nothing from ``x``, ``y``, ``z``
    [m] along ``direction`` within ``far`` [m]."""
