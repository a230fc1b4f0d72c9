"""What a scenario family does; no Warp, because the judge does it again from files.

A family is a class, made once per case: :class:`ScenarioRun`. The table in
:mod:`schemas.kinds.scenario` names it as ``module:attribute``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from twin.scenario.surroundings import Surroundings
from twin.world.things import Thing

Scalars = dict[str, float | int | None]


class Rows(Protocol):
    """KPI rows of one case, of the simulator or of a file."""

    rows: int

    def column(self, name: str) -> np.ndarray:
        """Values of a column [rows]; 0 where missing."""

    def valid(self, name: str) -> np.ndarray:
        """Validity of a nullable column [rows]."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict of a finished case, and its reasons."""

    verdict: str
    """``pass``, ``collision``, ``false_braking``, ``time_up`` or another word of a family. Which
    count as passed: :mod:`schemas.verdict`."""
    reasons: list[str]
    """Reasons for the verdict, short sentences."""


class ScenarioRun(Protocol):
    """One case of a family, from its start to its verdict."""

    def observe(self, x_m: np.ndarray, y_m: np.ndarray) -> None:
        """The ego's next places, world [ticks] [m]: one per control tick, in order."""

    def columns(self) -> Mapping[str, float]:
        """KPI columns that the family gives, at the last place; those of the table that are
        ``by_scenario``."""

    def ended(self) -> bool:
        """Whether the case ends here, beside collision, rest and time, which end every case."""

    def scalars(self, rows: Rows) -> Scalars:
        """Scalars that the family gives, from the rows of the case."""

    def judge(self, rows: Rows, moved: bool) -> Verdict:
        """The verdict of a case that ended without a collision; ``moved``: the ego has moved,
        perhaps between two rows only."""


class ObservesTogether(Protocol):
    """A run whose class takes the next places of many runs in one call; a class that extends it has
    to say so anew."""

    @classmethod
    def observe_together(cls, runs: Sequence[Self], x_m: np.ndarray, y_m: np.ndarray) -> None:
        """:meth:`ScenarioRun.observe` of all ``runs``, one place each, world [runs] [m]; to the bit
        what one call for each does."""


@runtime_checkable
class TellsEvents(Protocol):
    """A run that knows what happened before."""

    def before_end(self, rows: Rows) -> list[str]:
        """What happened before the end of a case, short sentences for a verdict's reasons."""


@dataclass(frozen=True, slots=True)
class FirstContact:
    """The first collision of a case."""

    time_s: float
    """Sim time [s]."""
    speed_mps: float
    """Speed of the ego [m/s]."""
    thing: Thing | None
    """What it hit; None: it is not known."""


@runtime_checkable
class HoldsTrial(Protocol):
    """A run that may be a trial: it also concludes cases with a collision, from the rows and the
    collision alone, so that the judge comes to the same."""

    def trial_scalars(self, rows: Rows, contact: FirstContact | None) -> Scalars:
        """Scalars of the trial; None where missing, and where the case is none."""

    def trial_verdict(self, rows: Rows, contact: FirstContact | None) -> Verdict | None:
        """The verdict of the trial; None: the case is none."""


class ScenarioFamily(Protocol):
    """A class of runs."""

    def start(self, config: Any, ground: Surroundings) -> tuple[float, float, float]:
        """World x, y [m] and heading [rad] of the ego at the start of a case.

        Raises:
            ValueError: the scene is not fit for it; one line.
        """

    def __call__(self, config: Any, ground: Surroundings, x_m: float, y_m: float) -> ScenarioRun:
        """A case that begins at a place."""
