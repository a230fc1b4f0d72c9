"""Rewards: a formula over the KPI columns, of every row that a step writes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from schemas.formulas.objective import formula_columns
from schemas.formulas.parse import parse_row_formula
from schemas.formulas.tree import columns_of
from schemas.kinds.scenario import ScenarioKind
from schemas.validation import suggest
from twin.base.errors import UsageError
from twin.kpi.recorder import EVERY_ROW
from twin.kpi.robustness import evaluate
from twin.kpi.table import KpiTable


class RewardFormula:
    """A number per KPI row: that of the formula, or the margin of its condition.

    A row in which the formula is unknown, because a value is missing, adds nothing.
    """

    def __init__(self, text: str, kind: ScenarioKind) -> None:
        """Read a formula.

        Args:
            text: the formula.
            kind: declaration of the scenario's family, which says what columns there are.

        Raises:
            UsageError: it is no formula of a row, or names a column that is not there; one line.
        """
        try:
            self._node = parse_row_formula(text)
        except ValueError as error:
            raise UsageError(f"reward: {error}") from None
        self.columns = columns_of(self._node)
        """Names of its columns."""
        known = [name for name in formula_columns(kind) if name in EVERY_ROW]
        for name in self.columns:
            if name not in known:
                raise UsageError(
                    f"reward: no column '{name}' with every row of scenario type {kind.name}; "
                    f"{suggest(name, known)}"
                )

    def of_rows(
        self,
        values: Mapping[str, NDArray[np.generic]],
        valid: Mapping[str, NDArray[np.bool_]],
        rows: int,
    ) -> NDArray[np.float64]:
        """The formula at every row, float64 [rows]; NaN: unknown.

        Args:
            values: [rows] by column.
            valid: [rows] by column that may be missing.
            rows: how many.
        """
        with np.errstate(all="ignore"):
            found = evaluate(self._node, _PlainRows(values, valid, rows))
        return np.where(np.isfinite(found), found, np.nan)

    def of_table(self, table: KpiTable, begin: int) -> float:
        """Sum over the rows of a case that has ended, from row ``begin`` on."""
        columns = {name: table.columns[name] for name in self.columns}
        values = {name: column.values[begin:] for name, column in columns.items()}
        valid = {n: c.valid[begin:] for n, c in columns.items() if c.valid is not None}
        return float(np.nansum(self.of_rows(values, valid, table.rows - begin)))


class _PlainRows:
    """Rows as the evaluation of formulas takes them."""

    def __init__(
        self,
        values: Mapping[str, NDArray[np.generic]],
        valid: Mapping[str, NDArray[np.bool_]],
        rows: int,
    ) -> None:
        self._values, self._valid = values, valid
        self.rows = rows

    def column(self, name: str) -> NDArray[np.generic]:
        return self._values[name]

    def valid(self, name: str) -> NDArray[np.bool_]:
        return self._valid[name]
