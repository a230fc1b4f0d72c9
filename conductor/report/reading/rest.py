"""Where an ego rests and where it moves: in KPI files, and in logs that hold no speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

REST_MPS = 0.02
"""Slower than this between two rows is at rest, where no speed is known [m/s].

The published logs hold places in whole millimetres, so an ego at rest may seem to go 1.4 mm (a
millimetre on both axes) between rows that are 0.24 s apart or more: 0.006 m/s. The slowest ego that
really drives at the end of a published log goes 0.03 m/s.
"""
MOVED_M = 0.1
"""Further than this from its first place the ego has moved, where no speed is known [m]."""
END_S = 0.5
"""The end of a log is at least this long and two rows [s]: at rest in the last row alone is no
rest, because a simulator that hangs logs a place twice."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Track:
    """Time, place and speed of the ego in every row, float64 [rows]; NaN where missing."""

    time_s: Floats
    x_m: Floats
    y_m: Floats
    dtc_m: Floats
    speed_mps: Floats

    @classmethod
    def of(cls, table: pa.Table) -> Track:
        """The drive in a KPI table."""
        names = ("x_m", "y_m", "dtc_m", "speed_mps")
        columns = [table.column(n).to_numpy().astype(np.float64) for n in names]
        return cls(table.column("sim_time_ns").to_numpy() / 1e9, *columns)

    def way_m(self, from_row: int | NDArray[np.intp], to_row: int | NDArray[np.intp]) -> Floats:
        """Distance between the ego's places in two rows; by the distance to the obstacle where a
        place is missing; NaN where neither is known."""
        way = np.hypot(self.x_m[to_row] - self.x_m[from_row], self.y_m[to_row] - self.y_m[from_row])
        nearer = np.abs(self.dtc_m[to_row] - self.dtc_m[from_row])
        return np.where(np.isnan(way), nearer, way)

    def began(self) -> int | None:
        """The first row in which the ego has moved; None: it never did."""
        moving = np.flatnonzero(np.nan_to_num(self.speed_mps) != 0.0)
        if not len(moving) and np.isnan(self.speed_mps).any():
            start = np.full(len(self.time_s), self._first_known())
            moving = np.flatnonzero(self.way_m(start, _all(self)) > MOVED_M)
        return int(moving[0]) if len(moving) else None

    def _first_known(self) -> int:
        """The first row that another one can be compared with."""
        for known in (~np.isnan(self.x_m + self.y_m), ~np.isnan(self.dtc_m)):
            if known.sum() > 1:
                return int(np.flatnonzero(known)[0])
        return 0

    def resting(self) -> NDArray[np.bool_]:
        """Whether the ego stands still in a row, bool [rows]; without a speed: since the row
        before."""
        slow = np.zeros(len(self.time_s), np.bool_)
        rows = _all(self)
        slow[1:] = self.way_m(rows[:-1], rows[1:]) <= REST_MPS * np.diff(self.time_s)
        return np.where(np.isnan(self.speed_mps), slow, self.speed_mps == 0.0)

    def rests_m(self) -> list[float]:
        """Distances to the obstacle at which the ego came to rest after it had moved, in order [m];
        where it never moved, the one at which it stood. Unknown ones are left out."""
        began = self.began()
        if began is None:
            places = self.dtc_m[-1:]
        else:
            rest = self.resting()
            # Without a speed a row is at rest by the row before, which has to be one of moving.
            rest[: began + int(np.isnan(self.speed_mps[began]))] = False
            places = self.dtc_m[1:][rest[1:] & ~rest[:-1]]
        return [float(dtc_m) for dtc_m in places if np.isfinite(dtc_m)]

    def first_rest_beyond_m(self, limit_m: float) -> float | None:
        """Where the ego first came to rest further than ``limit_m`` from the obstacle [m]; None:
        nowhere."""
        return next((dtc_m for dtc_m in self.rests_m() if dtc_m > limit_m), None)

    def end_speed_mps(self) -> float:
        """Speed over the last :data:`END_S` and two rows at least; NaN where it is not known."""
        known = np.flatnonzero(~np.isnan(self.x_m + self.y_m) | ~np.isnan(self.dtc_m))
        if len(known) < 3:
            return float("nan")
        rows_after = len(self.time_s) - 1 - known[-1]
        if rows_after > 1 and self.time_s[-1] - self.time_s[known[-1]] > END_S:
            return float("nan")
        time_s = self.time_s[known]
        early = int(np.searchsorted(time_s, time_s[-1] - END_S, "right")) - 1
        first = max(0, min(early, len(known) - 3))
        return float(self.way_m(known[first], known[-1]) / (time_s[-1] - time_s[first]))

    def end_dtc_m(self) -> float:
        """Distance to the obstacle where the ego rests at the end, from the last row of that rest
        that holds one [m]; NaN where none does."""
        measured = np.flatnonzero(~np.isnan(self.x_m + self.y_m) | ~np.isnan(self.dtc_m))
        rest = self.resting()[: int(measured[-1]) + 1 if len(measured) else 0]
        moving = np.flatnonzero(~rest)
        dtc_m = self.dtc_m[int(moving[-1]) if len(moving) else 0 :]
        known = dtc_m[~np.isnan(dtc_m)]
        return float(known[-1]) if len(known) else float("nan")


def _all(track: Track) -> NDArray[np.intp]:
    return np.arange(len(track.time_s))
