"""How often the intervals of samplers cover the truth, on closed forms.

``PYTHONPATH=tests python tests/search_coverage.py [--seeds 1000] [--only importance]`` prints three
tables: searches of a fixed size, searches that their interval stops (the share of the probability
is in the row), and the cases that a relative error of 10 % takes, against those of Monte Carlo.

A row has: of how many seeds the 95 % interval covers, lies above the truth (``high``) and below it
(``low``), of how many there was none; the mean of the estimates over the truth, their relative
error, and half of the median interval over the estimate; cases; and how many times more of them
Monte Carlo needs for the same error.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import numpy as np
from search_forms import Form, Settings, four_branches, plane, search, series, sphere

COMMON = plane(0.0668072, 2)
RARE = (
    plane(1e-3, 2),
    four_branches(),
    series(1e-4, 5),
    plane(1e-4, 10),
    sphere(1e-4, 10),
    plane(1e-5, 4),
    plane(1e-6, 4),
)
SPREAD = ("monte_carlo", "latin_hypercube", "sobol")
LEVEL = {"level": 1000}
ERROR = 0.1
"""Relative error of the gains."""

Row = tuple[Form, Settings]
FIXED: tuple[Row, ...] = (
    *((COMMON, Settings(name, 1024, 64)) for name in SPREAD),
    *((form, Settings("importance", 4000, 500)) for form in RARE),
    *((form, Settings("subset", 10_000, 50, LEVEL)) for form in RARE),
)
STOPPED: tuple[Row, ...] = (
    *((COMMON, Settings(name, 10_000, 64, relative=0.1)) for name in SPREAD),
    *((form, Settings("importance", 10_000, 500, relative=0.1)) for form in RARE),
    *((form, Settings("subset", 10_000, 50, LEVEL, relative=0.4)) for form in RARE[:5]),
)
GAINS: tuple[Row, ...] = tuple(
    (form, Settings("importance", 10_000, 500, relative=1.96 * ERROR)) for form in RARE
)


def coverage(form: Form, settings: Settings, seeds: int) -> str:
    """One line of the first two tables."""
    answers = [search(form, settings, seed) for seed in range(seeds)]
    low, high, estimates = (
        np.array([np.nan if value is None else value for value in values], np.float64)
        for values in zip(
            *((e.low, e.high, e.probability) for e, _ in answers),
            strict=True,
        )
    )
    told = ~np.isnan(low)
    low, high, ratio = low[told], high[told], estimates[told] / form.truth
    above, below = int(np.sum(low > form.truth)), int(np.sum(high < form.truth))
    cases = float(np.mean([answer.cases for answer in answers]))
    error = math.sqrt(float(np.mean((ratio - 1.0) ** 2)))
    half = float(np.median((high - low) / (2 * np.maximum(estimates[told], 1e-300))))
    gain = (1 - form.truth) / form.truth / error**2 / cases
    return (
        f"| {form.name}{stop(settings)} | `{settings.sampler}` | {len(low) - above - below} "
        f"| {above} | {below} | {seeds - len(low)} | {np.mean(ratio):.3f} | {error:.3f} "
        f"| {half:.3f} | {cases:.0f} | {gain:,.1f} |"
    )


def stop(settings: Settings) -> str:
    """What stops a search, for the first column."""
    return "" if settings.relative is None else f", stops at {settings.relative:.3g}"


def gained(form: Form, settings: Settings, seeds: int) -> str:
    """One line of the third table."""
    answers = [search(form, settings, seed) for seed in range(seeds)]
    ratio = np.array([e.probability or 0.0 for e, _ in answers]) / form.truth
    cases = float(np.mean([answer.cases for answer in answers]))
    chance = (1 - form.truth) / form.truth / ERROR**2
    error = math.sqrt(float(np.mean((ratio - 1.0) ** 2)))
    return (
        f"| {form.name} | `{settings.sampler}` | {error:.3f} | {cases:.0f} | {chance:,.0f} "
        f"| {chance / cases:,.0f} |"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--only", default="", help="name of a sampler")
    parser.add_argument("--table", default="", help="fixed, stopped or gains")
    parser.add_argument("--form", default="", help="how the name of a limit state begins")
    given = parser.parse_args()
    first = "limit state, parameters | sampler"
    wide = f"| {first} | covers | above | below | none | mean | error | half | cases | gain |"
    narrow = f"| {first} | relative error | cases | of Monte Carlo | times fewer |"
    tables: dict[str, tuple[str, tuple[Row, ...], Callable[[Form, Settings, int], str], int]] = {
        "fixed": (wide, FIXED, coverage, given.seeds),
        "stopped": (wide, STOPPED, coverage, given.seeds),
        "gains": (narrow, GAINS, gained, min(20, given.seeds)),
    }
    for name, (heads, rows, line, seeds) in tables.items():
        if given.table in ("", name):
            print(
                f"\n{name}, seeds 0 to {seeds - 1}\n\n{heads}\n|{'---|' * (heads.count('|') - 1)}"
            )
            for form, settings in rows:
                asked = given.only in ("", settings.sampler)
                if asked and form.name.startswith(given.form):
                    print(line(form, settings, seeds), flush=True)


if __name__ == "__main__":
    main()
