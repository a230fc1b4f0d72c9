"""The state as ``conductor status`` and progress bars get it (:mod:`schemas.wire.status`)."""

from __future__ import annotations

from msgspec import UNSET

from conductor.core.facts import Committed
from conductor.core.grant import broken, mismatches, present
from conductor.core.searching.record import SearchRecord
from conductor.core.state import CampaignState, CaseState, State, WorkerState
from schemas.wire.status import (
    CampaignStatus,
    CasePage,
    ConductorStatus,
    KnownCase,
    RunningCase,
    SearchStatus,
    WorkerStatus,
)

PAGE_CASES_MAX = 256
"""Most cases in one page: a turn of the conductor reads a few hundred kilobytes of them."""
PAGE_BYTES_MAX = 1 << 20
"""A page ends with the case whose packed end and charges make it reach this size [bytes]."""


def status(state: State, now_ns: int) -> ConductorStatus:
    """Counts per campaign, workers, and why a worker gets nothing; MessagePack-able."""
    return {
        "epoch": state.epoch,
        "draining": state.draining,
        "left": state.left,
        "campaigns": {name: _campaign(c) for name, c in state.campaigns.items()},
        "workers": [_worker(state, worker, now_ns) for worker in state.workers.values()],
        "notes": [
            line
            for worker in state.workers.values()
            if present(state, worker, now_ns)
            for line in mismatches(state, worker)
        ],
        "broken_hosts": _broken(state),
    }


def running(state: State, now_ns: int) -> list[RunningCase]:
    """The leases, by campaign and case; a case may have two."""
    return [
        {
            "campaign": lease.key[0],
            "case": lease.key[1],
            "worker": lease.worker,
            "host": state.workers[lease.worker].joined.host,
            "attempt": lease.attempt,
            "tick": lease.progress,
            "for_s": (now_ns - lease.granted_ns) / 1e9,
            "by_hand": lease.touched,
        }
        for lease in sorted(state.leases.values(), key=lambda lease: (lease.key, lease.attempt))
    ]


def case_page(campaign: CampaignState, first: int) -> CasePage:
    """Cases of a campaign from position ``first`` on, as many as a page holds."""
    name = campaign.campaign.campaign
    page: CasePage = {"campaign": name, "next": None, "cases": []}
    size = 0
    for case in campaign.ordered[first : first + PAGE_CASES_MAX]:
        row = _known(case)
        page["cases"].append(row)
        size += len(case.sealed) + sum(len(charge) for charge in row["charges"])
        if size >= PAGE_BYTES_MAX:
            break
    after = first + len(page["cases"])
    if after < len(campaign.ordered):
        page["next"] = after
    return page


def _known(case: CaseState) -> KnownCase:
    row: KnownCase = {
        "case": case.case.id,
        "attempts": case.attempts,
        "charges": [str(charge) for charge in case.charges],
        "outcome": "",
    }
    end = case.end
    if isinstance(end, Committed):
        result = end.result
        row |= {
            "outcome": result.outcome,
            "verdict": result.verdict,
            "reasons": result.reasons,
            "scalars": result.scalars,
            "names": result.names,
            "attempt_dir": result.attempt_dir,
            "attempt": end.attempt,
            "worker": end.worker,
            "wall_s": result.wall_s,
            "rig_wall_s": result.rig_wall_s,
        }
    elif end is not None:
        row |= {"outcome": end.outcome, "reasons": [end.reason]}
    return row


def _broken(state: State) -> list[str]:
    """A line per host that is avoided."""
    hosts = {worker.joined.host for worker in state.workers.values()}
    return [
        f"host {host}: {len(state.deaths[host])} different cases died on it and none was "
        f"committed in between, the last one {'/'.join(state.deaths[host][-1])}; workers of other "
        "hosts are preferred"
        for host in sorted(hosts)
        if broken(state, host)
    ]


def _campaign(campaign: CampaignState) -> CampaignStatus:
    passed = campaign.ended.get("passed", 0)
    not_passed = campaign.ended.get("not_passed", 0)
    failed = campaign.ended.get("failed", 0)
    found: CampaignStatus = {
        "out": campaign.out,
        "digest": campaign.digest,
        "simulator": campaign.campaign.simulator,
        "cases": len(campaign.cases),
        "priority": campaign.priority,
        "paused": campaign.paused,
        "waiting": campaign.waiting,
        "leased": campaign.leased,
        "committed": passed + not_passed + failed,
        "passed": passed,
        "not_passed": not_passed,
        "failed": failed,
        "unresolved": campaign.ended.get("unresolved", 0),
        "cancelled": campaign.ended.get("cancelled", 0),
        "attempts": campaign.attempts,
        "disagreements": campaign.disagreements,
        "left": campaign.left,
        "p95_s": campaign.durations.p95_s(),
        "software": campaign.software,
        "device_class": campaign.device_class,
    }
    if campaign.search is not None:
        found["search"] = _search(campaign, campaign.search)
    return found


def _search(campaign: CampaignState, record: SearchRecord) -> SearchStatus:
    search = campaign.campaign.search
    answer = record.answers[-1] if record.answers else None
    found: SearchStatus = {
        "generation": len(record.results),
        "budget": 0 if search is UNSET else search.budget.cases,
        "answer": answer.line() if answer else "",
        "ended": record.ended,
        "cpus": record.cpus,
    }
    if answer is not None:
        found["probability"], found["low"], found["high"] = (
            answer.probability,
            answer.low,
            answer.high,
        )
        found["best"], found["best_case"] = answer.best, answer.best_case
    return found


def _worker(state: State, worker: WorkerState, now_ns: int) -> WorkerStatus:
    return {
        "id": worker.joined.worker,
        "host": worker.joined.host,
        "device_class": worker.joined.device_class,
        "slots": worker.joined.slots,
        "draining": worker.draining,
        "held": len(worker.tokens),
        "progress": sum(state.leases[token].progress for token in worker.tokens),
        "memory_bytes": worker.joined.memory_bytes,
        "tags": worker.joined.tags,
        "remaining_s": worker.remaining_s,
        "age_s": max(0, now_ns - worker.seen_ns) / 1e9,
        "present": present(state, worker, now_ns),
    }
