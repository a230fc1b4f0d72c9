"""How many workers a campaign should have, and where: a pure decision.

More workers are asked for while there are cases for them, and while each would have something to do
for a while; fewer when nothing waits. As with HyperQueue's automatic allocation, a site gets a few
allocations into its queue at a time, and rests after failures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from schemas.words import counted

WORTHWHILE_S = 60.0
"""Work that another worker should find, at least: it waits in a queue, and takes a while to
start [s]."""
FIRST_REST_S, LONGEST_REST_S = 30, 3600
"""Rest of a site after its first failure, doubled with each further one up to the second [s]."""
FAILURES_MAX = 6
"""Failures in a row after which nothing more is asked of a site."""


@dataclass(frozen=True, slots=True)
class CaseDemand:
    """What a conductor says of its cases."""

    left: int
    """Cases that have not ended."""
    waiting: int
    """Cases of those that nobody runs."""
    case_s: float | None
    """What a case takes; None: none has ended yet [s]."""
    slots: int
    """Cases that one worker runs together."""


@dataclass(frozen=True, slots=True)
class SiteRoom:
    """What may be asked of a site."""

    name: str
    workers: int
    """Workers of one allocation."""
    allocations: int
    """Most allocations at once."""
    queued: int
    """Most allocations in its queue."""
    failures: int = 0
    """Failures in a row."""
    rests_until_s: float = 0.0
    """Time until which nothing is asked of it [s]."""
    walltime_h: float = 0.0
    """Longest duration of an allocation [h]."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How an allocation stands."""

    id: str
    site: str
    workers: int
    state: Literal["queued", "running", "unreachable"]
    present: int = 0
    """Workers of it that the conductor sees."""
    held: int = 0
    """Cases that they run."""
    has_job: bool = True
    """Whether its site has taken it, as far as is known."""

    @property
    def may_wait(self) -> bool:
        """Whether it is in a queue, or nobody says that it is not."""
        lost = self.state == "unreachable" and self.has_job and not self.present
        return lost or self.state == "queued"


@dataclass(frozen=True, slots=True)
class WorkerTarget:
    """Limits of the user."""

    least: int
    """Workers that there should be while cases are left."""
    most: int
    """Workers that there may be."""
    worker_hours: float | None = None
    """Most worker-hours that may be asked for altogether; None: no limit [h]."""
    worthwhile_s: float = WORTHWHILE_S
    """See :data:`WORTHWHILE_S` [s]."""


@dataclass(frozen=True, slots=True)
class AskSite:
    """Ask a site for one more allocation."""

    site: str
    why: str


@dataclass(frozen=True, slots=True)
class EndAllocation:
    """End an allocation."""

    id: str
    why: str


@dataclass(frozen=True, slots=True)
class Decision:
    """What is to be done, and what is to be said of what is not."""

    asks: list[AskSite] = field(default_factory=list)
    ends: list[EndAllocation] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def rest_s(failures: int) -> float:
    """How long a site rests after so many failures in a row [s]."""
    if failures == 0:
        return 0.0
    return float(min(FIRST_REST_S * 2 ** (failures - 1), LONGEST_REST_S))


def decide(
    demand: CaseDemand,
    rooms: Sequence[SiteRoom],
    standings: Sequence[Standing],
    target: WorkerTarget,
    *,
    spent_h: float,
    now_s: float,
) -> Decision:
    """What to ask for and what to end.

    Args:
        demand: the conductor's cases.
        rooms: sites in the order in which they are preferred.
        standings: allocations that have not ended, in the order in which they were made.
        target: limits.
        spent_h: worker-hours that allocations have had, or may still have [h].
        now_s: the time [s].
    """
    if demand.left == 0:
        return Decision(ends=[EndAllocation(each.id, "every case has ended") for each in standings])
    wanted, why = wanted_workers(demand, rooms, target)
    have = sum(_counts(each) for each in standings)
    if have < wanted:
        return _more(wanted - have, why, rooms, standings, target, spent_h, now_s)
    return _fewer(have - wanted, have - target.most, why, demand, standings)


def wanted_workers(
    demand: CaseDemand, rooms: Sequence[SiteRoom], target: WorkerTarget
) -> tuple[int, str]:
    """Number of workers that there should be, and the reason in words."""
    useful = math.ceil(demand.left / demand.slots)
    cases = counted(demand.left, "case")
    if demand.case_s is None:
        first = sum(room.workers for room in rooms)
        number = min(useful, first)
        why = f"{cases} left, none has ended yet, so one allocation of each site to begin with"
    else:
        work_s = demand.left * demand.case_s / demand.slots
        number = min(useful, math.ceil(work_s / target.worthwhile_s))
        why = (
            f"{cases} left of {demand.case_s:.1f} s each: {counted(number, 'worker')} with "
            f"{work_s / number:.0f} s of work"
        )
    clamped = max(target.least, min(number, target.most))
    if clamped != number:
        why += f", and {target.least} to {target.most} are allowed"
    return clamped, why


def _counts(standing: Standing) -> int:
    """Workers that are counted on: of a site that does not answer, those that are seen."""
    return standing.present if standing.state == "unreachable" else standing.workers


def _more(
    lacking: int,
    why: str,
    rooms: Sequence[SiteRoom],
    standings: Sequence[Standing],
    target: WorkerTarget,
    spent_h: float,
    now_s: float,
) -> Decision:
    """Sites in their order; each gets one allocation at a time, as long as it has room."""
    decision = Decision()
    tallies = [_Tally.of(room, standings) for room in rooms]
    total = sum(_counts(each) for each in standings)
    while lacking > 0:
        notes = {
            tally: tally.no_room(now_s) or _above(tally.room, total, spent_h, target)
            for tally in tallies
        }
        decision.notes.extend(n for n in notes.values() if n and n not in decision.notes)
        chosen = next((tally for tally, note in notes.items() if not note), None)
        if chosen is None:
            break
        decision.asks.append(AskSite(chosen.room.name, why))
        chosen.number += 1
        chosen.queued += 1
        total += chosen.room.workers
        lacking -= chosen.room.workers
        spent_h += chosen.room.workers * chosen.room.walltime_h
    return decision


def _above(room: SiteRoom, total: int, spent_h: float, target: WorkerTarget) -> str:
    """Which limit of the user another allocation would exceed; empty: none."""
    if total + room.workers > target.most:
        return f"{room.name}: {room.workers} more would be above {counted(target.most, 'worker')}"
    more_h = room.workers * room.walltime_h
    if target.worker_hours is not None and spent_h + more_h > target.worker_hours:
        return (
            f"{room.name}: {more_h:.1f} more would be above {target.worker_hours:g} worker-hours, "
            f"of which {spent_h:.1f} are spent or promised"
        )
    return ""


@dataclass(slots=True, eq=False)
class _Tally:
    """A site, and how many allocations it has."""

    room: SiteRoom
    number: int
    queued: int

    @classmethod
    def of(cls, room: SiteRoom, standings: Sequence[Standing]) -> _Tally:
        own = [each for each in standings if each.site == room.name]
        return cls(room, len(own), sum(each.may_wait for each in own))

    def no_room(self, now_s: float) -> str:
        """Why nothing is asked of the site; empty: it may be."""
        room = self.room
        if room.failures >= FAILURES_MAX:
            return f"{room.name}: {room.failures} failures in a row, nothing more is asked of it"
        if now_s < room.rests_until_s:
            return (
                f"{room.name}: rests after {counted(room.failures, 'failure')} for another "
                f"{room.rests_until_s - now_s:.0f} s"
            )
        if self.number >= room.allocations:
            return f"{room.name}: has its {counted(room.allocations, 'allocation')}"
        if self.queued >= room.queued:
            return f"{room.name}: {counted(self.queued, 'allocation')} in its queue already"
        return ""


def _fewer(
    surplus: int, excess: int, why: str, demand: CaseDemand, standings: Sequence[Standing]
) -> Decision:
    """The newest that wait go first, then those that have nothing to do; above what the user
    allows (``excess`` workers) also those that work, whose cases go back uncharged."""
    decision = Decision()
    newest_first = standings[::-1]
    ranked = sorted(newest_first, key=lambda each: (each.state != "queued", each.held))
    for standing in ranked:
        if standing.workers > surplus:
            continue
        idle = standing.state == "running" and standing.present and not standing.held
        if standing.state == "queued" or excess >= standing.workers:
            reason = why
        elif idle and demand.waiting == 0:
            reason = "idle"
        else:
            continue
        decision.ends.append(EndAllocation(standing.id, reason))
        surplus -= standing.workers
        excess -= standing.workers
    return decision
