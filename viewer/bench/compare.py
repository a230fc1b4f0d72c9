"""Runs with and without viewers -> what looking costs, and which targets are missed. No I/O.

Two yardsticks, cases per minute and processor time per case: where all cores are busy they say the
same, and the second one hardly depends on what else a machine does. Other work makes a run slower,
never faster: of several runs the best one says most. How far the two best runs of a mode differ is
its noise. A comparison is no surer than the noisier of its two sides; a target is missed if either
yardstick misses it by more than its noise, and not shown if neither reaches it without.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from twin.base.errors import UsageError

MODES = ("none", "live", "frozen", "console", "record")
"""Modes of a run: nobody looks, a viewer does, it is frozen, a page of the console does, every case
is recorded."""

SHARE_MIN = {"live": 0.95, "frozen": 0.99, "console": 0.98, "record": 0.90}
"""Targets: cases per minute relative to those with nobody [-]."""
RECORDING_MAX_MB = 12.0
"""Target: the largest recording of a case [MB]."""

NAMES = {
    "none": "with nobody",
    "live": "with a viewer",
    "frozen": "with a frozen viewer",
    "console": "with a page of the console",
    "record": "recorded",
}


@dataclass(frozen=True, slots=True)
class CourseSample:
    """A campaign at one moment."""

    cases: int
    """Cases that have ended."""
    at_s: float
    """A clock that does not jump [s]."""
    cpu_s: float
    """Processor time that its processes have used [s]."""
    parts_s: dict[str, float] = field(default_factory=dict)
    """The same by part of the campaign: simulators, stacks, conductor ... [s]."""


@dataclass(frozen=True, slots=True)
class CampaignWindow:
    """A part of a campaign."""

    cases: int
    wall_s: float
    cpu_s: float
    parts_s: dict[str, float] = field(default_factory=dict)
    """Processor time by part of the campaign [s]."""


@dataclass(frozen=True, slots=True)
class LookedOn:
    """What came of a page that looked at a campaign."""

    cpu_share: float
    """Share of a core that the console took, from the first picture on [-]."""
    pictures: int
    lags_s: tuple[float, ...]
    """Of each second, the longest time from the simulator to the page [s]."""


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """One run of a campaign."""

    cases: int
    measured: CampaignWindow
    fingerprint: str
    recordings_mb: tuple[float, ...] = ()
    """Size of each recording [MB]."""
    rig_wall_s: dict[str, float] = field(default_factory=dict)
    """Wall time that each case took of its rig [s]."""
    looked: LookedOn | None = None
    """What came of its page; None: nobody looked."""


def lag_of(lags_s: Sequence[float]) -> dict[str, float | None]:
    """How far pictures lagged behind the simulators, second by second; None: nobody knows."""
    return {
        "lag_max_s": max(lags_s, default=None),
        "lag_median_s": round(statistics.median(lags_s), 3) if lags_s else None,
    }


def window(samples: list[CourseSample], at_once: int) -> CampaignWindow:
    """The middle of a campaign that runs so many cases at once.

    Left out are the first two of each slot, while rigs and recorders start, and then the judge and
    what the report is made of, and the last, while workers have nothing to do: all of it is the
    same for a short campaign as for a long one.
    """
    total = samples[-1].cases if samples else 0
    if total < 2:
        raise UsageError(f"a campaign of {total} cases says nothing; choose one of at least 4")
    begin, end = (max(1, min(edge, total // 4)) for edge in (2 * at_once, at_once))
    first = next(s for s in samples if s.cases >= begin)
    last = next(s for s in samples if s.cases >= total - end)
    if last.cases == first.cases:
        first, last = samples[0], samples[-1]
    return CampaignWindow(
        last.cases - first.cases,
        last.at_s - first.at_s,
        last.cpu_s - first.cpu_s,
        {part: used - first.parts_s.get(part, 0.0) for part, used in last.parts_s.items()},
    )


def compare(runs: dict[str, list[CampaignRun]]) -> dict[str, Any]:
    """What the runs of every mode of :data:`MODES` come to."""
    windows = {mode: [run.measured for run in mode_runs] for mode, mode_runs in runs.items()}
    rates = {
        mode: [60 * w.cases / w.wall_s for w in mode_windows]
        for mode, mode_windows in windows.items()
    }
    loads = {
        mode: [w.cpu_s / w.cases for w in mode_windows] for mode, mode_windows in windows.items()
    }
    thrifts = {mode: [1 / load for load in mode_loads] for mode, mode_loads in loads.items()}
    sizes = [size for run in runs["record"] for size in run.recordings_mb]
    return {
        "cases_per_min": {
            m: _spread(mode_rates, best=max(mode_rates)) for m, mode_rates in rates.items()
        },
        "cpu_s_per_case": {
            m: _spread(mode_loads, best=min(mode_loads)) for m, mode_loads in loads.items()
        },
        "share": {
            mode: {
                "cases_per_min": round(max(rates[mode]) / max(rates["none"]), 4),
                "noise": max(_noise(rates["none"]), _noise(rates[mode])),
                "cpu": round(max(thrifts[mode]) / max(thrifts["none"]), 4),
                "cpu_noise": max(_noise(thrifts["none"]), _noise(thrifts[mode])),
            }
            for mode in SHARE_MIN
        },
        "recordings": len(sizes),
        "recordings_expected": sum(run.cases for run in runs["record"]),
        "recording_mb": round(statistics.mean(sizes), 2) if sizes else None,
        "recording_max_mb": round(max(sizes), 2) if sizes else None,
        "same_results": len({run.fingerprint for mode_runs in runs.values() for run in mode_runs})
        == 1,
    }


def misses(found: dict[str, Any]) -> list[str]:
    """A line per target that was missed."""
    missed = []
    for mode, least in SHARE_MIN.items():
        share = found["share"][mode]
        if (
            share["cases_per_min"] + share["noise"] < least
            or share["cpu"] + share["cpu_noise"] < least
        ):
            missed.append(f"{NAMES[mode]}: {_shares(share)}, at least {least:.0%}")
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


def unclear(found: dict[str, Any]) -> list[str]:
    """A line per target that was not missed, and is reached by neither yardstick."""
    return [
        f"{NAMES[mode]}: at least {least:.0%} is not shown, the noise is too large"
        for mode, least in SHARE_MIN.items()
        if max(found["share"][mode][name] for name in ("cases_per_min", "cpu")) < least
        and not any(line.startswith(f"{NAMES[mode]}:") for line in misses(found))
    ]


def lines(found: dict[str, Any]) -> list[str]:
    """Lines for people."""
    text_lines = []
    for mode in MODES:
        rate, load = found["cases_per_min"][mode], found["cpu_s_per_case"][mode]
        line = (
            f"{NAMES[mode]}: {rate['best']} cases/min ({rate['worst']} to {rate['best']}), "
            f"{load['best']} processor seconds per case ({load['best']} to {load['worst']})"
        )
        if mode in found["share"]:
            line += f"; {_shares(found['share'][mode])}"
        text_lines.append(line)
    if found["recordings"]:
        text_lines.append(
            f"{found['recordings']} recordings, {found['recording_mb']} MB each, the largest "
            f"{found['recording_max_mb']} MB"
        )
    text_lines += unclear(found)
    text_lines.append(f"results {'the same' if found['same_results'] else 'DIFFER'}")
    return text_lines


def _shares(share: dict[str, float]) -> str:
    return (
        f"{share['cases_per_min']:.1%} of the cases per minute (noise {share['noise']:.1%}), "
        f"{share['cpu']:.1%} of those per processor second (noise {share['cpu_noise']:.1%})"
    )


def _spread(values: list[float], *, best: float) -> dict[str, float]:
    worst = max(values) if best == min(values) else min(values)
    middle = statistics.median(values)
    return {"best": round(best, 3), "median": round(middle, 3), "worst": round(worst, 3)}


def _noise(rates: list[float]) -> float:
    """Difference of the two best runs; a single run says nothing, so all of it is noise."""
    if len(rates) < 2:
        return 1.0
    first, second = sorted(rates, reverse=True)[:2]
    return round(first / second - 1, 4)
