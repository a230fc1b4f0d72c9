"""One line of the table: a figure, what it is compared with, and how it compares."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

POINTS_MAX = 800
"""Points of a plotted curve."""


@dataclass(frozen=True, slots=True)
class CheckCurve:
    """A curve for the page."""

    x: np.ndarray
    y: np.ndarray
    x_title: str
    y_title: str


@dataclass(frozen=True, slots=True)
class ManoeuvreCheck:
    """A figure of a manoeuvre against its reference."""

    name: str
    """What is measured, with the circumstances."""
    unit: str
    value: float
    reference: float
    tolerance: float
    """Largest relative difference; not used for limits."""
    source: str
    """Where the reference comes from."""
    kind: Literal["equals", "at most"] = "equals"
    series: tuple[CheckCurve, ...] = field(default=(), compare=False)

    @property
    def difference(self) -> float:
        """Value over reference, less 1."""
        return self.value / self.reference - 1.0 if self.reference else float("nan")

    @property
    def passed(self) -> bool:
        """Whether the figure is within its tolerance; not a number never is."""
        if self.kind == "at most":
            return bool(self.value <= self.reference)
        return bool(abs(self.value - self.reference) <= self.tolerance * abs(self.reference))

    def to_json(self) -> dict[str, Any]:
        """Everything but the curves."""
        return {
            "name": self.name,
            "unit": self.unit,
            "value": self.value,
            "reference": self.reference,
            "kind": self.kind,
            "tolerance": self.tolerance if self.kind == "equals" else None,
            "difference": self.difference,
            "source": self.source,
            "passed": self.passed,
        }


def thinned(x: np.ndarray, y: np.ndarray, x_title: str, y_title: str) -> CheckCurve:
    """A curve with at most :data:`POINTS_MAX` points."""
    step = max(1, len(x) // POINTS_MAX)
    return CheckCurve(x[::step].copy(), y[::step].copy(), x_title, y_title)
