"""Kernels of the steps that are no convolutions; one thread has ``run`` neighbouring levels of a
row: as few as there are on a GPU, all on a CPU."""

from __future__ import annotations

import warp as wp

from devkit.detector.resize import resized

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_POOL = """
    const int words = made.shape[3] / 4, rows = given.shape[1], columns = given.shape[2];
    const int above = y * stride - top > 0 ? y * stride - top : 0;
    const int below = y * stride - top + size < rows ? y * stride - top + size : rows;
    const int last = made.shape[2] * words;
#if defined(__CUDA_ARCH__)
    typedef int W;  // four levels
    W least = 0x80808080;
    #define TWIN_LARGER(a, b) __vmaxs4(a, b)
#else
    typedef signed char W __attribute__((vector_size(4), aligned(1)));
    W least = W{} - (signed char)127 - (signed char)1;
    #define TWIN_LARGER(a, b) __builtin_elementwise_max(a, b)
#endif
    const W* from = (const W*)given.data + (size_t)n * rows * columns * words;
    W* to = (W*)made.data + ((size_t)n * made.shape[1] + y) * last;
    for (int i = part * run; i < (part + 1) * run && i < last; ++i) {
        const int x = i / words, word = i % words;
        const int begin = x * stride - left > 0 ? x * stride - left : 0;
        const int end = x * stride - left + size < columns ? x * stride - left + size : columns;
        W best = least;
        for (int v = above; v < below; ++v)
            for (int u = begin; u < end; ++u)
                best = TWIN_LARGER(best, from[((size_t)v * columns + u) * words + word]);
        to[i] = best;
    }
    #undef TWIN_LARGER
"""

_SUM = """
    const signed char* one = (const signed char*)first.data;
    const signed char* two = (const signed char*)second.data;
    signed char* to = (signed char*)made.data;
    const size_t begin = (size_t)n * length + (size_t)part * run;
    const size_t end = (size_t)n * length
        + (length - part * run < run ? length : (part + 1) * run);
    const long long half = 1ll << (shift - 1), by_one = factors[0], by_two = factors[1];
    const int zero_one = zeros[0], zero_two = zeros[1];
    for (size_t i = begin; i < end; ++i) {
        long long level = (one[i] - zero_one) * by_one + (two[i] - zero_two) * by_two + half;
        level = (level >> shift) + zero;
        to[i] = (signed char)(level < -128 ? -128 : level > 127 ? 127 : level);
    }
"""


@wp.func_native(_POOL)
def _pool(
    n: wp.int32,
    y: wp.int32,
    part: wp.int32,
    run: wp.int32,
    size: wp.int32,
    stride: wp.int32,
    top: wp.int32,
    left: wp.int32,
    given: wp.array4d(dtype=wp.int8),
    made: wp.array4d(dtype=wp.int8),
): ...


@wp.func_native(_SUM)
def _sum(
    n: wp.int32,
    part: wp.int32,
    run: wp.int32,
    length: wp.int32,
    factors: wp.vec2l,
    zeros: wp.vec2i,
    shift: wp.int32,
    zero: wp.int32,
    first: wp.array2d(dtype=wp.int8),
    second: wp.array2d(dtype=wp.int8),
    made: wp.array2d(dtype=wp.int8),
): ...


@wp.kernel
def picture_kernel(
    # model
    across: wp.array2d(dtype=wp.int32),
    down: wp.array2d(dtype=wp.int32),
    bgr: wp.int32,
    # state in
    pictures: wp.array4d(dtype=wp.uint8),
    rows: wp.array(dtype=wp.int32),
    # out
    made: wp.array4d(dtype=wp.int8),
):
    """Pictures [S, H, W, 3], those of ``rows`` [N] -> levels [N, height, width, 4].

    ``across`` [3, width] and ``down`` [3, height] are :func:`devkit.detector.resize.taps`.
    """
    n, y, x = wp.tid()
    for channel in range(3):
        k = wp.where(bgr != 0, 2 - channel, channel)
        whole = resized(across, down, pictures, rows[n], y, x, k)
        made[n, y, x, channel] = wp.int8(whole - 128)


@wp.kernel
def pool_kernel(
    # model
    run: wp.int32,
    size: wp.int32,
    stride: wp.int32,
    top: wp.int32,
    left: wp.int32,
    # state in
    given: wp.array4d(dtype=wp.int8),
    # out
    made: wp.array4d(dtype=wp.int8),
):
    """The largest level of every window; ``run`` counts words of four levels."""
    n, y, part = wp.tid()
    _pool(n, y, part, run, size, stride, top, left, given, made)


@wp.kernel
def sum_kernel(
    # model
    run: wp.int32,
    factors: wp.vec2l,
    zeros: wp.vec2i,
    shift: wp.int32,
    zero: wp.int32,
    # state in
    first: wp.array2d(dtype=wp.int8),
    second: wp.array2d(dtype=wp.int8),
    # out
    made: wp.array2d(dtype=wp.int8),
):
    """Two maps, each [N, rows x columns x channels]."""
    n, part = wp.tid()
    _sum(n, part, run, made.shape[1], factors, zeros, shift, zero, first, second, made)


@wp.kernel
def join_kernel(
    # model
    run: wp.int32,
    table: wp.array(dtype=wp.int8),
    sources: wp.array(dtype=wp.int32),
    targets: wp.array(dtype=wp.int32),
    # state in
    given: wp.array2d(dtype=wp.int8),
    # out
    made: wp.array2d(dtype=wp.int8),
):
    """Levels from ``sources`` to ``targets``, places in the maps of an image, by ``table``."""
    n, part = wp.tid()
    for i in range(part * run, wp.min((part + 1) * run, sources.shape[0])):
        made[n, targets[i]] = table[wp.int32(given[n, sources[i]]) + 128]
