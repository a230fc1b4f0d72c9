"""Thinning keeps what a reader looks for, and gaps stay gaps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from conductor.report.reading.curves import CURVES, POINTS_MAX, POINTS_MIN, points_for, thin
from schemas.files.kpi import KPI_COLUMNS
from twin.records.kpi_file import kpi_table


def _table(rows: int, **changes: list[Any]) -> pa.Table:
    columns: dict[str, list[Any]] = {
        c.name: [None if c.nullable else 0] * rows for c in KPI_COLUMNS
    }
    columns["tick"] = list(range(rows))
    columns["sim_time_ns"] = [50_000_000 * i for i in range(rows)]
    columns["dtc_m"] = [100.0 - 0.01 * i for i in range(rows)]
    for name in ("throttle", "brake"):
        columns[name] = [0.5] * rows
    columns["aeb"] = [False] * rows
    return kpi_table({**columns, **changes})


def test_short_cases_are_kept_whole() -> None:
    curve = thin(_table(POINTS_MAX), POINTS_MAX)
    assert len(curve.time_s) == curve.ticks == POINTS_MAX


def test_long_cases_keep_ends_minimum_and_switches() -> None:
    rows = 70_001
    dtc = [100.0 - 0.001 * i for i in range(rows)]
    dtc[31_234] = 0.25
    aeb = [12_345 <= i < 12_346 for i in range(rows)]
    curve = thin(_table(rows, dtc_m=dtc, aeb=aeb), 600)
    assert len(curve.time_s) <= 600
    assert curve.time_s[0] == 0
    assert curve.time_s[-1] == pytest.approx(3500.0)
    assert curve.values["dtc_m"].min() == 0.25
    on = curve.time_s[curve.values["aeb"] == 1]
    assert on.tolist() == [12_345 * 0.05]
    around = np.searchsorted(curve.time_s, on[0])
    assert curve.time_s[around - 1] == pytest.approx(12_344 * 0.05)
    assert curve.time_s[around + 1] == pytest.approx(12_346 * 0.05)


def test_a_narrow_peak_survives() -> None:
    rows = 5000
    speed = [0.0] * rows
    speed[3333] = 9.0
    assert thin(_table(rows, speed_mps=speed), 600).values["speed_mps"].max() == 9.0


def test_missing_values_become_gaps_with_both_edges() -> None:
    rows = 3000
    brake = [None if 1000 <= i < 1003 else 0.5 for i in range(rows)]
    curve = thin(_table(rows, brake=brake), 600)
    gap = np.isnan(curve.values["brake"])
    assert curve.time_s[gap].tolist()[0] == pytest.approx(50.0)
    assert not (curve.values["brake"] == 0).any()


def test_a_flickering_column_cannot_exceed_the_limit() -> None:
    rows = 20_000
    curve = thin(_table(rows, aeb=[bool(i % 2) for i in range(rows)]), 600)
    assert len(curve.time_s) <= 610


def test_nothing_but_nan_and_no_rows() -> None:
    nan = [float("nan")] * 2000
    assert len(thin(_table(2000, dtc_m=nan), 600).time_s) <= 600
    empty = thin(_table(0), 600)
    assert {len(v) for v in (empty.time_s, *empty.values.values())} == {0}
    assert set(empty.values) == set(CURVES)


@pytest.mark.parametrize(
    ("cases", "points"),
    [(0, POINTS_MAX), (100, POINTS_MAX), (256, 250), (800, 80), (100_000, POINTS_MIN)],
)
def test_points_share_the_page(cases: int, points: int) -> None:
    assert points_for(cases) == points
