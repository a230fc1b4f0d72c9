"""Runs with and without viewers -> what looking costs, and which targets are missed. No I/O.

Other work on a machine makes a run slower, never faster: of several runs the best one says most.
How far the two best runs of a mode differ is its noise. A comparison is no surer than the noisier
of its two sides, and a target is missed only by more than that.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any

MODES = ("none", "live", "frozen", "record")
"""Nobody looks; a viewer does; it is frozen; every case is recorded."""

SHARE_MIN = {"live": 0.95, "frozen": 0.99, "record": 0.90}
"""Targets: cases per minute relative to those with nobody [-]."""
RECORDING_MAX_MB = 12.0
"""Target: the largest recording of a case [MB]."""

NAMES = {
    "none": "with nobody",
    "live": "with a viewer",
    "frozen": "with a frozen viewer",
    "record": "recorded",
}


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a campaign."""

    cases: int
    wall_s: float
    """Wall time from the first lease to the last result: start and report are the same for a long
    campaign as for a short one [s]."""
    cpu_s: float
    """Processor time of all its processes, start and report included [s]."""
    fingerprint: str
    recordings_mb: tuple[float, ...] = ()
    """Size of each recording [MB]."""


def compare(runs: dict[str, list[Run]]) -> dict[str, Any]:
    """What the runs of every mode of :data:`MODES` come to."""
    rates = {mode: [60 * run.cases / run.wall_s for run in found] for mode, found in runs.items()}
    loads = {mode: [run.cpu_s / run.cases for run in found] for mode, found in runs.items()}
    sizes = [size for run in runs["record"] for size in run.recordings_mb]
    return {
        "cases_per_min": {m: _spread(found, best=max(found)) for m, found in rates.items()},
        "cpu_s_per_case": {m: _spread(found, best=min(found)) for m, found in loads.items()},
        "share": {
            mode: {
                "cases_per_min": round(max(rates[mode]) / max(rates["none"]), 4),
                "noise": max(_noise(rates["none"]), _noise(rates[mode])),
                "cpu": round(min(loads["none"]) / min(loads[mode]), 4),
            }
            for mode in SHARE_MIN
        },
        "recordings": len(sizes),
        "recordings_expected": sum(run.cases for run in runs["record"]),
        "recording_mb": round(statistics.mean(sizes), 2) if sizes else None,
        "recording_max_mb": round(max(sizes), 2) if sizes else None,
        "same_results": len({run.fingerprint for found in runs.values() for run in found}) == 1,
    }


def misses(found: dict[str, Any]) -> list[str]:
    """A line per target that was missed; processor time is for information."""
    missed = []
    for mode, least in SHARE_MIN.items():
        share, noise = (found["share"][mode][name] for name in ("cases_per_min", "noise"))
        if share + noise < least:
            missed.append(
                f"{NAMES[mode]}: {share:.1%} of the cases per minute (noise {noise:.1%}), "
                f"at least {least:.0%}"
            )
    largest = found["recording_max_mb"]
    if largest is not None and largest > RECORDING_MAX_MB:
        missed.append(f"recorded: {largest} MB a case, at most {RECORDING_MAX_MB:g}")
    if found["recordings"] != found["recordings_expected"]:
        missed.append(
            f"recorded: {found['recordings']} recordings of {found['recordings_expected']} cases"
        )
    if not found["same_results"]:
        missed.append("the results differ between the modes")
    return missed


def lines(found: dict[str, Any]) -> list[str]:
    """For people."""
    told = []
    for mode in MODES:
        rate, load = found["cases_per_min"][mode], found["cpu_s_per_case"][mode]
        line = (
            f"{NAMES[mode]}: {rate['best']} cases/min ({rate['worst']} to {rate['best']}), "
            f"{load['best']} processor seconds per case ({load['best']} to {load['worst']})"
        )
        if mode in found["share"]:
            share = found["share"][mode]
            rates = f"{share['cases_per_min']:.1%} (noise {share['noise']:.1%})"
            line += f"; {rates} and {share['cpu']:.1%}"
        told.append(line)
    if found["recordings"]:
        told.append(
            f"{found['recordings']} recordings, {found['recording_mb']} MB each, the largest "
            f"{found['recording_max_mb']} MB"
        )
    told.append(f"results {'the same' if found['same_results'] else 'DIFFER'}")
    return told


def _spread(values: list[float], *, best: float) -> dict[str, float]:
    worst = max(values) if best == min(values) else min(values)
    middle = statistics.median(values)
    return {"best": round(best, 3), "median": round(middle, 3), "worst": round(worst, 3)}


def _noise(rates: list[float]) -> float:
    """How far the two best runs differ; a single run says nothing, so all of it is noise."""
    if len(rates) < 2:
        return 1.0
    first, second = sorted(rates, reverse=True)[:2]
    return round(first / second - 1, 4)
