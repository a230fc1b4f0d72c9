"""What a case is and came to, as Markdown."""

from __future__ import annotations

from schemas.kinds.kpi import scalars_by_name
from schemas.wire.view import CaseEnd, CaseStart, clock


def running_text(start: CaseStart, hand: str = "") -> str:
    """Text while the case runs, and for ever if its recorder is killed; ``hand``: the intervention
    in it."""
    state = f"RUNNING, {hand.upper()}" if hand else "RUNNING"
    return f"**{state}**\n\n{_what(start)}\n"


def ended_text(start: CaseStart, end: CaseEnd | None, lost: int) -> str:
    """The verdict, its reasons and the scalars; ``lost``: samples missing in the recording."""
    name = (end.verdict or end.outcome) if end is not None else ""
    title = name.replace("_", " ").upper() or "NO VERDICT"
    reasons = "; ".join(end.reasons) if end is not None else "the attempt's end is missing"
    paragraphs = [f"**{title}** {reasons}".strip()]
    if end is not None and end.scalars:
        paragraphs.append(_figures(end))
    paragraphs.append(_what(start))
    if lost:
        paragraphs.append(f"_Recording incomplete: {lost} samples are missing._")
    return "\n\n".join(paragraphs) + "\n"


def _what(start: CaseStart) -> str:
    weather = start.weather.replace("_", " ")
    conditions = f"{start.model}, {weather}, {clock(start.time_of_day_min)}"
    return f"{start.case} · {conditions} · {start.campaign}, attempt {start.attempt}"


def _figures(end: CaseEnd) -> str:
    """All scalars as running text: a row for each would not fit into the panel. Those that a
    scenario gives stand first, and are left out where it gives none."""
    shown = [kind for kind in scalars_by_name().values() if kind.panel]
    by_scenario = [kind for kind in shown if kind.by_scenario and kind.name in end.scalars]
    if all(end.scalars[kind.name] is None for kind in by_scenario):
        by_scenario = []
    figures = []
    for kind in (*by_scenario, *(kind for kind in shown if not kind.by_scenario)):
        value, unit = end.scalars.get(kind.name), kind.unit.replace("^2", "²")
        figures.append(f"{kind.panel} -" if value is None else f"{kind.panel} {value:.2f} {unit}")
    return " · ".join(figures)
