"""Native code of a ray on a CPU: eight children of a node, or eight faces of a leaf, at once.

The operations of a face are those of :mod:`twin.render.trace.four`, in the same order.
"""

from __future__ import annotations

FUSED8 = """
    // a b - c d, fused: the same bits on all devices, and with the opposite sign for the neighbour
    // across an edge. A sum of three products, fused, and as it stands: of a ray through a corner,
    // fused sums would say to more faces that it passes them by.
    #define TWIN_FUSED(a, b, c) __builtin_elementwise_fma((f8)(a), (f8)(b), (f8)(c))
    #undef TWIN_LESS
    #undef TWIN_SUM
    #undef TWIN_DOT
    #define TWIN_LESS(a, b, c, d) TWIN_FUSED(a, b, -((c) * (d)))
    #define TWIN_SUM(a, b, c, d, e, f) TWIN_FUSED(a, b, TWIN_FUSED(c, d, (f8)(e) * (f)))
    #define TWIN_DOT(a, b, c, d, e, f) ((a) * (b) + (c) * (d) + (e) * (f))
"""

LESSER = """
    // An instruction each; the built-in functions take three, for the sake of NaN. Where `a` is
    // NaN, these give `b`, as those do.
    auto lesser = [](auto a, auto b) { return a < b ? a : b; };
    auto greater = [](auto a, auto b) { return a > b ? a : b; };
"""
"""Definitions for native code: the lesser and the greater of two vectors, element by element."""

_VECTORS = f"""
    {FUSED8}
    {LESSER}
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
            const f8 near8 = greater(ax, greater(ay, greater(az, zero)));
            const f8 far8 = lesser(bx, lesser(by, lesser(bz, limit)));
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
            const i8 meets = ((least >= 0.0f) | (most <= 0.0f)) & (sum != 0.0f) & (t >= near)
                & (t <= far);
            const b8 found = __builtin_convertvector(meets, b8);
            unsigned mask = __builtin_bit_cast(unsigned char, found);
"""

# Children that are met go on the stack farthest first.
CLOSEST8 = f"""
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

BLOCKED8 = f"""
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
