"""The table of faults: one row per fault, from the outcomes of its runs."""

from __future__ import annotations

import json
import statistics
from dataclasses import asdict, dataclass
from pathlib import Path

from injection import Outcome

HEAD = ("Fault", "Injected", "Cases", "Lost", "Doubled", "Wrong bytes", "Recovery, median", "Worst")
BEGIN, END = "<!-- faults: begin -->", "<!-- faults: end -->"


@dataclass(frozen=True, slots=True)
class Row:
    """Of the table."""

    fault: str
    injected: int
    cases: int
    lost: int
    doubled: int
    wrong: int
    recovery_median_s: float | None
    recovery_worst_s: float | None

    @property
    def clean(self) -> bool:
        """Nothing was lost, doubled or other than in peace."""
        return not (self.lost or self.doubled or self.wrong)


def tabulate(outcomes: list[Outcome]) -> list[Row]:
    """A row per fault, in the order in which they come; the sum at the end."""
    names = list(dict.fromkeys(outcome.row for outcome in outcomes))
    rows = [_row(name, [o for o in outcomes if o.row == name]) for name in names]
    return [*rows, _row("all", outcomes)]


def _row(name: str, outcomes: list[Outcome]) -> Row:
    recoveries_s = [s for outcome in outcomes for s in outcome.recoveries_s]
    return Row(
        name,
        sum(sum(outcome.injected.values()) for outcome in outcomes),
        sum(outcome.cases for outcome in outcomes),
        sum(outcome.lost for outcome in outcomes),
        sum(outcome.doubled for outcome in outcomes),
        sum(outcome.wrong for outcome in outcomes),
        statistics.median(recoveries_s) if recoveries_s else None,
        max(recoveries_s, default=None),
    )


def markdown(rows: list[Row]) -> str:
    """As a table of a Markdown page."""
    lines = [f"| {' | '.join(HEAD)} |", f"|---{'|---:' * (len(HEAD) - 1)}|"]
    for row in rows:
        numbers = (row.injected, row.cases, row.lost, row.doubled, row.wrong)
        times = (row.recovery_median_s, row.recovery_worst_s)
        cells = [f"{n:,}" for n in numbers] + ["-" if s is None else f"{s:.1f} s" for s in times]
        lines.append(f"| {row.fault} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def write(rows: list[Row], folder: Path) -> None:
    """``table.json`` and ``table.md``."""
    (folder / "table.json").write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    (folder / "table.md").write_text(markdown(rows))


def put_into(page: Path, text: str, begin: str = BEGIN, end: str = END) -> None:
    """Replace what stands between the marks of a page."""
    old = page.read_text()
    head, _, rest = old.partition(begin)
    _, found, tail = rest.partition(end)
    if not found:
        raise SystemExit(f"{page}: no lines {begin} and {end}; put them where the table belongs")
    page.write_text(f"{head}{begin}\n{text}{end}{tail}")
