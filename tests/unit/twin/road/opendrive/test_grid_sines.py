"""Sine and cosine in one call have the bits of each alone, alone or among others."""

import numpy as np
import pytest

from twin.road.opendrive.grid import cosine, sine, sine_cosine

ANGLES = np.random.default_rng(5).uniform(-20.0, 20.0, (3, 200))


def test_one_call_has_the_bits_of_two():
    up, across = sine_cosine(ANGLES)
    assert up.tobytes() == sine(ANGLES).tobytes()
    assert across.tobytes() == cosine(ANGLES).tobytes()


@pytest.mark.parametrize("row", range(3))
def test_neighbours_change_no_bit(row):
    up, across = sine_cosine(ANGLES)
    for k in (0, 7, 199):
        alone = sine_cosine(float(ANGLES[row, k]))
        assert (up[row, k], across[row, k]) == alone


def test_they_are_sines():
    up, across = sine_cosine(ANGLES)
    assert np.abs(up - np.sin(ANGLES)).max() < 5e-14
    assert np.abs(across - np.cos(ANGLES)).max() < 5e-14
