"""Distributions over many cases: means of all rows, shares of the cases that run, quantiles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from unit.conductor.report.test_report_curves import _table

from conductor.report.plots.spread import LEVELS, LINES_MAX, spread_of
from conductor.report.reading import cache
from conductor.report.reading.curves import BINS, POINTS_MIN, SHARED, KpiCurve, binned, thin

ROWS = 2001
"""100 s at 20 Hz."""


def _case(rows: int = ROWS, **changes: list[Any]) -> KpiCurve:
    return thin(_table(rows, **changes), POINTS_MIN)


def _from(at_s: float, rows: int = ROWS) -> list[bool]:
    return [row * 0.05 >= at_s for row in range(rows)]


def test_few_cases_are_drawn_one_by_one() -> None:
    assert spread_of([]) is None
    assert spread_of([_case()] * LINES_MAX) is None
    assert spread_of([_case()] * (LINES_MAX + 1)) is not None


def test_the_share_of_cases_with_aeb_rises_as_they_trigger() -> None:
    curves = [_case(aeb=_from(10.0 + i)) for i in range(40)]
    spread = spread_of(curves)
    assert spread is not None
    assert spread.cases == 40
    assert set(spread.values) == set(SHARED)
    (share,) = spread.values["aeb"]
    assert np.allclose(spread.time_s, np.arange(BINS) + 0.5)
    assert share[:10].max() == 0
    assert share[30] == pytest.approx(21 / 40, abs=1e-6), "those that triggered until 30 s"
    assert share[60:].min() == pytest.approx(1, abs=1e-6)


def test_a_flickering_case_counts_by_its_time_whatever_its_curve_was_thinned_to() -> None:
    flicker = [row % 4 == 0 for row in range(ROWS)]
    spread = spread_of([_case(aeb=flicker)] * 30)
    assert spread is not None
    assert np.allclose(spread.values["aeb"], 0.25, atol=1e-6)


def test_shares_of_collisions_stay_when_their_cases_have_ended() -> None:
    hit, free = 401, ROWS
    cases = [_case(hit, collisions=[0] * (hit - 1) + [1])] * 10
    spread = spread_of([*cases, *[_case(free, collisions=[0] * free)] * 30])
    assert spread is not None
    (share,) = spread.values["collisions"]
    assert share[18] == 0
    assert share[20:].tolist() == [0.25] * 80


def test_commands_have_a_median_and_bands() -> None:
    spread = spread_of([_case(throttle=[i / 100] * ROWS) for i in range(101)])
    assert spread is not None
    assert np.allclose(spread.values["throttle"], np.array(LEVELS)[:, None], atol=1e-6)
    assert np.allclose(spread.values["brake"], 0.5)


def test_nothing_is_drawn_where_few_cases_still_run() -> None:
    spread = spread_of([*[_case(1001)] * 36, *[_case()] * 4])
    assert spread is not None
    (share,) = spread.values["aeb"]
    assert np.isfinite(share[:50]).all()
    assert np.isnan(share[51:]).all()


def test_what_is_not_known_counts_for_nothing() -> None:
    unknown = _case(aeb=[None] * ROWS, throttle=[None] * ROWS)
    spread = spread_of([*[unknown] * 20, *[_case(aeb=_from(0.0))] * 10])
    assert spread is not None
    assert np.allclose(spread.values["aeb"], 1.0)
    nothing = spread_of([unknown] * 30)
    assert nothing is not None
    assert np.isnan(nothing.values["throttle"]).all()


def test_means_of_stretches() -> None:
    starts, values = np.array([0.0, 1.0, 3.0, 4.0]), np.array([2.0, np.nan, 4.0])
    found = binned(starts, values, np.array([0.0, 0.5, 2.0, 3.5, 6.0, 7.0]))
    assert found[:4].tolist() == [2.0, 2.0, 4.0, 4.0]
    assert np.isnan(found[4])


def test_the_cache_keeps_them(tmp_path: Path) -> None:
    curve = _case(aeb=_from(50.0))
    packed, means = cache.packed(curve)
    entry = cache.Entry(cache.Stamp("", 0, 0), curve.ticks, POINTS_MIN, packed, means)
    cache.store(tmp_path, cache.Cache(entries={"a": entry}))
    again = cache.unpacked(cache.load(tmp_path).entries["a"])
    for name in SHARED:
        assert np.array_equal(again.means[name], curve.means[name], equal_nan=True)


def test_one_row_has_no_means() -> None:
    assert isinstance(_table(1), pa.Table)
    assert np.isnan(_case(1).means["aeb"]).all()
