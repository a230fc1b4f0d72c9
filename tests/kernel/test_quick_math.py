"""Quotients, roots and decays of pictures: on a CPU they are its own, and what is theirs alone."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.base.portable import quick

COUNT = 200_000


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def quick_kernel(
    # state in
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    # out
    out: wp.array2d(dtype=wp.float32),
):
    """Every operation of every pair."""
    i = wp.tid()
    out[0, i] = quick.quotient(a[i], b[i])
    out[1, i] = quick.reciprocal(b[i])
    out[2, i] = quick.root(b[i])
    out[3, i] = quick.decay(a[i])
    out[4, i] = quick.between(a[i], b[i], 0.25)
    one = quick.unit(wp.vec3(a[i], b[i], -1.0))
    out[5, i] = quick.dot(one, one)


def found(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Results [6, N]."""
    out = wp.zeros((6, len(a)), dtype=wp.float32, device="cpu")
    given = [wp.array(part.astype(np.float32), dtype=wp.float32, device="cpu") for part in (a, b)]
    wp.launch(quick_kernel, len(a), given, [out], device="cpu")
    return out.numpy()


def test_quotients_reciprocals_and_roots_are_the_nearest_floats() -> None:
    rng = np.random.default_rng(3)
    a, b = (np.exp(rng.uniform(-40, 40, COUNT)).astype(np.float32) for _ in range(2))
    quotient, reciprocal, root, _, between, size = found(a, b)
    np.testing.assert_array_equal(quotient, a / b)
    np.testing.assert_array_equal(reciprocal, np.float32(1.0) / b)
    np.testing.assert_array_equal(root, np.sqrt(b))
    wanted = 0.75 * a.astype(float) + 0.25 * b.astype(float)
    np.testing.assert_allclose(between, wanted, rtol=3e-7)
    np.testing.assert_allclose(size, 1.0, rtol=4e-7)


def test_decays_are_within_a_unit_in_the_last_place_of_the_exponential() -> None:
    exponent = np.concatenate([np.linspace(0.0, 80.0, COUNT), 10.0 ** np.linspace(-12, 1.9, COUNT)])
    exponent = exponent.astype(np.float32)
    decay = found(exponent, np.ones_like(exponent))[3]
    exact = np.exp(-exponent.astype(float))
    assert np.abs((decay - exact) / np.spacing(exact.astype(np.float32))).max() < 1.2
    assert (np.diff(decay[:COUNT]) <= 0.0).all()  # brighter nowhere behind more air


@pytest.mark.parametrize("exponent", [80.0, 81.0, 1.0e30, np.inf])
def test_beyond_eighty_nothing_fades_any_more(exponent: float) -> None:
    given = np.array([exponent, 0.0])
    assert found(given, np.ones(2))[3].tolist() == [np.float32(1.8048514e-35), 1.0]


def test_roots_of_nothing_and_less_are_zero_as_on_a_gpu() -> None:
    given = np.array([0.0, -1.0, 1.0e-31, 1.0e-29])
    assert found(np.ones(4), given)[2].tolist() == [0.0, 0.0, 0.0, np.sqrt(np.float32(1.0e-29))]
