"""What each site has done of a campaign that ran on several, and what it cost.

Which site a worker was of, its id says (:mod:`schemas.wire.site_name`); prices are those of the
sites file when allocations were asked for. Wall clock: nothing here reaches a result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from conductor.records.outcomes import CaseOutcome
from conductor.records.timeline import COMMITTED
from conductor.report.reading.leases import Leases, LeaseSpan
from schemas.files.allocations import JsonError, read_book
from schemas.wire.site_name import site_of

ELSEWHERE = "(no site)"
"""Stands for workers whose id names no site."""


@dataclass(frozen=True, slots=True)
class SiteShare:
    """One line of the table."""

    site: str
    cases: int
    """Cases whose result is of it."""
    share: float
    """The same, of all cases with a result, 0 to 1."""
    workers: int
    worker_hours: float
    """Time from the first lease of each worker to the end of its last [h]."""
    cost: float | None
    """Worker-hours times the price; None: nobody has said a price."""
    unused: int
    """Leases that brought no result."""
    device_classes: tuple[str, ...]
    """Classes of devices that its results depend on."""


def site_shares(
    outcomes: Mapping[str, CaseOutcome], leases: Leases, prices: Mapping[str, float]
) -> list[SiteShare]:
    """A line per site by name; none if no worker was of a site.

    Args:
        outcomes: of the cases.
        leases: all of them.
        prices: of a worker's hour, by site.
    """
    done: dict[str, list[CaseOutcome]] = {}
    for row in outcomes.values():
        if row.worker:
            done.setdefault(site_of(row.worker), []).append(row)
    spans: dict[str, dict[str, list[LeaseSpan]]] = {}
    for span in leases.spans:
        spans.setdefault(site_of(span.worker), {}).setdefault(span.worker, []).append(span)
    names = sorted({*done, *spans})
    if not any(names):
        return []
    total = sum(len(rows) for rows in done.values())
    shares = []
    for name in names:
        rows, workers = done.get(name, []), spans.get(name, {})
        hours = sum(_held_s(held) for held in workers.values()) / 3600
        unused = sum(span.how != COMMITTED for held in workers.values() for span in held)
        shares.append(
            SiteShare(
                site=name or ELSEWHERE,
                cases=len(rows),
                share=len(rows) / total if total else 0.0,
                workers=len(workers),
                worker_hours=hours,
                cost=hours * prices[name] if name in prices else None,
                unused=unused,
                device_classes=tuple(sorted({r.device_class for r in rows if r.device_class})),
            )
        )
    return shares


def prices_of(folder: Path) -> dict[str, float]:
    """Prices of a worker's hour in a run folder, by site; damaged ones are left out."""
    try:
        book = read_book(folder)
    except (OSError, JsonError):
        return {}
    sites = book.sites if book is not None else {}
    return {name: record.cost for name, record in sites.items() if record.cost is not None}


def _held_s(spans: list[LeaseSpan]) -> float:
    return max(span.end_s for span in spans) - min(span.start_s for span in spans)
