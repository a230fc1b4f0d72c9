"""Runs of one campaign with a page of the console and without, in turns -> what the page costs.

Each run has its partner beside it in time, so what the machine does else is much the same for both;
of the ratios of all pairs the median counts, which a run that was disturbed does not move. Three
yardsticks: cases per minute, wall time of the rigs case by case (without the start and the end of
workers), and processor time of all processes of the campaign and of the console together.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from viewer.bench.compare import CampaignRun, lag_of

MODES = ("alone", "console")
"""With a console and a page of it, and with neither; both show themselves to whoever asks."""
SHARE_MIN = 0.98
"""Target: cases per minute with a page, of those without [-]."""
CONSOLE = "console"
"""Its own part in what a page costs."""
NAMES = {
    "cases_per_min": "cases per minute",
    "rig_wall": "speed of the rigs, case by case",
    "cpu": "cases per processor second, the console's included",
}


@dataclass(frozen=True, slots=True)
class Pair:
    """Two runs, one after the other."""

    alone: CampaignRun
    console: CampaignRun


def compare(found: Sequence[Pair]) -> dict[str, Any]:
    """What the page costs: of each yardstick the share that is left, 1: nothing is lost."""
    runs = [run for pair in found for run in (pair.alone, pair.console)]
    looked = [pair.console.looked for pair in found if pair.console.looked is not None]
    return {
        "pairs": len(found),
        "cases": found[0].alone.cases,
        "share": {
            "cases_per_min": _share([_rate(p.console) / _rate(p.alone) for p in found]),
            "rig_wall": _share([one for pair in found for one in _case_ratio(pair)]),
            "cpu": _share([_load(p.alone) / _load(p.console) for p in found]),
        },
        "cases_per_min": _both(found, _rate),
        "cpu_s_per_case": _both(found, _load),
        "cpu_more_s_per_case": _more(found),
        "console_cpu_share": round(statistics.median(seen.cpu_share for seen in looked), 4),
        "pictures": sum(seen.pictures for seen in looked),
        **lag_of([lag_s for seen in looked for lag_s in seen.lags_s]),
        "same_results": len({run.fingerprint for run in runs}) == 1,
    }


def misses(found: dict[str, Any]) -> list[str]:
    """A line per target that was missed by more than the noise."""
    missed = [
        f"a page costs too much: {_words(name, share)}, at least {SHARE_MIN:.0%}"
        for name, share in found["share"].items()
        if share["median"] + share["noise"] < SHARE_MIN
    ]
    if not found["pictures"]:
        missed.append("a campaign with a page: the page was given no picture")
    if not found["same_results"]:
        missed.append("the results differ with and without a page")
    return missed


def lines(found: dict[str, Any]) -> list[str]:
    """Lines for people."""
    rates, loads = found["cases_per_min"], found["cpu_s_per_case"]
    told = [_words(name, share) for name, share in found["share"].items()]
    told += [
        f"medians of {found['cases']} cases: {rates['console']} cases/min with a page, "
        f"{rates['alone']} without; {loads['console']} and {loads['alone']} processor seconds per "
        f"case, the console's included: {found['console_cpu_share']:.1%} of a core",
        f"processor time per case, more with a page than without: {_parts(found)}",
        lag_line(found),
        f"results {'the same' if found['same_results'] else 'DIFFER'}",
    ]
    unsure = [
        name
        for name, share in found["share"].items()
        if share["median"] - share["noise"] < SHARE_MIN
    ]
    if len(unsure) == len(found["share"]) and not misses(found):
        told.append(f"at least {SHARE_MIN:.0%} is not shown, the noise is too large")
    return told


def lag_line(found: dict[str, Any]) -> str:
    """How far pictures lag, for people."""
    if found["lag_max_s"] is None:
        return "how far pictures lag behind the simulators is not known"
    return (
        f"pictures at most {found['lag_max_s']} s behind the simulators, "
        f"mostly {found['lag_median_s']} s"
    )


def _share(ratios: Sequence[float]) -> dict[str, float]:
    """Median, and how far off it may be: half the notch of a box plot, 1.57 times the range of the
    middle half over the root of the count (McGill, Tukey, Larsen 1978). A single ratio says
    nothing."""
    median = statistics.median(ratios)
    if len(ratios) < 3:
        return {"median": round(median, 4), "noise": 1.0, "of": len(ratios)}
    low, _, high = statistics.quantiles(ratios, n=4, method="inclusive")
    noise = 1.57 * (high - low) / math.sqrt(len(ratios))
    return {"median": round(median, 4), "noise": round(noise, 4), "of": len(ratios)}


def _rate(run: CampaignRun) -> float:
    return 60 * run.measured.cases / run.measured.wall_s


def _load(run: CampaignRun) -> float:
    """Processor time per case of the campaign, and of the console on the same host [s]."""
    measured, share = run.measured, 0.0 if run.looked is None else run.looked.cpu_share
    return (measured.cpu_s + share * measured.wall_s) / measured.cases


def _case_ratio(pair: Pair) -> list[float]:
    """Speed of a case with a page, relative to the same case without: the median of the cases,
    since what the machine did beside hit all of a run. Empty: no case was timed in both runs."""
    alone, console = pair.alone.rig_wall_s, pair.console.rig_wall_s
    timed = [case for case in sorted(alone) if alone[case] and console.get(case)]
    return [statistics.median(alone[case] / console[case] for case in timed)] if timed else []


def _both(found: Sequence[Pair], measure: Any) -> dict[str, float]:
    return {
        "console": round(statistics.median(measure(pair.console) for pair in found), 3),
        "alone": round(statistics.median(measure(pair.alone) for pair in found), 3),
    }


def _more(found: Sequence[Pair]) -> dict[str, float]:
    """Processor time per case that each part takes more with a page than without: medians of the
    pairs [s]. The console's own is among them; the page is a browser's, on another machine."""

    def used_s(run: CampaignRun, part: str) -> float:
        if part == CONSOLE:
            return 0.0 if run.looked is None else run.looked.cpu_share * run.measured.wall_s
        return run.measured.parts_s.get(part, 0.0)

    def per_case_s(run: CampaignRun, part: str) -> float:
        return used_s(run, part) / run.measured.cases

    parts = {
        part
        for pair in found
        for run in (pair.alone, pair.console)
        for part in run.measured.parts_s
    }
    return {
        part: round(
            statistics.median(
                per_case_s(p.console, part) - per_case_s(p.alone, part) for p in found
            ),
            4,
        )
        for part in [*sorted(parts), CONSOLE]
    }


def _parts(found: dict[str, Any]) -> str:
    more = found["cpu_more_s_per_case"]
    return ", ".join(f"{part} {1000 * more_s:+.0f} ms" for part, more_s in more.items())


def _words(name: str, share: dict[str, float]) -> str:
    off = share["noise"]
    sure = f"within {off:.1%}" if off < 1.0 else "too few to be sure"
    return f"{NAMES[name]}: {share['median']:.1%} of those without a page ({sure})"
