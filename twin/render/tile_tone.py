"""Noise and tone of all pixels of a tile at once, for the CPU: eight values at a time.

The operations of a value are those of :mod:`twin.render.sensor_noise` and :mod:`twin.render.tone`,
in the same order, so the bytes are theirs. One value after the other they took 40 % of the time in
which a picture with noise was shaded.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.render import noise, sensor_noise
from twin.render.light.light import SlotLight
from twin.render.tone import TABLE_LEN
from twin.render.trace.rays import Optics
from twin.render.trace.visibility import TILE_COLUMNS, TILE_ROWS, Pixel

Signals = wp.types.vector(length=TILE_ROWS * TILE_COLUMNS * 3, dtype=wp.float32)
"""Linear signals of a tile, row by row, RGB."""


def _float(value: float) -> str:
    """``value`` as a float32 in C."""
    return f"{float(np.float32(value))!r}f"


def _whole(value: wp.uint64) -> str:
    return f"{int(value)}ull"


_CODE = f"""
    typedef float F __attribute__((ext_vector_type(8)));
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef int I __attribute__((ext_vector_type(8)));
    typedef unsigned long long L __attribute__((ext_vector_type(8)));
    auto mix = [](auto x) {{
        const auto a = (x ^ (x >> 30)) * {_whole(noise.MIX_A)};
        const auto b = (a ^ (a >> 27)) * {_whole(noise.MIX_B)};
        return b ^ (b >> 31);
    }};
    const int row = corner.row, column = corner.column;
    const int width = optics.width, height = optics.height;
    const int wide = 3 * (width - column < {TILE_COLUMNS} ? width - column : {TILE_COLUMNS});
    const unsigned long long count = light.tick + 1;
    const unsigned long long stream = mix(light.key + {_whole(noise.GOLDEN)} * count);
    const L steps = {{0, 1, 2, 3, 4, 5, 6, 7}};
    for (int r = 0; r < {TILE_ROWS} && row + r < height; ++r) {{
        unsigned char* pixels = wp::address(image, corner.slot, row + r, column, 0);
        const unsigned long long first = ((row + r) * width + column) * 3 + 1;
        for (int k = 0; k < wide; k += 8) {{
            F x = *(const u8*)(signals.c + {3 * TILE_COLUMNS} * r + k);
            if (light.noise) {{
                const F positive = x >= 0.0f ? x : (F)0.0f;
                const F square = positive * {_float(sensor_noise.PER_FULL_WELL)}
                    + {_float(sensor_noise.READ_NOISE)} * {_float(sensor_noise.READ_NOISE)};
                const F sigma = square < 1.0e-30f ? (F)0.0f : __builtin_elementwise_sqrt(square);
                const L bits = mix(stream + {_whole(noise.GOLDEN)} * (first + k + steps));
                const L total = (bits & 1023) + ((bits >> 10) & 1023) + ((bits >> 20) & 1023)
                    + ((bits >> 30) & 1023);
                const F sum = __builtin_convertvector(__builtin_convertvector(total, I), F);
                x = x + sigma * ((sum - {_float(noise.SUM_MEAN)}) / {_float(noise.SUM_SIGMA)});
            }}
            x = x >= 0.0f ? x : (F)0.0f;
            x = x <= 1.0e30f ? x : (F)1.0e30f;
            F place = x / (1.0f + x) * {TABLE_LEN - 1}.0f + 0.5f;
            place = place >= {TABLE_LEN - 1}.0f ? (F){TABLE_LEN - 1}.0f : place;
            place = place >= 0.0f ? place : (F)0.0f;
            const I at = __builtin_convertvector(place, I);
            for (int i = 0; i < 8 && k + i < wide; ++i) pixels[k + i] = tones.data[at[i]];
        }}
    }}
"""


@wp.func_native(f"#if !defined(__CUDA_ARCH__)\n{_CODE}\n#endif\n")
def tone_tile(
    image: wp.array4d(dtype=wp.uint8),
    tones: wp.array(dtype=wp.uint8),
    signals: Signals,
    corner: Pixel,
    optics: Optics,
    light: SlotLight,
):
    """Write the pixels of a tile.

    Args:
        image: pictures [S, H, W, 3], the pixels of a row one behind the other.
        tones: :func:`twin.render.tone.tone_table`.
        signals: of the tile; those outside of the picture are not looked at.
        corner: first pixel of the tile.
        optics: size of the picture.
        light: whether there is noise, its stream and the tick of the case.
    """
