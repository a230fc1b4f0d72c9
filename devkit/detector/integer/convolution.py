"""The convolution of integer networks, as native code of one kernel.

A GPU's thread has one channel of :data:`PIXELS_GPU` neighbouring pixels and adds four products with
one instruction (``dp4a``). A CPU's thread has a band of rows, and multiplies sixteen channels of up
to twelve pixels in float32: a product of levels is at most 127 x 128, so float32 holds the sum of
1024 of them exactly, in any order and fused or not. Sums go into int32 before they are longer than
that, unless the kernels are so small that they cannot reach 2^24.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from devkit.detector.integer.shapes import (
    BAND_ROWS,
    LANES,
    LEVEL_MAX,
    PIXELS_CPU,
    LevelShape,
)
from devkit.detector.integer.steps import IntegerConvolution, IntegerHead

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PIXELS_GPU = 4
"""Neighbouring pixels of a GPU's thread."""
EXACT = 1 << 24
"""Float32 holds every integer up to this."""

_GPU = f"""
    const int P = {PIXELS_GPU};
    const int words = g.in_stored / 4;
    const int blocks = (g.columns + P - 1) / P;
    int rest = thread;
    const int o = rest % g.outs; rest /= g.outs;
    const int x0 = rest % blocks * P; rest /= blocks;
    const int y = rest % g.rows;
    const size_t n = rest / g.rows;
    const int* image = (const int*)given.data + n * g.in_rows * g.in_columns * words;
    const int border = (g.in_zero & 255) * 0x01010101;
    int sum[P];
    for (int p = 0; p < P; ++p) sum[p] = 0;
    for (int ky = 0; ky < g.size; ++ky) {{
        const int v = y * g.stride - g.top + ky;
        for (int kx = 0; kx < g.size; ++kx) {{
            const int* w = (const int*)kernels.data
                + (size_t)(ky * g.size + kx) * words * g.outs + o;
            const int* from[P];
            for (int p = 0; p < P; ++p) {{
                const int u = (x0 + p) * g.stride - g.left + kx;
                const bool inside = v >= 0 && v < g.in_rows && u >= 0 && u < g.in_columns;
                from[p] = inside ? image + ((size_t)v * g.in_columns + u) * words : nullptr;
            }}
            for (int c = 0; c < words; ++c) {{
                const int weight = w[(size_t)c * g.outs];
                for (int p = 0; p < P; ++p)
                    sum[p] = __dp4a(from[p] ? from[p][c] : border, weight, sum[p]);
            }}
        }}
    }}
    for (int p = 0; p < P && x0 + p < g.columns; ++p) {{
        const int value = sum[p] + biases.data[o];
        const size_t pixel = (n * g.rows + y) * g.columns + x0 + p;
        if (g.head) {{
            ((int*)made.data)[pixel * g.out_stored + o] = value;
        }} else {{
            const long long factor = value < 0 ? negative.data[o] : positive.data[o];
            const int shift = shifts.data[o];
            long long level = ((value * factor + (1ll << (shift - 1))) >> shift) + g.out_zero;
            level = level < -128 ? -128 : level > 127 ? 127 : level;
            made.data[pixel * g.out_stored + o] = (signed char)level;
        }}
    }}
"""

_CPU_ROWS = f"""
    typedef float V __attribute__((vector_size(64), aligned(4)));
    typedef int I __attribute__((vector_size(64), aligned(4)));
    typedef long long L __attribute__((vector_size(128), aligned(8)));
    typedef signed char B __attribute__((vector_size(16), aligned(1)));
#if defined(__AVX512F__)
    const int P = {PIXELS_CPU};
#else
    const int P = {PIXELS_CPU // 2};
#endif
    const int bands = (g.rows + {BAND_ROWS} - 1) / {BAND_ROWS};
    const size_t n = thread / bands;
    const int y0 = thread % bands * {BAND_ROWS};
    const int here = g.rows - y0 < {BAND_ROWS} ? g.rows - y0 : {BAND_ROWS};
    const int channels = g.in_stored;
    // The rows that the band reads, with their border, as floats.
    const int width = ((g.columns + P - 1) / P * P - 1) * g.stride + g.size;
    const signed char* image = (const signed char*)given.data
        + n * g.in_rows * g.in_columns * channels;
    for (int r = 0; r < (here - 1) * g.stride + g.size; ++r) {{
        float* to = room.data + (size_t)r * width * channels;
        const int v = y0 * g.stride - g.top + r;
        const bool inside = v >= 0 && v < g.in_rows;
        const int begin = inside ? g.left * channels : width * channels;
        const int end = inside ? (g.in_columns + g.left < width ? g.in_columns + g.left : width)
            * channels : begin;
        const signed char* from = image + ((long long)v * g.in_columns - g.left) * channels;
        for (int i = 0; i < begin; ++i) to[i] = (float)g.in_zero;
        for (int i = begin; i < end; ++i) to[i] = (float)from[i];
        for (int i = end; i < width * channels; ++i) to[i] = (float)g.in_zero;
    }}
"""

_CPU = f"""
    const int together = 1024 / g.size > 0 ? 1024 / g.size : 1;
    const int step = g.stride * channels;
    for (int first = 0; first < g.outs; first += {LANES}) {{
        const float* lanes = (const float*)kernels.data
            + (size_t)first * g.size * g.size * channels;
        const int wanted = g.outs - first < {LANES} ? g.outs - first : {LANES};
        const I bias = *(const I*)(biases.data + first);
        const I above = *(const I*)(positive.data + first);
        const I below = *(const I*)(negative.data + first);
        const L shift = __builtin_convertvector(*(const I*)(shifts.data + first), L);
        const L half = (L{{}} + 1ll) << (shift - 1ll);
        for (int y = 0; y < here; ++y) {{
            for (int x0 = 0; x0 < g.columns; x0 += P) {{
                V sum[P];
                I whole[P];
                for (int p = 0; p < P; ++p) {{ sum[p] = V{{}}; whole[p] = I{{}}; }}
                for (int ky = 0; ky < g.size; ++ky) {{
                    const float* row = room.data
                        + ((size_t)(y * g.stride + ky) * width + x0 * g.stride) * channels;
                    for (int c0 = 0; c0 < channels; c0 += together) {{
                        const int c1 = c0 + together < channels ? c0 + together : channels;
                        for (int kx = 0; kx < g.size; ++kx) {{
                            const float* x = row + kx * channels;
                            const float* w = lanes
                                + (size_t)(ky * g.size + kx) * channels * {LANES};
                            for (int c = c0; c < c1; ++c) {{
                                const V weight = *(const V*)(w + c * {LANES});
                                #pragma unroll
                                for (int p = 0; p < P; ++p) sum[p] += x[p * step + c] * weight;
                            }}
                        }}
                        if (g.long_sums) {{
                            for (int p = 0; p < P; ++p) {{
                                whole[p] += __builtin_convertvector(sum[p], I);
                                sum[p] = V{{}};
                            }}
                        }}
                    }}
                }}
                for (int p = 0; p < P && x0 + p < g.columns; ++p) {{
                    const size_t pixel = (n * g.rows + y0 + y) * g.columns + x0 + p;
                    const size_t place = pixel * g.out_stored + first;
                    const I value = whole[p] + __builtin_convertvector(sum[p], I) + bias;
                    if (g.head) {{
                        for (int i = 0; i < wanted; ++i) ((int*)made.data)[place + i] = value[i];
                        continue;
                    }}
                    const L factor = __builtin_convertvector(value < 0 ? below : above, L);
                    L level = __builtin_convertvector(value, L) * factor + half;
                    level = (level >> shift) + (long long)g.out_zero;
                    level = level < -128ll ? L{{}} - 128ll : level > 127ll ? L{{}} + 127ll : level;
                    const B levels = __builtin_convertvector(level, B);
                    if (wanted == {LANES}) *(B*)(made.data + place) = levels;
                    else for (int i = 0; i < wanted; ++i) made.data[place + i] = levels[i];
                }}
            }}
        }}
    }}
"""


@wp.struct
class ConvolutionShape:
    """Shapes of a convolution; zeros, and what kind it is."""

    in_rows: wp.int32
    in_columns: wp.int32
    in_stored: wp.int32
    in_zero: wp.int32
    rows: wp.int32
    columns: wp.int32
    outs: wp.int32
    out_stored: wp.int32
    out_zero: wp.int32
    size: wp.int32
    stride: wp.int32
    top: wp.int32
    left: wp.int32
    head: wp.int32
    long_sums: wp.int32


@wp.func_native(f"#if defined(__CUDA_ARCH__)\n{_GPU}\n#else\n{_CPU_ROWS}{_CPU}\n#endif\n")
def _convolve(
    thread: wp.int32,
    g: ConvolutionShape,
    kernels: wp.array(dtype=wp.int32),
    biases: wp.array(dtype=wp.int32),
    positive: wp.array(dtype=wp.int32),
    negative: wp.array(dtype=wp.int32),
    shifts: wp.array(dtype=wp.int32),
    given: wp.array(dtype=wp.int8),
    room: wp.array(dtype=wp.float32),
    made: wp.array(dtype=wp.int8),
): ...


@wp.kernel
def convolution_kernel(
    # model
    g: ConvolutionShape,
    kernels: wp.array(dtype=wp.int32),
    biases: wp.array(dtype=wp.int32),
    positive: wp.array(dtype=wp.int32),
    negative: wp.array(dtype=wp.int32),
    shifts: wp.array(dtype=wp.int32),
    # state in
    given: wp.array(dtype=wp.int8),
    # out
    room: wp.array(dtype=wp.float32),
    made: wp.array(dtype=wp.int8),
):
    """A convolution of [N, rows, columns, channels]; ``room`` is a CPU thread's own."""
    _convolve(wp.tid(), g, kernels, biases, positive, negative, shifts, given, room, made)


def threads_per_image(made: LevelShape, device: wp.Device) -> int:
    """Threads of the kernel for every image."""
    if device.is_cpu:
        return -(-made.rows // BAND_ROWS)
    return made.rows * -(-made.columns // PIXELS_GPU) * made.channels


def prepared(
    step: IntegerConvolution | IntegerHead, given: LevelShape, made: LevelShape, device: wp.Device
) -> list[Any]:
    """The kernel's arguments for a step, less the arrays of its maps."""
    top, left, _, _ = step.windows.pads
    geometry = ConvolutionShape()
    geometry.in_rows, geometry.in_columns = given.rows, given.columns
    geometry.in_stored, geometry.in_zero = given.stored, given.zero
    geometry.rows, geometry.columns = made.rows, made.columns
    geometry.outs, geometry.out_stored = made.channels, made.stored
    geometry.out_zero = made.zero
    geometry.size, geometry.stride = step.windows.size, step.windows.stride
    geometry.top, geometry.left = top, left
    geometry.head = int(made.head)
    size = step.windows.size
    kernels = np.zeros((made.channels, size, size, given.stored), np.int8)
    shape = (made.channels, size, size, given.channels)
    kernels[..., : given.channels] = np.frombuffer(step.kernels, np.int8).reshape(shape)
    largest = np.abs(kernels.astype(np.int64)).sum(axis=(1, 2, 3)).max() * LEVEL_MAX
    geometry.long_sums = int(largest >= EXACT)
    lanes = -(-made.channels // LANES) * LANES
    if device.is_cpu:
        wide = np.zeros((lanes, size, size, given.stored), np.float32)
        wide[: made.channels] = kernels
        blocks = wide.reshape(-1, LANES, size, size, given.stored).transpose(0, 2, 3, 4, 1)
        words = np.ascontiguousarray(blocks).view(np.int32)
    else:
        words = kernels.view(np.int32).transpose(1, 2, 3, 0)
    factors = [np.zeros(lanes, np.int32) for _ in range(4)]
    columns: Sequence[tuple[bytes, str]] = [(step.biases, "<i4")]
    if isinstance(step, IntegerConvolution):
        columns = [*columns, (step.positive, "<i4"), (step.negative, "<i4"), (step.shifts, "i1")]
    for column, (data, kind) in zip(factors, columns, strict=False):
        column[: made.channels] = np.frombuffer(data, kind)
    factors[3][factors[3] == 0] = 1  # of channels that fill the lanes up
    arrays = [words.reshape(-1), *factors]
    return [geometry, *(wp.array(a, dtype=wp.int32, device=device) for a in arrays)]
