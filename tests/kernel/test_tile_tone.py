"""Noise and tone of a tile at once are those of its values one by one, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.render.light.light import SlotLight
from twin.render.sensor_noise import sensor_noise
from twin.render.tile_tone import Signals, tone_tile
from twin.render.tone import tone, tone_table
from twin.render.trace.rays import Optics
from twin.render.trace.visibility import TILE_COLUMNS, TILE_ROWS, Pixel

KEY, TICK = 0xFEDC_BA98_7654_3210, 4321


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def by_tile(
    # state in
    signals: wp.array4d(dtype=wp.float32),
    tones: wp.array(dtype=wp.uint8),
    # args
    noisy: wp.int32,
    key: wp.uint64,
    tick: wp.int32,
    # out
    image: wp.array4d(dtype=wp.uint8),
):
    """A thread per tile of the picture of slot 1."""
    line, tile = wp.tid()
    row = line * wp.static(TILE_ROWS)
    column = tile * wp.static(TILE_COLUMNS)
    own = Signals()
    for place in range(wp.static(TILE_ROWS * TILE_COLUMNS)):
        i = row + place / wp.static(TILE_COLUMNS)
        j = column + place % wp.static(TILE_COLUMNS)
        if i < signals.shape[1] and j < signals.shape[2]:
            for channel in range(3):
                own[place * 3 + channel] = signals[1, i, j, channel]
    corner, optics, light = Pixel(), Optics(), SlotLight()
    corner.slot = 1
    corner.row = row
    corner.column = column
    optics.width = signals.shape[2]
    optics.height = signals.shape[1]
    light.noise = noisy
    light.key = key
    light.tick = tick
    tone_tile(image, tones, own, corner, optics, light)


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def by_value(
    # state in
    signals: wp.array4d(dtype=wp.float32),
    tones: wp.array(dtype=wp.uint8),
    # args
    noisy: wp.int32,
    key: wp.uint64,
    tick: wp.int32,
    # out
    image: wp.array4d(dtype=wp.uint8),
):
    """A thread per pixel of the picture of slot 1."""
    row, column = wp.tid()
    for channel in range(3):
        x = signals[1, row, column, channel]
        if noisy != 0:
            element = (row * signals.shape[2] + column) * 3 + channel
            x = sensor_noise(x, key, tick, element)
        image[1, row, column, channel] = tone(x, tones)


def pictures(signals: np.ndarray, noisy: bool) -> tuple[np.ndarray, np.ndarray]:
    """Bytes [2, H, W, 3] of a tile at once, and of one value after the other."""
    _, height, width, _ = signals.shape
    given = wp.array(signals, dtype=wp.float32, device="cpu")
    tones = wp.array(tone_table(), dtype=wp.uint8, device="cpu")
    inputs = [given, tones, int(noisy), wp.uint64(KEY), TICK]
    tiles = wp.full(signals.shape, 77, dtype=wp.uint8, device="cpu")
    values = wp.full(signals.shape, 77, dtype=wp.uint8, device="cpu")
    size = -(-height // TILE_ROWS), -(-width // TILE_COLUMNS)
    wp.launch(by_tile, size, inputs, [tiles], device="cpu")
    wp.launch(by_value, (height, width), inputs, [values], device="cpu")
    return tiles.numpy(), values.numpy()


def signals_of(height: int, width: int) -> np.ndarray:
    """Signals [2, H, W, 3] of all sizes, and some that no camera gives."""
    rng = np.random.default_rng(height * 1000 + width)
    signals = np.exp(rng.uniform(-14.0, 8.0, (2, height, width, 3))).astype(np.float32)
    odd = np.array([0.0, -0.0, -1.0, 1e-38, 1e30, 3e38, np.inf, -np.inf, np.nan], np.float32)
    signals[1].flat[: len(odd)] = odd
    return signals


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("size", [(4, 8), (8, 64), (3, 5), (9, 37), (181, 323)])
def test_a_tile_has_the_bytes_of_its_values(size: tuple[int, int], noisy: bool) -> None:
    signals = signals_of(*size)
    tiles, values = pictures(signals, noisy)
    np.testing.assert_array_equal(tiles, values)
    assert (tiles[0] == 77).all(), "another slot's picture was written"
    assert tiles[1].std() > 20.0


def test_noise_is_seen_in_both() -> None:
    signals = np.full((2, 64, 64, 3), 0.3, np.float32)
    calm, noisy = pictures(signals, False)[0], pictures(signals, True)[0]
    assert (calm[1] == calm[1, 0, 0]).all()
    assert 0.5 < noisy[1].std() < 20.0
