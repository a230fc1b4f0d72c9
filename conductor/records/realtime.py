"""Campaigns that went by the wall clock: what is to be said of them as a whole."""

from __future__ import annotations

from conductor.records.outcomes import Outcomes
from schemas.words import counted


def too_slow(outcomes: Outcomes) -> str:
    """One line if the machines did not keep up; empty: they did, or it was lockstep."""
    runs = [case.realtime for case in outcomes.cases.values() if case.realtime is not None]
    slow = [run for run in runs if not run.kept_up]
    if not slow:
        return ""
    worst = max(slow, key=lambda run: run.overruns / max(1, run.ticks))
    return (
        f"clock realtime: {len(slow)} of {counted(len(runs), 'case')} ran on a machine that was "
        f"too slow; in the worst {worst.overruns} of {worst.ticks} ticks overran: do not trust "
        "them, take fewer workers, smaller pictures or a lower control_hz"
    )
