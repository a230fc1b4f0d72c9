"""Native code of a ray on a GPU: nodes of four children, loaded as float4, and one face at a time.

The operations of a face are those of :mod:`twin.render.trace.eight`, in the same order.
"""

from __future__ import annotations

_SCALARS = """
    #if defined(__CUDA_ARCH__)
    #define TWIN_MIN(a, b) fminf(a, b)
    #define TWIN_MAX(a, b) fmaxf(a, b)
    #define TWIN_FMA(a, b, c) fmaf(a, b, c)
    // Of three numbers at once, by their bits: the greatest or 0, and the least or, where some are
    // below 0, any of those. Boxes need no more, and half the instructions do.
    #define TWIN_MAX3(a, b, c) __int_as_float(__vimax3_s32_relu( \\
        __float_as_int(a), __float_as_int(b), __float_as_int(c)))
    #define TWIN_MIN3(a, b, c) __int_as_float(__vimin3_s32( \\
        __float_as_int(a), __float_as_int(b), __float_as_int(c)))
    #define TWIN_LOAD(p) __ldg((const float4*)(p))
    typedef float4 v4;
    #define TWIN_BITS(f) __float_as_int(f)
    #define TWIN_FLOAT(i) __int_as_float(i)
    #else
    struct f4 { float x, y, z, w; };
    #define TWIN_MIN(a, b) ((a) < (b) ? (a) : (b))
    #define TWIN_MAX(a, b) ((a) > (b) ? (a) : (b))
    #define TWIN_FMA(a, b, c) __builtin_fmaf(a, b, c)
    #define TWIN_MAX3(a, b, c) TWIN_MAX(TWIN_MAX(a, b), TWIN_MAX(c, 0.0f))
    #define TWIN_MIN3(a, b, c) TWIN_MIN(TWIN_MIN(a, b), c)
    #define TWIN_LOAD(p) (*(const f4*)(p))
    typedef f4 v4;
    #define TWIN_BITS(f) __builtin_bit_cast(int, f)
    #define TWIN_FLOAT(i) __builtin_bit_cast(float, i)
    #endif
    // a b - c d, fused: the same bits on all devices, and with the opposite sign for the neighbour
    // across an edge. A sum of three products, fused, and as it stands: of a ray through a corner,
    // fused sums would say to more faces that it passes them by.
    #undef TWIN_LESS
    #undef TWIN_SUM
    #undef TWIN_DOT
    #define TWIN_LESS(a, b, c, d) TWIN_FMA(a, b, -((c) * (d)))
    #define TWIN_SUM(a, b, c, d, e, f) TWIN_FMA(a, b, TWIN_FMA(c, d, (e) * (f)))
    #define TWIN_DOT(a, b, c, d, e, f) ((a) * (b) + (c) * (d) + (e) * (f))
    #define TWIN_LINK(key) ((unsigned)TWIN_BITS((key) & 2u ? ((key) & 1u ? child.w : child.z) \\
        : ((key) & 1u ? child.y : child.x)))
    // Bytes from a node to the planes that the ray meets first. Sums of 32 bits, because a compiler
    // takes those of 64 apart and multiplies once per plane.
    const unsigned x_near = rx < 0.0f ? 48u : 0u, y_near = ry < 0.0f ? 64u : 16u;
    const unsigned z_near = rz < 0.0f ? 80u : 32u;
    unsigned long long stack[128];
"""

_CHILD4 = """
            {{
                const float near4 = TWIN_MAX3(TWIN_FMA(lx.{k}, rx, mx0),
                    TWIN_FMA(ly.{k}, ry, my0), TWIN_FMA(lz.{k}, rz, mz0));
                const float far4 = TWIN_MIN(TWIN_MIN3(TWIN_FMA(hx.{k}, rx, mx0),
                    TWIN_FMA(hy.{k}, ry, my0), TWIN_FMA(hz.{k}, rz, mz0)), limit);
                {use}
            }}
"""

_BOXES4 = """
            const char* words = (const char*)nodes.data;
            const unsigned place = (unsigned)node * 112u;
            const v4 lx = TWIN_LOAD(words + (place + x_near));
            const v4 ly = TWIN_LOAD(words + (place + y_near));
            const v4 lz = TWIN_LOAD(words + (place + z_near));
            const v4 hx = TWIN_LOAD(words + (place + 48u - x_near));
            const v4 hy = TWIN_LOAD(words + (place + 80u - y_near));
            const v4 hz = TWIN_LOAD(words + (place + 112u - z_near));
            const v4 child = TWIN_LOAD(words + (place + 96u));
"""

_CORNERS4 = """
                const float* corner = leaves.data + (size_t)face * 12;
                const v4 P = TWIN_LOAD(corner), Q = TWIN_LOAD(corner + 4);
                const v4 S = TWIN_LOAD(corner + 8);
"""
VOLUMES4 = """
                const float px = P.x - ox, py = P.y - oy, pz = P.z - oz;
                const float qx = Q.x - ox, qy = Q.y - oy, qz = Q.z - oz;
                const float sx = S.x - ox, sy = S.y - oy, sz = S.z - oz;
                const float ex = sx - px, ey = sy - py, ez = sz - pz;
                const float gx = px - qx, gy = py - qy, gz = pz - qz;
                const float hx = qx - sx, hy = qy - sy, hz = qz - sz;
                const float ax = sx + px, ay = sy + py, az = sz + pz;
                const float bx = px + qx, by = py + qy, bz = pz + qz;
                const float kx = qx + sx, ky = qy + sy, kz = qz + sz;
                const float U = TWIN_DOT(TWIN_LESS(ey, az, ez, ay), dx,
                    TWIN_LESS(ez, ax, ex, az), dy, TWIN_LESS(ex, ay, ey, ax), dz);
                const float V = TWIN_DOT(TWIN_LESS(gy, bz, gz, by), dx,
                    TWIN_LESS(gz, bx, gx, bz), dy, TWIN_LESS(gx, by, gy, bx), dz);
                const float W = TWIN_DOT(TWIN_LESS(hy, kz, hz, ky), dx,
                    TWIN_LESS(hz, kx, hx, kz), dy, TWIN_LESS(hx, ky, hy, kx), dz);
"""
DISTANCE4 = """
                    const float mx = TWIN_LESS(ey, gz, ez, gy), my = TWIN_LESS(ez, gx, ex, gz);
                    const float mz = TWIN_LESS(ex, gy, ey, gx);
                    const float slope = TWIN_SUM(mx, dx, my, dy, mz, dz);
                    const float t = TWIN_DIV(TWIN_SUM(px, mx, py, my, pz, mz), slope);
"""
_FACE4 = f"""
                {_CORNERS4}
                {VOLUMES4}
                const float least = TWIN_MIN(U, TWIN_MIN(V, W));
                const float most = TWIN_MAX(U, TWIN_MAX(V, W));
                if (least >= 0.0f || most <= 0.0f) {{
                    {DISTANCE4}
                    const float sum = U + V + W;
                    if (sum != 0.0f && t >= near && NEARER4) {{
"""

KEPT4 = "best_u = u; best_v = v;"
"""What is kept of a face that is nearer, beside its distance and number."""

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

CLOSEST4 = f"""
    {_SCALARS}
    float best_u = 0.0f, best_v = 0.0f, limit = far * slack;
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
                        limit = t * slack;
                        {KEPT4}
                        best = TWIN_BITS(P.w);
                    }}
                }}
            }}
        }}
        unsigned long long next;
        do {{
            if (top == 0) return wp::vec4(far, best_u, best_v, TWIN_FLOAT(best));
            next = stack[--top];
        }} while (TWIN_FLOAT((int)(next >> 32)) > limit);
        node = (int)(unsigned)next;
    }}
"""

BLOCKED4 = f"""
    {_SCALARS.replace("unsigned long long stack", "int stack")}
    const float limit = far * slack;
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
