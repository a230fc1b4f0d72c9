"""Why a case waits, runs or has ended, in sentences for people."""

from __future__ import annotations

from collections.abc import Iterator

from conductor.core.facts import ALONE, SHARED, CaseEnded, Committed
from conductor.core.grant import avoids, fits, mismatch, present, shunned
from conductor.core.state import CampaignState, CaseState, State, WorkerState
from schemas.words import agree, counted


def explain(state: State, campaign: str, case: str, now_ns: int) -> list[str]:
    """What is known about a case, the present first, then its past; empty: no such case."""
    campaign_state = state.campaigns.get(campaign)
    known = campaign_state.cases.get(case) if campaign_state else None
    if campaign_state is None or known is None:
        return []
    if known.ended:
        lines = list(_ended(known))
    elif known.live:
        lines = list(_running(state, known, now_ns))
    else:
        lines = list(_waiting(state, campaign_state, known, now_ns))
    return lines + list(_past(known))


def _ended(case: CaseState) -> Iterator[str]:
    end = case.end
    if isinstance(end, CaseEnded):
        yield f"ended: {end.outcome}: {end.reason}"
    elif isinstance(end, Committed):
        result = end.result
        passed = "passed" if result.passed else "not passed"
        yield (
            f"ended: {result.outcome} '{result.verdict}' ({passed}), attempt {end.attempt} "
            f"on worker {end.worker}"
        )


def _running(state: State, case: CaseState, now_ns: int) -> Iterator[str]:
    for token in case.live:
        lease = state.leases[token]
        silent_s = (now_ns - state.workers[lease.worker].seen_ns) / 1e9
        twice = " a second time, because the first takes too long," if lease.speculative else ""
        yield (
            f"leased{twice} to {lease.worker} since {(now_ns - lease.granted_ns) / 1e9:.0f} s, "
            f"attempt {lease.attempt}, at tick {lease.progress}; the worker was heard "
            f"{silent_s:.0f} s ago and has until {(lease.expiry_ns - now_ns) / 1e9:.0f} s from now"
        )
        if lease.touched:
            yield f"steered by hand: {lease.touched}"
    if case.paused:
        yield "paused: if this attempt ends without a result, no other follows"


def _waiting(state: State, campaign: CampaignState, case: CaseState, now_ns: int) -> Iterator[str]:
    blocked = False
    if state.draining:
        blocked = True
        yield "waits: the conductor is draining and grants nothing"
    if campaign.paused:
        blocked = True
        yield "waits: the campaign is paused"
    if case.paused:
        blocked = True
        yield "waits: the case is paused"
    if state.config.by_batch and case.case.variation.batch != campaign.lowest_batch():
        blocked = True
        waiting = campaign.open_batches[campaign.lowest_batch()]
        batch = case.case.variation.batch
        yield (
            f"waits: batch {batch} is not open, batch {campaign.lowest_batch()} has "
            f"{counted(waiting, 'case')} that {agree(waiting, 'has', 'have')} not ended"
        )
    here = [w for w in state.workers.values() if present(state, w, now_ns)]
    if not here:
        blocked = True
        yield "waits: no worker is here"
    elif not blocked:
        yield from _workers(state, campaign, case, here, now_ns)


def _workers(
    state: State, campaign: CampaignState, case: CaseState, here: list[WorkerState], now_ns: int
) -> Iterator[str]:
    matching = [w for w in here if not mismatch(campaign, w)]
    if not matching:
        yield f"waits: none of {counted(len(here), 'worker')} may run it"
        yield from sorted({mismatch(campaign, worker) for worker in here})
        return
    serving = [worker for worker in matching if not worker.draining]
    if not serving:
        yield f"waits: all of {counted(len(matching), 'worker')} that may run it are draining"
        return
    for worker in serving:
        if shunned(state, campaign, worker, now_ns):
            yield f"not on {worker.joined.worker}: too many different cases died on its host"
    short = [w for w in serving if not fits(state.config, campaign, w.remaining_s)]
    if len(short) == len(serving):
        yield (
            f"waits: a case takes up to {campaign.durations.p95_s() or 0.0:.0f} s, and no worker "
            f"has that and {state.config.walltime_margin_s:.0f} s of walltime left"
        )
        return
    if case.group == ALONE:
        yield "waits for a worker whose rig is empty: it runs alone, because a rig died with it"
    elif case.group != SHARED:
        others = len(list(campaign.backlog.take(case.rig, case.group))) - 1
        yield (
            "waits for a worker whose rig is empty: it shares its rig only with "
            f"{counted(others, 'other suspect')} of a rig that died"
        )
    for worker in serving:
        if avoids(state, campaign, case, worker, now_ns):
            yield f"not again on {worker.joined.worker}: another worker should confirm its charges"
    before = len([o for o in campaign.backlog.take(case.rig, case.group) if o < case.order])
    busy = sum(len(worker.tokens) for worker in serving)
    yield (
        f"waits: {counted(before, 'case')} of its kind before it, priority {campaign.priority}; "
        f"{counted(len(serving), 'worker')} may run it, holding {counted(busy, 'case')}"
    )


def _past(case: CaseState) -> Iterator[str]:
    if case.attempts > len(case.live) + isinstance(case.end, Committed):
        yield f"{counted(case.attempts, 'attempt')} so far"
    for number, charge in enumerate(case.charges, 1):
        yield f"charge {number}: {charge}"
    for loss in case.losses:
        yield f"worker {loss.worker} died with it while all others lived: {loss.detail}"
    for steered in case.steered:
        yield f"no verdict of {steered}"
    for late in case.late:
        yield f"a late result '{late.result.verdict}' of worker {late.worker} is kept as evidence"
