"""Tables for people: a conductor's status."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from conductor.commands.pace import Pace, shown_time
from schemas.reference import FieldKey
from schemas.wire.status import CampaignStatus, ConductorStatus, RunningCase, counts_of
from schemas.words import counted

_COUNTS = ("cases", "waiting", "leased", "passed", "not_passed", "failed", "unresolved")
_COUNTS_IF_ANY = ("cancelled", "quarantined")


def status_tables(found: ConductorStatus) -> None:
    """Print campaigns, workers, notes and alarms of a conductor."""
    _print(status_view(found))


def running_table(rows: Sequence[RunningCase]) -> None:
    """Print the cases that run, or that there is none."""
    if not rows:
        print("no case runs now")
        return
    table = Table("campaign", "case", "worker", "host", "attempt", "tick", "for", "by hand")
    for row in rows:
        cells = (row["campaign"], row["case"], row["worker"], row["host"], row["attempt"])
        table.add_row(*map(str, cells), str(row["tick"]), f"{row['for_s']:.0f} s", row["by_hand"])
    _print(table)


def status_view(found: ConductorStatus, paces: Mapping[str, Pace] | None = None) -> RenderableType:
    """Campaigns, workers, notes and alarms; with throughput and remaining time if ``paces``."""
    parts: list[RenderableType] = [_campaigns(found["campaigns"], paces), _workers(found)]
    parts += [Text(line) for line in search_lines(found)]
    parts += [Text(note) for note in found["notes"]]
    parts += [Text(alarm, style="bold red") for alarm in alarms(found)]
    return Group(*parts)


def search_lines(found: ConductorStatus) -> list[str]:
    """Progress of every search, a line each."""
    lines = []
    for name, row in found["campaigns"].items():
        if search := row.get("search"):
            lines.append(f"search '{name}': {search_line(row)}")
            if len(search["cpus"]) > 1:
                among = ", ".join(search["cpus"])
                lines.append(f"search '{name}': proposed on processors of several classes: {among}")
    return lines


def search_line(row: CampaignStatus) -> str:
    """Progress of a search."""
    search = row["search"]
    closed = counted(search["generation"], "generation")
    parts = [f"{closed} closed, {row['cases']} of at most {counted(search['budget'], 'case')}"]
    parts += [text for text in (search["answer"], search["ended"]) if text]
    return "; ".join(parts)


def alarms(found: ConductorStatus) -> list[str]:
    """Lines about what must not happen: broken hosts, attempts that disagree, storage that
    refuses."""
    lines = [f"alarm: {line}" for line in found.get("broken_hosts", [])]
    for name, row in found["campaigns"].items():
        count = row.get("disagreements", 0)
        if count:
            lines.append(
                f"alarm: campaign '{name}': {counted(count, 'late attempt')} of "
                f"ended cases came to another result; see `conductor report {row['out']}`"
            )
    if found.get("storage_error"):
        lines.append(f"storage: {found['storage_error']}")
    return lines


def key_table(keys: Sequence[FieldKey]) -> None:
    """Print keys of a file."""
    table = Table("key", "allowed", "default", "meaning", box=None, padding=(0, 2, 0, 0))
    for key in keys:
        table.add_row(*(Text(cell) for cell in (key.path, key.allowed, key.default, key.meaning)))
    _print(table)


def _print(view: RenderableType) -> None:
    # Without a terminal rich assumes 80 columns, which cuts ids and folders.
    Console(width=None if sys.stdout.isatty() else 180).print(view)


def _campaigns(rows: Mapping[str, CampaignStatus], paces: Mapping[str, Pace] | None) -> Table:
    counts = _COUNTS + tuple(
        name for name in _COUNTS_IF_ANY if any(counts_of(row).get(name) for row in rows.values())
    )
    heads = [name.replace("_", " ") for name in counts]
    table = Table("campaign", *heads, *(("cases/s", "ETA") if paces is not None else ()), "folder")
    for name, row in rows.items():
        numbers = counts_of(row)
        cells = [str(numbers.get(count, 0)) for count in counts]
        if paces is not None:
            pace = paces.get(name) or Pace()
            rate = "-" if pace.per_s is None else f"{pace.per_s:.2f}"
            cells += [rate, shown_time(pace.eta_s(row["left"]))]
        label = f"{name} (paused)" if row.get("paused") else name
        table.add_row(label, *cells, row["out"])
    return table


def _workers(status: ConductorStatus) -> Table:
    table = Table("worker", "host", "device", "slots", "held", "progress", "last seen")
    for row in status["workers"]:
        age = f"{row['age_s']:.1f} s ago"
        table.add_row(
            row["id"],
            row["host"],
            row["device_class"],
            str(row["slots"]),
            str(row["held"]),
            str(row["progress"]),
            age if row["present"] else f"{age}, silent",
        )
    return table
