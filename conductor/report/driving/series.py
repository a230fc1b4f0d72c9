"""A series of parts of free driving, read from its folder: distances, brakings, what is missing."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.report.analysis.statistics import poisson_interval
from conductor.report.reading.axes import axis_value
from conductor.report.reading.dossier import CaseRow, Dossier, open_dossier
from conductor.report.reading.films import film_addresses
from conductor.serve.folders import CAMPAIGN_FILE
from schemas.files.yaml_file import YamlError, load_yaml
from twin.base.errors import UsageError

LEDGER_FILE = "parts.jsonl"
"""List of all parts that were made, as ``twin driving`` writes it."""
RUN_FOLDER = "run"
"""Campaign folder of a part, inside its own."""
KM = 1000.0
NIGHT = ("20:00", "05:00")
"""From when to when a case counts as driven by night: hours of the shipped campaigns are 13:00 and
23:00."""


@dataclass(frozen=True, slots=True)
class DrivenCase:
    """One case of free driving."""

    part: str
    case: str
    road_class: str
    weather: str
    night: bool
    verdict: str
    """Empty: it has none."""
    driven_m: float
    fast_m: float
    partial: int
    full: bool
    false: bool
    reasons: str
    film: Path | None


@dataclass(frozen=True, slots=True)
class DrivenPart:
    """One part of a series."""

    name: str
    commit: str
    """That froze the stack; empty: the campaign is none of a series."""
    seed: int
    cases: tuple[DrivenCase, ...]
    left: int
    """Cases that have not ended; all, if it has not begun."""
    begun: bool
    software: str = ""
    """Digest of the software that ran it, shipped stacks with it."""


@dataclass(frozen=True, slots=True)
class Sums:
    """Distances and brakings of some cases."""

    cases: int
    driven_m: float
    fast_m: float
    partial: int
    full: int
    false: int

    @property
    def fast_share(self) -> float:
        """Share of the distance that was driven faster than 50 km/h."""
        return self.fast_m / self.driven_m if self.driven_m else 0.0

    def per_1000_km(self, count: float) -> float:
        """A count over the distance, per 1,000 km; infinite where nothing was driven."""
        return count / (self.driven_m / KM / 1000.0) if self.driven_m else math.inf

    def interval(self) -> tuple[float, float]:
        """Exact bounds of false full brakings per 1,000 km at 95 %."""
        low, high = poisson_interval(self.false)
        return self.per_1000_km(low), self.per_1000_km(high)


@dataclass(frozen=True, slots=True)
class Series:
    """All parts, in the order of their list."""

    folder: Path
    parts: tuple[DrivenPart, ...]

    @property
    def cases(self) -> list[DrivenCase]:
        """Cases with a verdict, of all parts."""
        return [case for part in self.parts for case in part.cases if case.verdict]

    @property
    def undecided(self) -> list[DrivenCase]:
        """Cases that ended without a verdict."""
        return [case for part in self.parts for case in part.cases if not case.verdict]

    @property
    def left(self) -> int:
        """Cases that have not ended."""
        return sum(part.left for part in self.parts)

    @property
    def same_software(self) -> bool:
        """Whether all parts that ran did so with the same software."""
        return len({part.software for part in self.parts if part.begun}) <= 1

    def by(self, of: Callable[[DrivenCase], str]) -> dict[str, Sums]:
        """Sums of the groups that a function names, in order of names."""
        names = sorted({of(case) for case in self.cases})
        return {name: sums(c for c in self.cases if of(c) == name) for name in names}


def sums(cases: Iterable[DrivenCase]) -> Sums:
    """Sums over cases; exact ones, so that the order does not matter."""
    rows = list(cases)
    return Sums(
        cases=len(rows),
        driven_m=math.fsum(case.driven_m for case in rows),
        fast_m=math.fsum(case.fast_m for case in rows),
        partial=sum(case.partial for case in rows),
        full=sum(case.full for case in rows),
        false=sum(case.false for case in rows),
    )


def read_series(folder: Path) -> Series:
    """Read the folder of a series, or that of one campaign of free driving.

    Raises:
        UsageError: it holds neither, or a part that is not in its list.
        InfrastructureError: files are damaged.
    """
    if (folder / OUTCOMES_FILE).exists():
        dossier = open_dossier(folder)
        seed = dossier.campaign.seed
        return Series(folder, (_part(folder.name, "", seed, dossier),))
    listed = _listed(folder)
    runs = sorted(path.parent.name for path in folder.glob(f"part-*/{RUN_FOLDER}"))
    strange = set(runs) - {name for name, _, _ in listed}
    if strange:
        raise UsageError(
            f"{folder}: {min(strange)} ran, and {LEDGER_FILE} does not list it; restore the line: "
            "every part that ran counts"
        )
    parts = []
    for name, commit, seed in listed:
        run = folder / name / RUN_FOLDER
        begun = (run / OUTCOMES_FILE).exists()
        part = _part(name, commit, seed, open_dossier(run) if begun else None)
        # Cases that were left out of the run, as by --case, are still to be driven.
        missing = _written(folder / name) - len(part.cases) - part.left
        parts.append(replace(part, left=part.left + max(missing, 0)) if begun else part)
    return Series(folder, tuple(parts))


def _written(part: Path) -> int:
    """Cases that a part was made of.

    Raises:
        UsageError: its campaign cannot be read.
    """
    path = part / CAMPAIGN_FILE
    try:
        return len(load_yaml(path)["cases"])
    except (YamlError, KeyError, TypeError):
        raise UsageError(f"{path}: not as `twin driving` writes it; make the part again") from None


def _listed(folder: Path) -> list[tuple[str, str, int]]:
    """Name, commit and seed of the parts of a list."""
    path = folder / LEDGER_FILE
    try:
        lines = path.read_text().splitlines()
    except OSError:
        raise UsageError(
            f"{folder}: neither a campaign folder nor a series of free driving with {LEDGER_FILE}"
        ) from None
    parts = []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            parts.append((f"part-{int(row['part']):02}", str(row["commit"]), int(row["seed"])))
        except (ValueError, KeyError, TypeError):
            raise UsageError(f"{path}:{number}: not a line of `twin driving`") from None
    return parts


def _part(name: str, commit: str, seed: int, dossier: Dossier | None) -> DrivenPart:
    if dossier is None:
        return DrivenPart(name, commit, seed, (), 0, False)
    films = film_addresses(dossier)
    cases = []
    for row in dossier.rows:
        if row.end.outcome:
            address = films.get(row.case.id)
            cases.append(_case(name, row, dossier.folder / address if address else None))
    software = dossier.outcomes.software
    return DrivenPart(name, commit, seed, tuple(cases), dossier.left, True, software)


def _case(part: str, row: CaseRow, film: Path | None) -> DrivenCase:
    decided = row.end.outcome == "verdict"
    driven_m = row.scalar("driven_m")
    if decided and driven_m is None:
        raise UsageError(f"{part}: case {row.case.id} is no free driving (scenario.free_driving)")
    hour = str(axis_value(row.case, "time_of_day"))
    begins, ends = NIGHT
    return DrivenCase(
        part=part,
        case=row.case.id,
        road_class=road_class(str(axis_value(row.case, "scenario.storyboard"))),
        weather=str(axis_value(row.case, "weather")),
        night=hour >= begins or hour < ends,
        verdict=row.end.verdict if decided else "",
        driven_m=float(driven_m or 0.0),
        fast_m=float(row.scalar("driven_fast_m") or 0.0),
        partial=int(row.scalar("partial_brakings") or 0),
        full=row.scalar("full_braking_s") is not None,
        false=bool(row.scalar("false_brakings")),
        reasons="; ".join(row.end.reasons),
        film=film,
    )


def road_class(storyboard: str) -> str:
    """Class of road of a scenario, by its name: ``motorway-07.yaml`` and ``driving-motorway`` are
    of the class ``motorway``."""
    stem = re.sub(r"\.yaml$", "", storyboard).rpartition("/")[2]
    return re.sub(r"-\d+$", "", stem.removeprefix("driving-"))
