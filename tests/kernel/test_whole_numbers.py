"""Indices from floats that may be anything: inside of their bounds, and the same on all devices."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.base.portable.whole import whole_within, whole_within_f32
from twin.render.tone import TABLE_LEN, tone, tone_table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LARGE = [2.0**31 - 1, 2.0**31, -(2.0**31), -(2.0**31) - 1, 2.0**32, 1e30, -1e30]
SPECIAL = [np.nan, -np.nan, np.inf, -np.inf, *LARGE, 0.0, -0.0, 0.5, -0.5, 0.999999, 5e-324]
BOUNDS = [(0, 8191), (-1, 64), (3, 3), (-7, -2), (0, 2**24)]


@wp.kernel
def whole_kernel(
    x: wp.array(dtype=wp.float64),
    low: wp.int32,
    high: wp.int32,
    out: wp.array2d(dtype=wp.int32),
):
    i = wp.tid()
    out[i, 0] = whole_within(x[i], low, high)
    out[i, 1] = whole_within_f32(wp.float32(x[i]), low, high)


@wp.kernel
def tone_kernel(
    signal: wp.array(dtype=wp.float32),
    table: wp.array(dtype=wp.uint8),
    out: wp.array(dtype=wp.uint8),
):
    i = wp.tid()
    out[i] = tone(signal[i], table)


def expected(x: np.ndarray, low: int, high: int) -> np.ndarray:
    return np.trunc(np.clip(np.where(np.isnan(x), low, x), low, high)).astype(np.int32)


@pytest.mark.parametrize(("low", "high"), BOUNDS)
def test_bounds_hold_for_any_float(low, high):
    random = np.random.default_rng(5)
    near = np.array([low, high])[:, None] + np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    x = np.concatenate([SPECIAL, near.ravel(), random.uniform(low - 9, high + 9, 2000)])
    out = wp.zeros((len(x), 2), dtype=wp.int32, device="cpu")
    inputs = [wp.array(x, dtype=wp.float64, device="cpu"), low, high, out]
    wp.launch(whole_kernel, dim=len(x), inputs=inputs, device="cpu")
    with np.errstate(over="ignore"):
        narrow = x.astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(out.numpy()[:, 0], expected(x, low, high))
    np.testing.assert_array_equal(out.numpy()[:, 1], expected(narrow, low, high))


def test_signals_without_a_value_have_a_colour():
    """They read far outside of the table."""
    signals = np.array([np.inf, 3e38, -np.inf, -3.0, 0.0, 1.0, np.nan], np.float32)
    table = wp.array(tone_table(), dtype=wp.uint8, device="cpu")
    out = wp.zeros(len(signals), dtype=wp.uint8, device="cpu")
    inputs = [wp.array(signals, dtype=wp.float32, device="cpu"), table, out]
    wp.launch(tone_kernel, dim=len(signals), inputs=inputs, device="cpu")
    middle = tone_table()[int(0.5 * (TABLE_LEN - 1) + 0.5)]
    assert out.numpy()[:-1].tolist() == [255, 255, 0, 0, 0, middle]
