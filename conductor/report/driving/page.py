"""The page of free driving in Markdown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from conductor.report.driving.series import KM, DrivenCase, Series, Sums, sums
from schemas.words import agree, counted

FALSE_MAX = 1
"""Most false full brakings on the whole distance."""
WHOLE_KM = 1000.0
"""The whole distance [km]."""
FAST_SHARE_MIN = 0.5
"""Least share of it faster than 50 km/h."""


def said(series: Series) -> list[str]:
    """The result in some lines, for a terminal."""
    total = sums(series.cases)
    low, high = total.interval()
    lines = [
        f"{total.driven_m / KM:.1f} km, {100 * total.fast_share:.0f} % of them above 50 km/h, in "
        f"{total.cases} cases",
        f"{_falsely(total)}: {total.per_1000_km(total.false):.2f} per 1,000 km "
        f"(95 %: {low:.2f} to {high:.2f}); {total.full - total.false} with a cause, "
        f"{counted(total.partial, 'partial braking')}",
    ]
    lines += [
        f"{name}: {group.driven_m / KM:.1f} km, {group.false} false"
        for name, group in series.by(lambda case: case.road_class).items()
    ]
    if series.left:
        lines.append(
            f"{counted(series.left, 'case')} {agree(series.left, 'has', 'have')} not ended"
        )
    if series.undecided:
        lines.append(f"{counted(len(series.undecided), 'case')} ended without a verdict")
    return lines


def _falsely(total: Sums) -> str:
    return counted(total.false, "false full braking")


def page(series: Series, beside: Path) -> str:
    """The page; films are named relative to the folder ``beside``."""
    return "\n".join(_lines(series, beside)) + "\n"


def _lines(series: Series, beside: Path) -> Iterator[str]:
    total = sums(series.cases)
    low, high = total.interval()
    yield "# Free driving: results"
    yield ""
    yield (
        f"**{_falsely(total)} on {total.driven_m / KM:,.1f} km**: "
        f"{total.per_1000_km(total.false):.2f} per 1,000 km, exact 95 % Poisson interval "
        f"{low:.2f} to {high:.2f}."
    )
    yield ""
    yield f"- Allowed: {FALSE_MAX} on {WHOLE_KM:,.0f} km. {_judged(series, total)}"
    yield (
        f"- {100 * total.fast_share:.1f} % of the distance was driven faster than 50 km/h; at "
        f"least {100 * FAST_SHARE_MIN:.0f} % is asked for."
    )
    yield (
        f"- {counted(total.full - total.false, 'full braking')} had a cause, and the stack began "
        f"to brake {counted(total.partial, 'time')} without braking fully."
    )
    yield ""
    for title, groups in (
        ("Road", series.by(lambda case: case.road_class)),
        ("Weather", series.by(lambda case: case.weather)),
        ("Light", series.by(lambda case: "night" if case.night else "day")),
    ):
        yield from _table(title, groups)
    yield from _brakings(series, beside)
    yield from _parts(series)


def _judged(series: Series, total: Sums) -> str:
    if total.false > FALSE_MAX:
        return "That is missed."
    if series.undecided:
        number = len(series.undecided)
        have = agree(number, "has", "have")
        return f"{counted(number, 'case')} {have} no verdict, so nothing is shown yet."
    if series.left or total.driven_m < WHOLE_KM * KM:
        return f"Kept so far; {max(WHOLE_KM - total.driven_m / KM, 0.0):,.0f} km are left."
    return "That is kept."


def _table(title: str, groups: dict[str, Sums]) -> Iterator[str]:
    yield (
        f"| {title} | cases | km | share of km | above 50 km/h | partial | full, with cause | "
        "false full | per 1,000 km, 95 % |"
    )
    yield "|---|--:|--:|--:|--:|--:|--:|--:|---|"
    whole = sum(group.driven_m for group in groups.values())
    for name, group in groups.items():
        low, high = group.interval()
        share = group.driven_m / whole if whole else 0.0
        yield (
            f"| {name.replace('_', ' ')} | {group.cases} | {group.driven_m / KM:,.1f} | "
            f"{100 * share:.1f} % | {100 * group.fast_share:.1f} % | {group.partial} | "
            f"{group.full - group.false} | {group.false} | {low:.2f} to {high:.2f} |"
        )
    yield ""


def _brakings(series: Series, beside: Path) -> Iterator[str]:
    yield "## Full brakings, collisions, cases without a verdict"
    yield ""
    told = [case for case in series.cases if case.full or case.verdict != "pass"]
    told += series.undecided
    if not told:
        yield "None."
        yield ""
        return
    yield "| part | case | verdict | why | film |"
    yield "|---|---|---|---|---|"
    for case in told:
        verdict = (case.verdict or "none").replace("_", " ")
        film = _film(case, beside)
        yield f"| {case.part} | {case.case} | {verdict} | {_cell(case.reasons)} | {film} |"
    yield ""


def _film(case: DrivenCase, beside: Path) -> str:
    if case.film is None:
        return ""
    film = case.film.absolute()
    base = beside.absolute()
    inside = film.is_relative_to(base)
    return f"[film]({film.relative_to(base).as_posix()})" if inside else f"`{case.film}`"


def _parts(series: Series) -> Iterator[str]:
    yield "## Parts"
    yield ""
    yield "Every part that was made, in the order of its making. All of them count."
    if not series.same_software:
        yield "They ran with different software: look whether the stack is the same in all of it."
    yield ""
    yield "| part | frozen by | seed | software | km | full, with cause | false full | state |"
    yield "|---|---|--:|---|--:|--:|--:|---|"
    for part in series.parts:
        group = sums(case for case in part.cases if case.verdict)
        state = "not begun" if not part.begun else f"{part.left} cases left" if part.left else "run"
        commit = _digest(part.commit)
        yield (
            f"| {part.name} | {commit} | {part.seed} | {_digest(part.software)} | "
            f"{group.driven_m / KM:,.1f} | "
            f"{group.full - group.false} | {group.false} | {state} |"
        )


def _digest(text: str) -> str:
    return f"`{text[:12]}`" if text else ""


def _cell(text: str) -> str:
    """Text for a cell of a table, on one line."""
    return " ".join(text.replace("|", "\\|").split())
