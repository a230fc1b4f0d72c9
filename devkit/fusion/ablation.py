"""The table of docs/ablation.md: verdicts by set of sensors and weather, of a finished run.

``python -m devkit.fusion.ablation runs/aeb-ablation --page docs/ablation.md`` replaces what stands
between the page's two markers.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from schemas.names import WEATHERS
from twin.base.errors import TwinError
from twin.records.campaign_file import read_plan

AXIS = "autonomy.parameters.sensors_used"
BEGIN, END = "<!-- table -->", "<!-- end of table -->"
DISTANCE = "dtc_end_m"
"""Scalar of a case: distance at which the car came to rest [m]."""


@dataclass(frozen=True, slots=True)
class AblationCase:
    """What counts of a case."""

    sensors: str
    weather: str
    passed: bool
    status: str
    rest_m: float | None


def read_cases(run: Path) -> list[AblationCase]:
    """The ended cases of a run's folder, in the campaign's order.

    Raises:
        InfrastructureError: its campaign file is damaged.
        OSError: there is no run.
    """
    outcomes = msgspec.json.decode((run / "outcomes.json").read_bytes())["cases"]
    plan = read_plan(run / "campaign.yaml")
    cases = []
    for point, case in zip(plan.points, plan.cases, strict=True):
        end = outcomes.get(case.id, {})
        if not end.get("verdict"):
            continue
        sensors = str(point.parameters.get("sensors_used", "all"))
        weather = case.variation.weather
        rest_m = end["scalars"].get(DISTANCE)
        cases.append(AblationCase(sensors, weather, bool(end["passed"]), end["verdict"], rest_m))
    return cases


def table(cases: Sequence[AblationCase]) -> list[str]:
    """Lines of the table: weathers down, sets of sensors across, in the order of the cases.

    A cell says how many of its cases passed, what the others were, and the median distance of all
    cars that came to rest.
    """
    sets = list(dict.fromkeys(case.sensors for case in cases))
    weathers = [name for name in WEATHERS if any(case.weather == name for case in cases)]
    lines = ["| weather | " + " | ".join(sets) + " |", "|---|" + "---|" * len(sets)]
    for weather in (*weathers, "all"):
        cells = []
        for name in sets:
            here = [c for c in cases if c.sensors == name and weather in (c.weather, "all")]
            cells.append(_cell(here))
        lines.append(f"| {weather.replace('_', ' ')} | " + " | ".join(cells) + " |")
    return lines


def _cell(cases: Sequence[AblationCase]) -> str:
    if not cases:
        return "–"
    passed = sum(case.passed for case in cases)
    others: dict[str, int] = {}
    for case in cases:
        if not case.passed:
            others[case.status] = others.get(case.status, 0) + 1
    words = [f"{passed} of {len(cases)}"]
    words += [f"{count} {status.replace('_', ' ')}" for status, count in sorted(others.items())]
    rests = [case.rest_m for case in cases if case.rest_m is not None]
    if rests:
        words.append(f"{statistics.median(rests):.1f} m")
    return ", ".join(words)


def with_table(page: str, lines: Sequence[str]) -> str:
    """The page with another table between its markers.

    Raises:
        ValueError: it lacks them.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no {BEGIN} and {END}")
    return "\n".join([before + BEGIN, "", *lines, "", END + after])


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the table into the page."""
    parser = argparse.ArgumentParser(
        prog="python -m devkit.fusion.ablation", description="Table of sensors and weathers."
    )
    parser.add_argument("run", type=Path, help="folder of a finished run of aeb-ablation")
    parser.add_argument("--page", type=Path, help="page to write it into; default: print it")
    options = parser.parse_args(arguments)
    try:
        lines = table(read_cases(options.run))
        if options.page is None:
            print("\n".join(lines))
        else:
            options.page.write_text(with_table(options.page.read_text("utf-8"), lines), "utf-8")
    except (TwinError, OSError, ValueError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
