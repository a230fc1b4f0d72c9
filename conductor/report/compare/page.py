"""A comparison for people: on a terminal, as Markdown for a pull request, and as a page."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from markupsafe import Markup

from conductor.report.analysis.findings import p_text, percent, points
from conductor.report.analysis.statistics import ALPHA, Interval
from conductor.report.compare.comparison import AxisLine, Comparison, Flip, Shift
from conductor.report.pages.result_page import escaped
from conductor.report.pages.templates import ASSETS, environment
from schemas.words import counted

FLIPS_MAX = 500
"""Most flips in a table; all are in the JSON output."""
NAMES_MAX = 10
"""Most cases of only one run that are named."""
TEXT_MAX = 300
"""Most characters of a reason."""

_CHANGES = {"worse": "worse", "better": "better", "other": "changed"}


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of texts."""

    title: str
    about: str
    columns: list[str]
    rows: list[list[str]]
    numeric: int
    """Columns from this one on hold numbers."""


@dataclass(frozen=True, slots=True)
class ComparisonWords:
    """A comparison in words."""

    title: str
    result: str
    kind: str
    """``identical``, ``regression`` or ``no regression``."""
    lines: list[str]
    tables: list[TextTable]


def told(found: Comparison) -> ComparisonWords:
    """The comparison in words."""
    kind = "no regression"
    if found.identical:
        kind = "identical"
    elif found.regressions:
        kind = "regression"
    tables = [_runs(found)]
    if found.flips:
        tables.append(_flips(found))
    tables += [TextTable(t.title, t.about, t.columns, t.lines, 1) for t in found.rulebook]
    # Where every case is the same to the last bit there is nothing to tell axes and KPIs apart by.
    if not found.identical:
        if found.axes:
            tables.append(_axes(found.axes))
        if found.shifts:
            tables.append(_shifts(found.shifts))
    title = f"{found.before.folder} and {found.after.folder}"
    return ComparisonWords(title, _result(found, kind), kind, _lines(found), tables)


def _result(comparison: Comparison, kind: str) -> str:
    if kind == "identical":
        return (
            f"identical (bytes): {counted(comparison.pairs, 'case', 'cases')}, "
            f"fingerprint {comparison.after.fingerprint}"
        )
    if kind == "regression":
        many = counted(len(comparison.regressions), "case has", "cases have")
        return f"regression: {many} become worse"
    better = sum(flip.change == "better" for flip in comparison.flips)
    return f"no regression: no case has become worse, {better} better"


def _lines(comparison: Comparison) -> list[str]:
    lines = []
    if not comparison.identical:
        gap = comparison.difference
        lines.append(
            f"Of {counted(comparison.pairs, 'pair', 'pairs')} {comparison.passed_before} passed "
            f"before and {comparison.passed_after} after "
            f"({percent(comparison.passed_before / comparison.pairs)} and "
            f"{percent(comparison.passed_after / comparison.pairs)}): {comparison.lost} lost, "
            f"{comparison.won} won. Difference {_interval(gap, points)} percentage points; "
            f"McNemar's exact test: {p_text(comparison.p_value)}."
        )
        lines.append(
            f"{comparison.same_bytes} of {counted(comparison.pairs, 'pair', 'pairs')} are the same "
            "to the last bit."
        )
        hit = [line for line in comparison.axes if line.p_value < ALPHA]
        lines += [
            f"{line.label.partition(' [')[0]} {_words(line.value)}: {line.passed_before} of "
            f"{line.pairs} passed before, {line.passed_after} after (corrected "
            f"{p_text(line.p_value)})."
            for line in hit
        ]
    for names, where in ((comparison.only_before, "first"), (comparison.only_after, "second")):
        if names:
            more = f" and {len(names) - NAMES_MAX} more" if len(names) > NAMES_MAX else ""
            lines.append(
                f"{counted(len(names), 'case', 'cases')} only in the {where} run, not compared: "
                f"{', '.join(names[:NAMES_MAX])}{more}."
            )
    return lines + [f"Note: {note}." for note in comparison.notes]


def _runs(comparison: Comparison) -> TextTable:
    sides = (comparison.before, comparison.after)
    rows = [
        ["folder", *(side.folder for side in sides)],
        ["campaign", *(side.campaign for side in sides)],
        ["passed", *(f"{side.passed} of {side.cases}" for side in sides)],
        ["no collision", *(f"{side.no_collision} of {side.cases}" for side in sides)],
        ["fingerprint", *(side.fingerprint for side in sides)],
        ["software", *(side.software or "none" for side in sides)],
        ["stack", *("none" if s.stack is None else s.stack or "shipped" for s in sides)],
        ["device class", *(", ".join(side.device_classes or []) or "none" for side in sides)],
    ]
    # Imported logs have neither software nor device: absent is absent.
    rows = [row for row in rows if any(cell != "none" for cell in row[1:])]
    return TextTable("Runs", "", ["", "before", "after"], rows, 3)


def _flips(comparison: Comparison) -> TextTable:
    def line(flip: Flip) -> list[str]:
        reason = "; ".join(flip.reasons)
        short = reason if len(reason) <= TEXT_MAX else reason[: TEXT_MAX - 1] + "…"
        change = _CHANGES[flip.change]
        return [flip.case, change, _words(flip.before), _words(flip.after), short]

    more = len(comparison.flips) - FLIPS_MAX
    return TextTable(
        "Verdicts that changed",
        f"The first {FLIPS_MAX}; {more} more." if more > 0 else "",
        ["case", "change", "before", "after", "reason after"],
        [line(flip) for flip in comparison.flips[:FLIPS_MAX]],
        5,
    )


def _axes(lines: list[AxisLine]) -> TextTable:
    return TextTable(
        "Passed, by axis",
        "Differences in percentage points, after less before, with 95 % intervals; p-values of "
        "McNemar's exact test, corrected for the number of lines (Holm).",
        ["axis", "value", "pairs", "before", "after", "difference", "p"],
        [
            [
                line.label.partition(" [")[0],
                _words(line.value),
                str(line.pairs),
                str(line.passed_before),
                str(line.passed_after),
                _interval(line.difference, points),
                p_text(line.p_value).removeprefix("p = ").removeprefix("p "),
            ]
            for line in lines
        ],
        2,
    )


def _shifts(shifts: list[Shift]) -> TextTable:
    return TextTable(
        "KPIs",
        "Differences of the same case, after less before, with 95 % intervals (median: sign test, "
        "mean: Student). Only in one run: cases that have the KPI there and not in the other.",
        [
            *("KPI", "pairs", "changed", "median", "mean", "largest"),
            *("case", "only before", "only after"),
        ],
        [
            [
                shift.label,
                str(shift.pairs),
                str(shift.changed),
                "–" if shift.median is None else _interval(shift.median, _signed),
                "–" if shift.mean is None else _interval(shift.mean, _signed),
                "–" if shift.largest is None else _signed(shift.largest),
                shift.largest_case or "–",
                str(shift.lost),
                str(shift.gained),
            ]
            for shift in shifts
        ],
        1,
    )


def _interval(interval: Interval, shown: Callable[[float], str]) -> str:
    if not math.isfinite(interval.low):
        return f"{shown(interval.estimate)} (too few for an interval)"
    return f"{shown(interval.estimate)} ({shown(interval.low)} to {shown(interval.high)})"


def _signed(value: float) -> str:
    return "0" if value == 0.0 else f"{value:+.3g}"


def _words(text: str) -> str:
    return text.replace("_", " ")


def as_markdown(found: Comparison) -> str:
    """Comparison as Markdown, for a pull request."""
    jinja = environment(autoescape=False)
    jinja.filters["md"] = escaped
    text: str = jinja.get_template("compare.md.j2").render(told=told(found))
    return text.strip() + "\n"


def as_html(found: Comparison) -> str:
    """Comparison as a page of its own; needs neither scripts nor a network."""
    style = Markup((ASSETS / "page.css").read_text(encoding="utf-8"))
    template = environment(autoescape=True).get_template("compare.html.j2")
    page: str = template.render(told=told(found), style=style)
    return page


def as_json(found: Comparison) -> dict[str, Any]:
    """Comparison as plain data, for programs; an interval that has no bounds has none."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: plain(item) for name, item in value.items()}
        if isinstance(value, list):
            return [plain(item) for item in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    words = told(found)
    return {"result": words.kind, "says": [words.result, *words.lines], **plain(asdict(found))}
