"""Collects the KPI rows of one running case."""

from __future__ import annotations

from typing import Any

import numpy as np

from schemas.kpi import DETECTION_FIELDS, KPI_COLUMNS, headlight_code
from schemas.messages import Command
from twin.kpi.table import Detections, KpiColumn, KpiTable
from twin.vehicle.state import COLUMN

CLOSING_MIN_MPS = 0.05
"""Time to collision exists only above this closing speed [m/s]."""

_TYPES: dict[str, type] = {
    "bool": np.bool_,
    "int32": np.int32,
    "int64": np.int64,
    "float64": np.float64,
}
_FIRST_ROWS = 256
_STATE = ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "dtc_m")


class Recorder:
    """Rows of one case in NumPy columns that double when full."""

    def __init__(self) -> None:
        self.rows = 0
        self._values = {
            c.name: np.zeros(_FIRST_ROWS, _TYPES[c.type])
            for c in KPI_COLUMNS
            if c.type != "detections"
        }
        self._valid = {
            c.name: np.zeros(_FIRST_ROWS, np.bool_)
            for c in KPI_COLUMNS
            if c.nullable and c.type != "detections"
        }
        self._detected: list[Any] = []
        self._offsets = [0]
        self._commanded: list[bool] = []

    def add(
        self,
        tick: int,
        sim_time_ns: int,
        state: np.ndarray,
        command: Command | None,
        lateral_error_m: float | None = None,
    ) -> None:
        """Append the row of a tick: ``state`` [T] of its slot, and the command given for it."""
        if self.rows == len(self._values["tick"]):
            for columns in (self._values, self._valid):
                for name, values in columns.items():
                    columns[name] = np.concatenate([values, np.zeros_like(values)])
        row = self.rows
        self._set(row, "tick", tick)
        self._set(row, "sim_time_ns", sim_time_ns)
        for name in _STATE:
            self._set(row, name, state[COLUMN[name]])
        self._set(row, "collisions", int(state[COLUMN["collisions"]]))
        closing = state[COLUMN["closing_mps"]]
        if closing > CLOSING_MIN_MPS:
            self._set(row, "ttc_s", state[COLUMN["dtc_m"]] / closing)
        if lateral_error_m is not None:
            self._set(row, "lateral_error_m", lateral_error_m)
        if command is not None:
            lights = command.lights
            self._set(row, "throttle", command.throttle)
            self._set(row, "brake", command.brake)
            self._set(row, "steering_rad", command.steering_rad)
            self._set(row, "aeb", command.aeb)
            self._set(
                row,
                "headlights",
                headlight_code(lights.low, lights.high, lights.parking, lights.fog),
            )
            self._set(row, "indicators", lights.indicators)
            self._detected += command.detections
        self._commanded.append(command is not None)
        self._offsets.append(len(self._detected))
        self.rows += 1

    def _set(self, row: int, name: str, value: Any) -> None:
        self._values[name][row] = value
        if name in self._valid:
            self._valid[name][row] = True

    def column(self, name: str) -> np.ndarray:
        """Values of a column so far, a view [rows]."""
        return self._values[name][: self.rows]

    def valid(self, name: str) -> np.ndarray:
        """Validity of a nullable column so far, a view [rows]."""
        return self._valid[name][: self.rows]

    def table(self) -> KpiTable:
        """The rows so far, copied."""
        n = self.rows
        columns = {
            name: KpiColumn(
                values[:n].copy(), self._valid[name][:n].copy() if name in self._valid else None
            )
            for name, values in self._values.items()
        }
        found = self._detected
        numbers = {
            name: np.array([getattr(d, name) for d in found], np.float64)
            for name in DETECTION_FIELDS
            if name != "label"
        }
        detections = Detections(
            offsets=np.array(self._offsets, np.int32),
            valid=np.array(self._commanded, np.bool_),
            label=[d.label for d in found],
            **numbers,
        )
        return KpiTable(n, columns, detections)
