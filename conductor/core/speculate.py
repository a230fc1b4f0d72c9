"""A second lease for a straggler: at the end, an idle worker races one that takes too long."""

from __future__ import annotations

from conductor.core.facts import SHARED
from conductor.core.grant import broken, fits, mismatch
from conductor.core.state import CampaignState, CaseState, LiveLease, State, WorkerState
from schemas.wire.control import Next


def straggler(state: State, request: Next, worker: WorkerState, now_ns: int) -> CaseState | None:
    """The longest-running case that ``worker``, which holds nothing, may run a second time.

    Call it when no case waits for the worker. A case under suspicion is never doubled: it could
    take a second rig with it.
    """
    if (
        not state.config.speculate
        or request.k < 1
        or request.held
        or state.draining
        or worker.draining
    ):
        return None
    late = [
        lease
        for lease in state.leases.values()
        if lease.worker != worker.joined.worker and takes_too_long(state, lease, now_ns)
    ]
    for lease in sorted(late, key=lambda lease: (lease.granted_ns, lease.token)):
        campaign = state.campaigns[lease.key[0]]
        case = campaign.cases[lease.key[1]]
        if (
            not lease.touched  # somebody is looking at it
            and len(case.live) == 1
            and case.group == SHARED
            and not (case.charges or case.losses or case.paused)
            and may_race(state, campaign, request, worker)
        ):
            return case
    return None


def may_race(state: State, campaign: CampaignState, request: Next, worker: WorkerState) -> bool:
    """No case of the campaign waits, and the worker may run it to its end."""
    return (
        not campaign.paused
        and not len(campaign.backlog)
        and not mismatch(campaign, worker)
        and not broken(state, worker.joined.host)
        and fits(state.config, campaign, request.remaining_s)
    )


def takes_too_long(state: State, lease: LiveLease, now_ns: int) -> bool:
    """Whether a lease runs longer than a multiple of the estimate, or on a worker silent for half
    its time."""
    config = state.config
    holder = state.workers[lease.worker]
    if 2 * (now_ns - holder.seen_ns) > config.ttl_ns:
        return True
    estimate_s = state.campaigns[lease.key[0]].durations.p95_s()
    if estimate_s is None:
        return False
    limit_ns = max(int(config.speculate_factor * estimate_s * 1e9), config.speculate_min_ns)
    return now_ns - lease.granted_ns > limit_ns
