"""Lengths of cases in an earlier run, and what a run says of its end and its slots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from conductor.records.outcomes import Outcomes, read_outcomes
from schemas.words import counted
from twin.base.errors import TwinError, UsageError


def earlier_lengths(folder: Path | None) -> dict[str, float]:
    """Simulated time of the cases of an earlier run by name [s]; ``folder`` None: of none.

    Raises:
        UsageError: there is no such run, or it has no case that simulated anything.
    """
    if folder is None:
        return {}
    try:
        outcomes = read_outcomes(folder)
    except TwinError as error:
        raise UsageError(f"--history: {error}; give the folder of an earlier run") from None
    lengths = {
        name: float(length)
        for name, case in outcomes.cases.items()
        if (length := case.scalars.get("sim_time_s")) is not None
    }
    if not lengths:
        raise UsageError(f"--history {folder}: no case of it has an end; give another run")
    return lengths


def history_line(folder: Path | None, lengths_s: Mapping[str, float], cases: Iterable[str]) -> str:
    """How many cases of a run an earlier one knows, in words; empty: no earlier one was given."""
    if folder is None:
        return ""
    names = list(cases)
    known = sum(name in lengths_s for name in names)
    line = f"history: {folder} knows {known} of {counted(len(names), 'case')}"
    return line + ("; the others begin as in the file" if known < len(names) else "")


def slots_in_use(outcomes: Outcomes) -> float | None:
    """Slots of a worker that had a case, on average over the time of the workers' loops.

    A rig's time is divided evenly among the cases that are in its slots, so the time that cases
    spent there over the time that is theirs is the mean number of them. None: nothing is known.
    """
    cases = [case for case in outcomes.cases.values() if case.rig_wall_s > 0.0]
    loops_s = sum(case.rig_wall_s for case in cases)
    return sum(case.wall_s for case in cases) / loops_s if loops_s else None


def use_line(outcomes: Outcomes, slots: int) -> str:
    """How many of a worker's slots were in use, in words; empty: it has one, or nothing is known.

    Args:
        outcomes: of the run.
        slots: of each worker; 0: they are others' workers.
    """
    used = slots_in_use(outcomes)
    if used is None or slots < 2:
        return ""
    return f"slots: {used:.1f} of {slots} in use on average ({min(used / slots, 1.0):.0%})"


def all_ended(folder: Path, cases: int) -> str:
    """The line of a run that finds nothing to do."""
    ended = "its case has" if cases == 1 else f"all {cases} cases have"
    return f"{folder}: {ended} ended already"
