"""Tables for people, on standard output."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

_COUNTS = ("cases", "waiting", "leased", "passed", "not_passed", "failed", "unresolved")


def status_tables(found: dict[str, Any]) -> None:
    """Campaigns, workers and notes of a conductor."""
    console = Console()
    campaigns = Table("campaign", *(name.replace("_", " ") for name in _COUNTS), "folder")
    for name, row in found["campaigns"].items():
        campaigns.add_row(name, *(str(row[count]) for count in _COUNTS), row["out"])
    console.print(campaigns)
    workers = Table("worker", "host", "device", "slots", "held", "last seen")
    for row in found["workers"]:
        workers.add_row(
            row["id"],
            row["host"],
            row["device_class"],
            str(row["slots"]),
            str(row["held"]),
            f"{row['age_s']:.1f} s ago",
        )
    console.print(workers)
    for note in found["notes"]:
        console.print(note, markup=False)
    if found.get("storage_error"):
        console.print(f"storage: {found['storage_error']}", style="red", markup=False)
