"""The table of a campaign's cases, in columns; no clock and no files.

A cell without a value is None: missing is never 0. Cases stand in submission order, which is what
``index`` means wherever the console speaks of a case by number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from schemas.kinds.kpi import KpiKind, scalars_by_name
from schemas.kinds.scenario import verdict_kinds
from schemas.names import WEATHERS
from viewer.console.run_folder import CaseEnding

UNITS = {
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_kmh": "km/h",
    "_deg": "deg",
    "_rad": "rad",
    "_ms": "ms",
    "_m": "m",
    "_s": "s",
    "_hz": "Hz",
}
"""Suffix of a name -> its unit."""

TITLES = {
    "model": "Perception model",
    "time_of_day": "Time of day",
    "weather": "Weather",
    "repeat": "Repeat",
    "row": "Row",
}

_SHORT = re.compile(r"\b(aeb|dtc|ttc|rms)\b", re.IGNORECASE)
"""Words that are written in capitals."""
_BETTER = {"less": "low", "more": "high", "": None}


@dataclass(frozen=True, slots=True)
class ConsoleTable:
    """Columns over all cases."""

    cases: list[str]
    axes: list[dict[str, Any]]
    """Axes of the matrix with their values in a reader's order."""
    heads: list[dict[str, Any]]
    """What stands in each column: name, kind, unit, better, title."""
    columns: dict[str, list[Any]]

    def row(self, index: int) -> dict[str, Any]:
        """The cells of one case."""
        return {name: values[index] for name, values in self.columns.items()}

    def changed_rows(self, before: ConsoleTable) -> dict[str, dict[str, Any]]:
        """Cells that differ from an earlier table of the same cases, by index as text."""
        rows: dict[str, dict[str, Any]] = {}
        for name, values in self.columns.items():
            old = before.columns.get(name, [None] * len(values))
            if old == values:
                continue
            for index, value in enumerate(values):
                if index >= len(old) or old[index] != value:
                    rows.setdefault(str(index), {})[name] = value
        return rows


def console_table(
    endings: Mapping[str, CaseEnding],
    axes_of: Mapping[str, Mapping[str, Any]],
    running: frozenset[str] = frozenset(),
) -> ConsoleTable:
    """The table of all cases.

    Args:
        endings: how each case ended, in submission order.
        axes_of: values of its axes by case; a case may be missing.
        running: cases that a worker has now.
    """
    rows = list(endings.values())
    cases = list(endings)
    columns: dict[str, list[Any]] = {
        "state": [_state(name, row, running) for name, row in endings.items()],
        "verdict": [row.status or None for row in rows],
    }
    heads = [
        _head("state", "text", title="State"),
        _head("verdict", "verdict", title="Verdict"),
    ]
    names = list(dict.fromkeys(name for axes in axes_of.values() for name in axes))
    axes = []
    for name in names:
        values = [_plain(axes_of.get(case, {}).get(name)) for case in cases]
        distinct = _ordered(name, values)
        if len(distinct) < 2 and name not in ("model", "weather", "time_of_day"):
            continue
        column = name if name not in columns else f"axis.{name}"
        columns[column] = values
        heads.append(_head(column, "axis", unit_of(name), title=title_of(name)))
        axes.append({"name": column, "title": title_of(name), "values": distinct})
    for kind in kpis_of(rows):
        columns[kind.name] = [_plain(row.scalars.get(kind.name)) for row in rows]
        title = kind.label.partition(" [")[0] or title_of(kind.name)
        heads.append(_head(kind.name, "kpi", kind.unit, _BETTER[kind.better], title))
    for name in dict.fromkeys(name for row in rows for name in row.names):
        columns[name] = [row.names.get(name) for row in rows]
        heads.append(_head(name, "text", title=title_of(name)))
    columns["reason"] = [row.reasons[0] if row.reasons else None for row in rows]
    columns["attempts"] = [row.attempts for row in rows]
    columns["wall_s"] = [_plain(row.wall_s) if row.attempt else None for row in rows]
    columns["worker"] = [row.worker or None for row in rows]
    heads += [
        _head("reason", "text", title="Reason"),
        _head("attempts", "number", title="Attempts"),
        _head("wall_s", "number", "s", title="Wall time"),
        _head("worker", "text", title="Worker"),
    ]
    return ConsoleTable(cases, axes, heads, columns)


def kpis_of(rows: Sequence[CaseEnding]) -> list[KpiKind]:
    """Scalars that some case has a value of, those that are declared, in the order of files."""
    had = {name for row in rows for name, value in row.scalars.items() if value is not None}
    known = scalars_by_name()
    return [
        *(kind for kind in known.values() if kind.name in had),
        *(
            KpiKind(name=name, place="scalar", type="float64", unit=unit_of(name))
            for name in sorted(had - set(known))
        ),
    ]


def verdict_words() -> list[dict[str, Any]]:
    """Every verdict and outcome with its looks: ``rank`` small is worse."""
    words = [
        {
            "name": kind.name,
            "tone": kind.tone,
            "color": kind.color,
            "symbol": kind.symbol,
            "passes": kind.passes,
            "rank": kind.rank,
        }
        for kind in verdict_kinds()
    ]
    bad = [
        ("failed", "#7A3E9D", "!"),
        ("unresolved", "#555555", "?"),
        ("cancelled", "#999999", "–"),
    ]
    return words + [
        {"name": name, "tone": "none", "color": color, "symbol": symbol, "passes": False, "rank": 6}
        for name, color, symbol in bad
    ]


def unit_of(name: str) -> str:
    """Unit that a name ends in; empty: in none."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def title_of(name: str) -> str:
    """Name for people, without its unit: ``scenario.ego_start_m`` -> ``Ego start``,
    ``nearest_ttc_s`` -> ``Nearest TTC``."""
    if name in TITLES:
        return TITLES[name]
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), "")
    bare = re.sub("[_.]", " ", name.removesuffix(suffix).split(".", 1)[-1]).strip().capitalize()
    return _SHORT.sub(lambda found: found[0].upper(), bare) or name


def _head(
    name: str, kind: str, unit: str = "", better: str | None = None, title: str = ""
) -> dict[str, Any]:
    return {"name": name, "kind": kind, "unit": unit, "better": better, "title": title}


def _state(name: str, row: CaseEnding, running: frozenset[str]) -> str:
    if row.outcome:
        return "ended"
    return "running" if name in running else "waiting"


def _ordered(name: str, values: Sequence[Any]) -> list[Any]:
    """Distinct values: weathers from clear to snow, numbers and times ascending, others as they
    come."""
    distinct = [value for value in dict.fromkeys(values) if value is not None]
    if name == "weather":
        order = {word: place for place, word in enumerate(WEATHERS)}
        return sorted(distinct, key=lambda word: order.get(word, len(order)))
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in distinct)
    return sorted(distinct) if numbers or name == "time_of_day" else distinct


def _plain(value: Any) -> Any:
    """A value as JSON has it: a number that is none is missing."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, int | str):
        return value
    return str(value)
