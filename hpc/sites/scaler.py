"""``hpc scale``: looks at the conductor and at the batch systems, decides, asks, and says why.

All that it knows stands in the run folder, so it may be killed at any moment and started again.
Times are of the wall clock; nothing here reaches a result.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from hpc.script import ALLOCATION_TAG
from hpc.sites.allocations import Allocations
from hpc.sites.scaling import CaseDemand, Decision, SiteRoom, Standing, WorkerTarget, decide
from schemas.escape import escape
from schemas.files.allocations import Allocation, SiteRecord
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.wire.status import ConductorStatus, WorkerStatus
from twin.base.command import StopSignal
from twin.base.errors import EXIT_PASS, EXIT_UNFINISHED, TwinError
from twin.fabric.discovery import OUTCOMES_NAME

LOG_NAME = "scale.jsonl"
"""File in the run folder: what was done, and why, a line each."""
LOG_BYTES_MAX = 16 << 20
"""Size of it from which on a new one is begun; the one before is ``scale.1.jsonl`` [bytes]."""
GONE_S = 600
"""Silence of the conductor after which nobody looks any more [s]."""


@dataclass(slots=True)
class Scaler:
    """Looks, decides and acts, again and again."""

    allocations: Allocations
    status: Callable[[], ConductorStatus]
    """How the conductor stands; raises a TwinError if it does not answer."""
    target: WorkerTarget
    rooms: dict[str, SiteRoom]
    """What may be asked of each site, in the order in which they are preferred."""
    say: Callable[[str], None]
    slots: int = 1
    """Cases together per worker, until one has joined."""
    dry_run: bool = False
    _notes: set[str] = field(default_factory=set)
    _silent_since_s: float | None = None

    def run(self, period_s: float, *, once: bool = False) -> int:
        """Until every case has ended, or until it is told to stop; the exit code."""
        stop = StopSignal()
        while True:
            over = self.turn(time.time())
            if over is not None:
                return over
            if once or self.dry_run:
                return EXIT_PASS
            if stop.wait(period_s):
                self.say("stopped; allocations stay, and the same command goes on")
                return EXIT_UNFINISHED

    def turn(self, now_s: float) -> int | None:
        """One look and what follows from it; the exit code if that was the last one."""
        try:
            found = self.status()
        except TwinError as error:
            return self._silence(error, now_s)
        self._silent_since_s = None
        workers = [w for w in found.get("workers", []) if w.get("present")]
        present = by_allocation(workers)
        self._look({*present}, now_s)
        if not self.dry_run:
            self._submit_wanted(now_s)
        demand = demand_of(found, workers, self.slots)
        if demand.left and not demand.waiting and all_paused(found):
            self._note("paused; nothing is asked for or ended meanwhile", now_s)
            return None
        decision = decide(
            demand,
            [self._room(room) for room in self.rooms.values()],
            [standing_of(each, present.get(each.id, [])) for each in self.allocations.open],
            self.target,
            spent_h=self.allocations.spent_h,
            now_s=now_s,
        )
        self._carry_out(decision, now_s)
        if demand.left == 0 and found.get("campaigns"):
            return self._over("every case has ended", now_s)
        return None

    def _silence(self, error: TwinError, now_s: float) -> int | None:
        """The conductor does not answer: it may start again, or have ended."""
        if is_complete(self.allocations.folder):
            return self._over("every case has ended", now_s)
        if self._silent_since_s is None:
            self._silent_since_s = now_s
            self._log("wait", f"{escape(str(error), 300)}; nothing is asked for meanwhile", now_s)
        self._look(set(), now_s)
        if now_s - self._silent_since_s < GONE_S and not self.allocations.found_none_left:
            return None
        if self.allocations.found_none_left:
            return self._over("workers have left because no case is left", now_s)
        self._over("the conductor has gone", now_s)
        return EXIT_UNFINISHED

    def _over(self, why: str, now_s: float) -> int:
        for each in self.allocations.open:
            if not each.dismissed:
                self._end(each, why, now_s)
        self._log("end", why, now_s)
        return EXIT_PASS

    def _look(self, joined: set[str], now_s: float) -> None:
        look = self.allocations.look if self.dry_run else self.allocations.refresh
        for line in look(joined, now_s):
            self._log("look", line, now_s)

    def _room(self, room: SiteRoom) -> SiteRoom:
        record = self.allocations.book.sites.get(room.name, SiteRecord())
        return SiteRoom(
            room.name,
            room.workers,
            room.allocations,
            room.queued,
            record.failures,
            record.rests_until_s,
            room.walltime_h,
        )

    def _submit_wanted(self, now_s: float) -> None:
        """Submit the allocations whose submission a kill or a network has cut off."""
        for each in self.allocations.open:
            record = self.allocations.book.sites.get(each.site, SiteRecord())
            if each.job or each.site not in self.rooms or now_s < record.rests_until_s:
                continue
            try:
                self.allocations.submit(each, now_s)
                self._log("ask", f"{each.id}: job {each.job}, asked for before", now_s)
            except TwinError as error:
                self._note(f"{each.id}: {error}", now_s)

    def _carry_out(self, decision: Decision, now_s: float) -> None:
        for note in decision.notes:
            self._note(note, now_s)
        by_id = {each.id: each for each in self.allocations.open}
        for end in decision.ends:
            each = by_id[end.id]
            if not each.dismissed:
                self._end(each, end.why, now_s)
        for ask in decision.asks:
            if self.dry_run:
                self._log("would ask", f"{ask.site}: {ask.why}", now_s)
                continue
            try:
                made = self.allocations.ask(self.allocations.sites[ask.site], ask.why, now_s)
                self._log("ask", f"{made.id}: job {made.job}, {ask.why}", now_s)
            except TwinError as error:
                self._note(f"{ask.site}: {error}", now_s)

    def _end(self, each: Allocation, why: str, now_s: float) -> None:
        if self.dry_run:
            self._log("would end", f"{each.id}: {why}", now_s)
            return
        try:
            self.allocations.end(each, why, now_s)
            self._log("end", f"{each.id}: {why}", now_s)
        except TwinError as error:
            self._note(f"{each.id}: {error}", now_s)

    def _note(self, line: str, now_s: float) -> None:
        """Once: what keeps something from being done is the same in the next turn."""
        key = "".join(c for c in line if not c.isdigit())
        if key not in self._notes:
            self._notes.add(key)
            self._log("note", escape(line, 400), now_s)

    def _log(self, what: str, line: str, now_s: float) -> None:
        self.say(f"{what}: {line}")
        if self.dry_run:
            return
        path = self.allocations.folder / LOG_NAME
        with contextlib.suppress(OSError):  # a log, from which nothing is decided
            if path.exists() and path.stat().st_size > LOG_BYTES_MAX:
                path.replace(path.with_name("scale.1.jsonl"))
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"at_s": round(now_s, 3), "what": what, "line": line}) + "\n")


def is_complete(folder: Path) -> bool:
    """Whether the outcomes of a run are here, and every case has one."""
    try:
        found: _Complete = decode_json(
            read_regular(folder / OUTCOMES_NAME, RUN_FILE_BYTES_MAX), _Complete
        )
    except (OSError, JsonError):
        return False
    return found.complete


class _Complete(msgspec.Struct, frozen=True):
    """The part of ``outcomes.json`` that is read here."""

    complete: bool = False


def by_allocation(workers: list[WorkerStatus]) -> dict[str, list[WorkerStatus]]:
    """Workers by the allocation that their tags name."""
    found: dict[str, list[WorkerStatus]] = {}
    for worker in workers:
        for tag in worker.get("tags", []):
            if tag.startswith(ALLOCATION_TAG):
                found.setdefault(tag.removeprefix(ALLOCATION_TAG), []).append(worker)
    return found


def demand_of(status: ConductorStatus, workers: list[WorkerStatus], slots: int) -> CaseDemand:
    """What the campaigns of a conductor need."""
    campaigns = [*status.get("campaigns", {}).values()]
    left = sum(row["left"] for row in campaigns)
    weighted = [(row["left"], row.get("p95_s")) for row in campaigns]
    known = [(count, each_s) for count, each_s in weighted if each_s is not None and count]
    counts = sum(count for count, _ in known)
    return CaseDemand(
        left=left,
        waiting=sum(row["waiting"] for row in campaigns if not row.get("paused")),
        case_s=sum(count * each_s for count, each_s in known) / counts if counts else None,
        slots=max((worker.get("slots", slots) for worker in workers), default=slots),
    )


def all_paused(status: ConductorStatus) -> bool:
    """Whether somebody has paused every campaign that has not ended."""
    rows = status.get("campaigns", {}).values()
    return all(row.get("paused") for row in rows if row["left"])


def standing_of(allocation: Allocation, workers: list[WorkerStatus]) -> Standing:
    """An allocation as a decision sees it."""
    state = allocation.state
    return Standing(
        id=allocation.id,
        site=allocation.site,
        workers=allocation.workers,
        # What has no job yet may never get one: its site does not answer.
        state="running" if state == "running" else "queued" if state == "queued" else "unreachable",
        present=len(workers),
        held=sum(worker.get("held", 0) for worker in workers),
        has_job=bool(allocation.job),
    )
