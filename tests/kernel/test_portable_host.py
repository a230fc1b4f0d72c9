"""Portable functions of the host: the bits of those of kernels."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.base.portable import host
from twin.base.portable_math import portable_atan2, portable_cos, portable_sin, portable_tan
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def functions_kernel(
    x: wp.array(dtype=wp.float64),
    y: wp.array(dtype=wp.float64),
    out: wp.array2d(dtype=wp.float64),
):
    i = wp.tid()
    out[i, 0] = portable_sin(x[i])
    out[i, 1] = portable_cos(x[i])
    out[i, 2] = portable_tan(x[i])
    out[i, 3] = portable_atan2(y[i], x[i])


SPECIAL = np.array([0.0, -0.0, 1e-160, 2.0**-40, 1.0, -1.0, np.pi, np.pi / 2, 3.0, 2.0**100])


def places() -> tuple[np.ndarray, np.ndarray]:
    """Points of all sizes and directions, and every pair of special values."""
    rng = np.random.default_rng(11)
    count = 100_000
    x, y = rng.normal(size=(2, count)) * 10.0 ** rng.uniform(-12.0, 5.0, (2, count))
    near = rng.integers(-1000, 1000, count) * (np.pi / 4) * (1.0 + rng.integers(-3, 4) * 2.0**-53)
    a, b = (v.ravel() for v in np.meshgrid(SPECIAL, SPECIAL))
    return np.concatenate([x, near, a]), np.concatenate([y, rng.normal(size=count), b])


def test_every_bit_is_that_of_the_kernels():
    x, y = places()
    out = wp.zeros((len(x), 4), dtype=wp.float64, device="cpu")
    inputs = [wp.array(v, dtype=wp.float64, device="cpu") for v in (x, y)]
    wp.launch(functions_kernel, len(x), inputs, [out], device="cpu")
    expected = out.numpy()
    found = host.sine(x), host.cosine(x), host.tangent(x), host.angle_of(y, x)
    for k, values in enumerate(found):
        known = ~np.isnan(expected[:, k])
        assert (values.view(np.int64) == expected[:, k].view(np.int64))[known].all()
        assert np.isnan(values[~known]).all()
    assert np.isnan(expected[:, 0]).any(), "beyond the limit there is no sine"


def test_both_at_once():
    x, _ = places()
    sines, cosines = host.sine_cosine(x)
    np.testing.assert_array_equal(sines, host.sine(x))
    np.testing.assert_array_equal(cosines, host.cosine(x))


@pytest.mark.parametrize("shape", [(), (3,), (2, 0), (2, 3, 4)])
def test_any_shape(shape):
    x = np.random.default_rng(2).normal(size=shape)
    for function in (host.sine, host.cosine, host.tangent, host.sine_share):
        assert function(x).shape == shape
    assert host.angle_of(x, 1.0).shape == shape
    np.testing.assert_allclose(host.sine_share(x), np.sinc(x / np.pi), rtol=1e-14)


def test_the_share_of_a_sine_at_zero():
    assert host.sine_share([0.0, -0.0]).tolist() == [1.0, 1.0]
    assert np.isnan(host.sine([np.nan, np.inf, -np.inf])).all()


def test_one_angle_has_the_bits_of_many():
    x, _ = places()
    many = np.concatenate([x[::29], SPECIAL, [np.inf, -np.inf, np.nan, 2.0**40, -1e-150, 5e-324]])
    one = np.array([host.sine_cosine(angle) for angle in many.tolist()]).T
    np.testing.assert_array_equal(one.view(np.int64), np.array(host.sine_cosine(many)).view("i8"))
