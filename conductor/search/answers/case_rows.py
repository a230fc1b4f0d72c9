"""The cases of a search as rows: values of the parameters, margin, failed or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from conductor.search.driver import Closed, closed_history
from conductor.search.protocol import Array
from conductor.search.space import values_of
from schemas.sections.search import Search, Value


@dataclass(frozen=True, slots=True)
class SearchRows:
    """Every case of the closed generations, in the order in which they were proposed."""

    values: list[list[Value]]
    """Values of the parameters [cases][parameters]."""
    u: Array
    """Standard normal coordinates behind them [cases, parameters]."""
    g: Array
    """Margins [cases]: below 0 is a failure, smaller is worse."""

    @property
    def failed(self) -> npt.NDArray[np.bool_]:
        """Whether each has failed."""
        return np.asarray(self.g < 0)

    def column(self, place: int) -> list[Value]:
        """Values of one parameter, case by case."""
        return [row[place] for row in self.values]


def case_rows(
    search: Search, closed: Closed, values: list[list[Value]] | None = None
) -> SearchRows:
    """The rows of a search; at least one generation has closed.

    Args:
        search: the section.
        closed: its closed generations.
        values: of the parameters of all their cases, where somebody has them; else they are
            computed again.
    """
    history = closed_history(search, closed)
    u = np.concatenate(history.u)
    if values is None:
        values = values_of(search, u)
    return SearchRows(values, u, np.concatenate(history.g))
