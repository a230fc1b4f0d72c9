"""``twin bench campaign``: its options, and what it prints."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import typer

from schemas.words import counted
from twin.base.errors import UsageError
from twin.base.progress import progress
from twin.base.software import device_class
from twin.bench.campaign import Request, SlotsRow, as_json, lines, measure

SLOTS_MAX = 4096
USUAL_SLOTS = (1, 8, 64, 256)
"""Numbers of slots that are measured where nobody says which."""


def show(
    campaign: str,
    slots: str | None,
    device: str,
    cases: int | None,
    workers: str,
    out: Path | None,
    *,
    as_text: bool,
    check: bool,
) -> None:
    """Run the campaign once per number of slots, then print. Where the stack does not look at all
    sensors, once with all of them and once with those that it looks at.

    Raises:
        UsageError: an option or the campaign cannot be used.
        typer.Exit: with --check, a target was missed or fingerprints differ.
    """
    counts = list(USUAL_SLOTS) if slots is None else _counts(slots)
    device_class(device)  # refuses one that is not here
    if not device.startswith("cuda"):
        print("no GPU: the same on the CPU, without targets", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="twin-bench-") as temporary:
        request = Request(campaign, device, out or Path(temporary), cases, workers)
        rows: list[SlotsRow] = []
        while counts:
            count = counts.pop(0)
            rows.append(_measured(request, count, everything=True))
            if rows[-1].unread:
                rows.append(_measured(request, count, everything=False))
            if slots is None:
                counts = filled(counts, rows[-1].cases, workers)
    print("\n".join(lines(rows)) if as_text else json.dumps(as_json(request, rows), indent=1))
    # The targets are those of the largest number of slots that was asked for, with all sensors.
    last = next(row for row in reversed(rows) if row.everything)
    missed = [f"{last.slots} slots: {', '.join(m)}"] if (m := last.missed(device)) else []
    if len({row.fingerprint for row in rows}) > 1:
        missed.append("fingerprints differ between numbers of slots, or with fewer sensors read")
    if check and missed:
        print(f"twin: below target: {'; '.join(missed)}", file=sys.stderr)
        raise typer.Exit(1)


def _measured(request: Request, slots: int, *, everything: bool) -> SlotsRow:
    """Figures of one run, which says how far it is."""
    name = f"twin: {request.campaign} with {counted(slots, 'slot')}"
    with progress(name, f"{counted(slots, 'slot')}", "cases") as report:
        return measure(request, slots, report, everything=everything)


def filled(counts: Sequence[int], cases: int, workers: str) -> list[int]:
    """The numbers of slots that ``cases`` fill; the largest of them just so.

    Args:
        counts: ascending.
        cases: of the campaign.
        workers: as of `conductor run`; words for GPUs count as one worker.
    """
    most = -(-cases // (int(workers) if workers.isdecimal() else 1))
    kept = [count for count in counts if count <= most]
    if counts and len(kept) < len(counts) and most > (kept[-1] if kept else 1):
        kept.append(most)
    return kept


def _counts(text: str) -> list[int]:
    try:
        counts = [int(part) for part in text.split(",")]
    except ValueError:
        counts = []
    if not counts or min(counts) < 1 or max(counts) > SLOTS_MAX:
        raise UsageError(f"--slots {text}: expected numbers from 1 to {SLOTS_MAX}, as in 1,8,64")
    return counts
