"""Quotients, roots and unit vectors in float32 for kernels that compute them for every pixel.

A GPU's division and square root are right for all operands, by a subroutine for the rare ones. That
costs registers and a branch at every place, and was a third of a picture's shading. These functions
have the steps of the usual case alone, which give the nearest float (Markstein, "Computation of
elementary functions on the IBM RISC System/6000 processor", 1990): the same bits as on a CPU, where
they are its division and its root.

They hold where operands and results are zero or between 1e-30 and 1e30 in size and nothing is
divided by zero; what comes of anything else differs between devices.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable import coefficients as c

QUICK = """
    #if defined(__CUDA_ARCH__)
    auto one_over = [](float b) -> float {
        float r;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(b));
        return fmaf(fmaf(-b, r, 1.0f), r, r);
    };
    auto a_over_b = [one_over](float a, float b) -> float {
        const float r = one_over(b);
        float q = a * r;
        q = fmaf(fmaf(-b, q, a), r, q);
        return fmaf(fmaf(-b, q, a), r, q);
    };
    auto square_root = [](float x) -> float {
        float r;
        asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
        const float y = x * r;
        const float nearest = fmaf(fmaf(-y, y, x), 0.5f * r, y);
        return x < 1.0e-30f ? 0.0f : nearest;
    };
    #else
    auto one_over = [](float b) -> float { return 1.0f / b; };
    auto a_over_b = [](float a, float b) -> float { return a / b; };
    auto square_root = [](float x) -> float { return x < 1.0e-30f ? 0.0f : __builtin_sqrtf(x); };
    #endif
"""
"""Definitions for native code."""


@wp.func_native(f"{QUICK} return one_over(b);")
def reciprocal(b: wp.float32) -> wp.float32:
    """The float that is nearest to ``1 / b``."""


@wp.func_native(f"{QUICK} return a_over_b(a, b);")
def quotient(a: wp.float32, b: wp.float32) -> wp.float32:
    """The float that is nearest to ``a / b``."""


@wp.func_native(f"{QUICK} return square_root(x);")
def root(x: wp.float32) -> wp.float32:
    """The float that is nearest to the square root; 0.0 below 1e-30, negative numbers too."""


@wp.func_native(
    f"""{QUICK}
    const float square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    const float share = square < 1.0e-30f ? 0.0f : one_over(square_root(square));
    return wp::vec3(v[0] * share, v[1] * share, v[2] * share);
    """
)
def unit(v: wp.vec3) -> wp.vec3:
    """``v`` over its length; zero if that is below 1e-15."""


# Fused by name: kernels are compiled without fusing on their own.
FUSED = """
    #if defined(__CUDA_ARCH__)
    auto fused = [](float a, float b, float c) -> float { return fmaf(a, b, c); };
    #else
    auto fused = [](float a, float b, float c) -> float { return __builtin_fmaf(a, b, c); };
    #endif
"""
"""Definition for native code: ``a b + c``, rounded once."""


_FADED = 80.0
"""``e**-80`` is 1.8e-35: darker than anything that is shown."""


@wp.func_native(
    f"""{FUSED}
    const float x = exponent < {_FADED}f ? exponent : {_FADED}f;
    // The sum's lowest bits are the whole number next to x / ln 2, negative.
    const float sum = fused(x, {-c.ONE_OVER_LN2!r}f, 12582912.0f);
    const float k = sum - 12582912.0f;
    const float r = fused(k, {-c.LN2_SHORT_1!r}f, fused(k, {-c.LN2_SHORT_0!r}f, -x));
    float s = {c.EXP_SHORT_5!r}f;
    s = fused(s, r, {c.EXP_SHORT_4!r}f);
    s = fused(s, r, {c.EXP_SHORT_3!r}f);
    s = fused(s, r, {c.EXP_SHORT_2!r}f);
    s = fused(s, r, {c.EXP_SHORT_1!r}f);
    s = fused(s, r, {c.EXP_SHORT_0!r}f);
    const float grown = fused(r * r, s, r) + 1.0f;
    #if defined(__CUDA_ARCH__)
    return grown * __int_as_float((__float_as_int(sum) + 127) << 23);
    #else
    return grown * __builtin_bit_cast(float, (__builtin_bit_cast(int, sum) + 127) << 23);
    #endif
    """
)
def decay(exponent: wp.float32) -> wp.float32:
    """``e**-exponent`` of a number that is not negative, with at most 1.2 units in the last place
    of error; beyond 80 as at 80."""


@wp.func_native(f"{FUSED} return fused(a[2], b[2], fused(a[1], b[1], a[0] * b[0]));")
def dot(a: wp.vec3, b: wp.vec3) -> wp.float32:
    """Scalar product, of fused sums."""


@wp.func_native(f"{FUSED} return fused(share, b, fused(-share, a, a));")
def between(a: wp.float32, b: wp.float32, share: wp.float32) -> wp.float32:
    """The ``share`` of the way from ``a`` to ``b``."""


@wp.func_native(
    f"""{FUSED}
    return wp::vec3(fused(direction[0], distance, start[0]),
        fused(direction[1], distance, start[1]), fused(direction[2], distance, start[2]));
    """
)
def ahead_of(start: wp.vec3, direction: wp.vec3, distance: wp.float32) -> wp.vec3:
    """``start`` and ``distance`` times ``direction``."""


@wp.func_native(
    f"""{FUSED}
    auto sum = [&](int k) -> float {{
        return fused(z[k], v[2], fused(y[k], v[1], x[k] * v[0]));
    }};
    return wp::vec3(sum(0), sum(1), sum(2));
    """
)
def of_axes(v: wp.vec3, x: wp.vec3, y: wp.vec3, z: wp.vec3) -> wp.vec3:
    """``v[0] x + v[1] y + v[2] z``."""
