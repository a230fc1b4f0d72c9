"""devkit.detector.exponential against mpmath, and at the ends of what a float holds."""

from __future__ import annotations

import mpmath
import numpy as np

from devkit.detector.exponential import exponential


def test_within_a_unit_of_the_last_place():
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.uniform(-700, 700, 500), rng.uniform(-1, 1, 500), [0.0, 709.0]])
    found = exponential(values)
    with mpmath.workdps(40):
        worst = max(
            abs(mpmath.mpf(one) - mpmath.exp(mpmath.mpf(x))) / mpmath.mpf(float(np.spacing(one)))
            for one, x in zip(found.tolist(), values.tolist(), strict=True)
        )
    assert worst < 1.0
    assert found[-2] == 1.0


def test_beyond_what_a_float_holds():
    given = np.array([np.nan, np.inf, 710.0, -746.0, -np.inf])
    np.testing.assert_array_equal(exponential(given), [np.nan, np.inf, np.inf, 0.0, 0.0])
    assert exponential(np.array([])).shape == (0,)
