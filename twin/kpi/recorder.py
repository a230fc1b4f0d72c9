"""Collects the KPI rows of the running cases, those of a tick for all slots at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from schemas.files.kpi import DETECTION_FIELDS, KPI_COLUMNS, headlight_code
from schemas.kinds.kpi import KpiKind, columns_by_name
from schemas.messages import Command, Lights
from twin.kpi.computed import computed_column
from twin.kpi.table import DetectionColumn, KpiColumn, KpiTable
from twin.vehicle.columns import COLUMN

CLOSING_MIN_MPS = 0.05
"""Time to collision exists only above this closing speed [m/s]."""

_TYPES: dict[str, type] = {
    "bool": np.bool_,
    "int32": np.int32,
    "int64": np.int64,
    "float64": np.float64,
    "name": np.int32,
}
"""How rows are kept; a name as its number in the table of names."""
_FIRST_ROWS = 256
_PLAIN = [column for column in KPI_COLUMNS if column.type != "detections"]
_OWN = tuple(column for name, column in columns_by_name().items() if column not in KPI_COLUMNS)
"""Columns that only some families have; float64 and nullable."""
_NULLABLE = frozenset(column.name for column in (*KPI_COLUMNS, *_OWN) if column.nullable)
_NAMES = frozenset(column.name for column in KPI_COLUMNS if column.type == "name")
_KEPT = (*_PLAIN, *(column for column in _OWN if not column.implementation))
"""Columns of which a value comes with every row."""
EVERY_ROW = frozenset(column.name for column in _KEPT)
"""Their names."""
_BY_SCENARIO = tuple(
    column.name for column in _KEPT if column.by_scenario or column not in KPI_COLUMNS
)
_STATE = ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "collisions")


class KpiRecorder:
    """Rows of all slots: of every column one NumPy array [S, rows], which doubles when full.

    What a row costs hardly depends on the number of slots.
    """

    def __init__(self, slots: int, names: Sequence[str] = ()) -> None:
        """Rows for so many slots.

        Args:
            slots: S.
            names: of the objects that ``nearest`` of :meth:`add` counts.
        """
        self._names: list[np.ndarray] = [np.array(["", *names])] * slots
        self._target = np.ones(slots, np.bool_)
        """There is something to which ``dtc_m`` is measured."""
        self._nearest = np.zeros(slots, np.bool_)
        """What is nearest is the target."""
        self._values = {c.name: np.zeros((slots, _FIRST_ROWS), _TYPES[c.type]) for c in _KEPT}
        self._valid = {
            c.name: np.zeros((slots, _FIRST_ROWS), np.bool_) for c in _KEPT if c.nullable
        }
        self._own: list[Sequence[KpiKind]] = [()] * slots
        self._rows = np.zeros(slots, np.int64)
        self._detected: list[list[Any]] = [[] for _ in range(slots)]
        self._offsets: list[list[int]] = [[0] for _ in range(slots)]
        self._commanded: list[list[bool]] = [[] for _ in range(slots)]

    def begin(
        self,
        slot: int,
        own: Sequence[KpiKind] = (),
        *,
        target: bool = True,
        nearest: bool = False,
        names: Sequence[str] | None = None,
    ) -> None:
        """Forget the rows of a slot: a case begins.

        Args:
            slot: which.
            own: columns that its scenario's family has behind those of all.
            target: its scenario's target is there, so it has a distance to collision.
            nearest: its target is always what is nearest.
            names: of the objects that ``nearest`` of :meth:`add` counts in it; None: as before.
        """
        self._nearest[slot] = nearest
        if names is not None:
            self._names[slot] = np.array(["", *names])
        self._own[slot] = own
        self._target[slot] = target
        self._rows[slot] = 0
        self._detected[slot], self._offsets[slot], self._commanded[slot] = [], [0], []

    def add(
        self,
        slots: Sequence[int],
        tick: np.ndarray,
        sim_time_ns: np.ndarray,
        state: np.ndarray,
        commands: Sequence[Command | None],
        by_scenario: Sequence[Mapping[str, float]],
        nearest: np.ndarray | None = None,
    ) -> None:
        """Append a row to every one of ``slots``.

        Args:
            slots: which, n of them.
            tick: case ticks of all slots [S].
            sim_time_ns: sim times of all slots [S].
            state: vehicle states of all slots [S, T].
            commands: n, given for this tick.
            by_scenario: n, columns that the scenario gives; those not named are missing.
            nearest: what all slots are nearest to [S, 4], columns
                :data:`twin.vehicle.nearest.NEAREST`; None: nothing was measured.
        """
        which = np.array(slots, np.int64)
        row = self._rows[which]
        if row.size and int(row.max()) == self._values["tick"].shape[1]:
            self._grow()
        self._set("tick", which, row, tick[which])
        self._set("sim_time_ns", which, row, sim_time_ns[which])
        for name in _STATE:
            self._set(name, which, row, state[which, COLUMN[name]])
        here = self._target[which]
        self._set("dtc_m", which, row, state[which, COLUMN["dtc_m"]], here)
        closing = state[which, COLUMN["closing_mps"]]
        closes = here & (closing > CLOSING_MIN_MPS)
        ttc_s = np.divide(state[which, COLUMN["dtc_m"]], closing, where=closes, out=closing.copy())
        self._set("ttc_s", which, row, ttc_s, closes)
        if nearest is not None and self._nearest[which].any():
            self._set_target(which, row, nearest)
        for name in _BY_SCENARIO:
            valid = np.array([name in values for values in by_scenario], np.bool_)
            values = np.array([values.get(name, 0.0) for values in by_scenario])
            self._set(name, which, row, values, valid)
        self._set_nearest(which, row, nearest)
        self._set_commands(which, row, commands)
        self._rows[which] += 1

    def _set_target(self, which: np.ndarray, row: np.ndarray, nearest: np.ndarray) -> None:
        """Distance and time to collision of those whose target is what is nearest."""
        mine = self._nearest[which]
        for name, at in (("dtc_m", 0), ("ttc_s", 2)):
            values = nearest[which[mine]]
            self._set(name, which[mine], row[mine], values[:, at], values[:, at + 1] >= 0.0)

    def _set_nearest(self, which: np.ndarray, row: np.ndarray, nearest: np.ndarray | None) -> None:
        if nearest is None:
            nearest = np.full((self._rows.size, 4), -1.0)
        for at, (value, name) in (
            (0, ("nearest_m", "nearest_object")),
            (2, ("nearest_ttc_s", "nearest_ttc_object")),
        ):
            known = nearest[which, at + 1] >= 0.0
            self._set(value, which, row, nearest[which, at], known)
            self._set(name, which, row, nearest[which, at + 1] + 1.0, known)

    def _set_commands(
        self, which: np.ndarray, row: np.ndarray, commands: Sequence[Command | None]
    ) -> None:
        valid = np.array([command is not None for command in commands], np.bool_)
        numbers = np.array(
            [
                (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                if c is None
                else (c.throttle, c.brake, c.steering_rad, c.aeb, _code(c.lights), _indicators(c))
                for c in commands
            ],
            np.float64,
        ).reshape(-1, 6)
        names = ("throttle", "brake", "steering_rad", "aeb", "headlights", "indicators")
        for name, values in zip(names, numbers.T, strict=True):
            self._set(name, which, row, values, valid)
        for slot, command in zip(which.tolist(), commands, strict=True):
            detections = self._detected[slot]
            if command is not None:
                detections += command.detections
            self._commanded[slot].append(command is not None)
            self._offsets[slot].append(len(detections))

    def _set(
        self,
        name: str,
        which: np.ndarray,
        row: np.ndarray,
        values: np.ndarray,
        valid: np.ndarray | None = None,
    ) -> None:
        """Values of a column, 0 where they are not ``valid`` (None: all are)."""
        if valid is None:
            self._values[name][which, row] = values
        else:
            self._values[name][which, row] = np.where(valid, values, 0)
        if name in _NULLABLE:
            self._valid[name][which, row] = True if valid is None else valid

    def last(self, slot: int, column: str) -> float | None:
        """The latest value of a column that comes with every row; None: missing."""
        row = int(self._rows[slot]) - 1
        if column in self._valid and not self._valid[column][slot, row]:
            return None
        return float(self._values[column][slot, row])

    def tail(
        self, slots: Sequence[int], rows: int, columns: Iterable[str]
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """The last rows of several slots: values by column, and the validity of those columns that
        may be missing; each [slots * rows], those of a slot together.

        Args:
            slots: which.
            rows: of each of them; it has at least so many.
            columns: of :data:`EVERY_ROW`.
        """
        which = np.repeat(np.array(slots, np.int64), rows)
        row = self._rows[which] + np.tile(np.arange(-rows, 0), len(slots))
        values = {name: self._values[name][which, row] for name in columns}
        valid = {name: self._valid[name][which, row] for name in values if name in self._valid}
        return values, valid

    def known(self, slot: int, column: str) -> np.ndarray:
        """Whether a column that comes with every row has a value, bool [rows]."""
        rows = int(self._rows[slot])
        if column not in self._valid:
            return np.ones(rows, np.bool_)
        return self._valid[column][slot, :rows]

    def save(self, slot: int) -> dict[str, Any]:
        """The rows of a slot so far, copied."""
        rows = int(self._rows[slot])
        return {
            "values": {name: column[slot, :rows].copy() for name, column in self._values.items()},
            "valid": {name: column[slot, :rows].copy() for name, column in self._valid.items()},
            "detected": list(self._detected[slot]),
            "offsets": list(self._offsets[slot]),
            "commanded": list(self._commanded[slot]),
        }

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on behind saved rows, in a slot whose case has just begun."""
        rows = len(saved["values"]["tick"])
        while rows > self._values["tick"].shape[1]:
            self._grow()
        for columns, its in ((self._values, saved["values"]), (self._valid, saved["valid"])):
            for name, values in its.items():
                columns[name][slot, :rows] = values
        self._rows[slot] = rows
        self._detected[slot], self._offsets[slot] = list(saved["detected"]), list(saved["offsets"])
        self._commanded[slot] = list(saved["commanded"])

    def _grow(self) -> None:
        for columns in (self._values, self._valid):
            for name, values in columns.items():
                columns[name] = np.concatenate([values, np.zeros_like(values)], axis=1)

    def of(self, slot: int) -> CaseRows:
        """The rows of a slot so far, with the columns that are computed of them."""
        rows = int(self._rows[slot])
        columns = [c.name for c in (*_PLAIN, *self._own[slot]) if c.name in self._values]
        case_rows = CaseRows(
            {name: self._values[name][slot, :rows] for name in columns},
            {name: self._valid[name][slot, :rows] for name in columns if name in self._valid},
            self._names[slot],
            DetectionColumn(
                offsets=np.array(self._offsets[slot], np.int32),
                valid=np.array(self._commanded[slot], np.bool_),
                label=[d.label for d in self._detected[slot]],
                **{
                    name: np.array([getattr(d, name) for d in self._detected[slot]], np.float64)
                    for name in DETECTION_FIELDS
                    if name != "label"
                },
            ),
        )
        for kind in self._own[slot]:
            if kind.implementation:
                case_rows.put(kind.name, computed_column(kind, case_rows))
        return case_rows


class CaseRows:
    """The rows of one case; views that are valid until its slot begins another."""

    def __init__(
        self,
        values: dict[str, np.ndarray],
        valid: dict[str, np.ndarray],
        names: np.ndarray,
        detections: DetectionColumn,
    ) -> None:
        self._values = values
        self._valid = valid
        self._names = names
        self._detections = detections
        self.rows = len(values["tick"])

    def put(self, name: str, values: np.ndarray) -> None:
        """Add a column, float64 [rows]; NaN: missing."""
        self._valid[name] = ~np.isnan(values)
        self._values[name] = np.where(self._valid[name], values, 0.0)

    def column(self, name: str) -> np.ndarray:
        """Values of a column [rows]; of a column of names their numbers."""
        return self._values[name]

    def name(self, column: str, row: int) -> str:
        """A value of a column of names; empty where missing."""
        return str(self._names[self._values[column][row]])

    def valid(self, name: str) -> np.ndarray:
        """Validity of a nullable column [rows]."""
        return self._valid[name]

    def table(self) -> KpiTable:
        """The rows, copied."""
        columns = {
            name: KpiColumn(
                self._names[values] if name in _NAMES else values.copy(),
                self._valid[name].copy() if name in self._valid else None,
            )
            for name, values in self._values.items()
        }
        return KpiTable(self.rows, columns, self._detections)


def _code(lights: Lights) -> int:
    return _code_of(lights.low, lights.high, lights.parking, lights.fog)


def _indicators(command: Command) -> int:
    return command.lights.indicators


_code_of = cache(headlight_code)
