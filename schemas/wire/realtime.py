"""How an attempt went that ran by the wall clock: the age of its commands, and what came late."""

from __future__ import annotations

from msgspec import Struct

from schemas.wire.bounds import Ticks

OVERRUN_SHARE_MAX = 0.01
"""A machine on which a larger share of the ticks overran did not keep up."""


class Realtime(Struct, frozen=True):
    """The pace of one attempt of ``clock: realtime``; never part of a KPI's digest.

    The age of a command is the sim time between the oldest reading that it was first to answer and
    the tick at which it acts; it grows while the command is held.
    """

    ticks: Ticks
    """Control ticks."""
    overruns: Ticks
    """Ticks that began late, because the one before took longer than its period."""
    dropped: Ticks
    """Ticks whose readings the stack did not get, because it was busy with earlier ones."""
    age_p50_ms: float | None
    """Median age of the commands in force; None: the case ended at its first tick [ms]."""
    age_p99_ms: float | None
    age_max_ms: float | None
    factor: float
    """Sim time per wall time; 1: real time."""

    @property
    def kept_up(self) -> bool:
        """Hardly a tick overran."""
        return self.overruns <= OVERRUN_SHARE_MAX * self.ticks

    def told(self) -> str:
        """One line for people."""
        ages = "no command was held"
        if self.age_max_ms is not None:
            ages = (
                f"command age {self.age_p50_ms:g} ms (median), {self.age_p99_ms:g} ms (99 %), "
                f"{self.age_max_ms:g} ms (largest)"
            )
        line = (
            f"clock realtime, not repeatable: {ages}; {self.dropped} of {self.ticks} ticks "
            f"dropped by the stack, real time factor {self.factor:.3f}"
        )
        return line if self.kept_up else f"{line}; {self.warning()}"

    def warning(self) -> str:
        """Warning about a machine that did not keep up."""
        share = 100.0 * self.overruns / max(1, self.ticks)
        return f"{share:.1f} % of the ticks overran: the machine was too slow, do not trust it"
