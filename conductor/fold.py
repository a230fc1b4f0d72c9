"""The fold: how each fact changes the state. Nothing else changes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import msgspec

from conductor.backlog import Backlog
from conductor.facts import (
    AttemptEnded,
    CaseEnded,
    Committed,
    Draining,
    EpochRaised,
    Fact,
    LateAttempt,
    Leased,
    Pinned,
    Replied,
    Seen,
    Shortened,
    Submitted,
    WorkerJoined,
    WorkerLeft,
)
from conductor.lease import token_of
from conductor.state import CampaignState, CaseState, Config, LiveLease, State, WorkerState
from schemas.campaign import Campaign
from schemas.identity import rig_key
from schemas.messages import Result


def fold(facts: Iterable[Fact], config: Config | None = None) -> State:
    """The state after ``facts``; live leases have no expiry yet, see :func:`revive`."""
    state = State(config=config or Config())
    for fact in facts:
        apply(state, fact)
    return state


def revive(state: State, now_ns: int) -> None:
    """After a restart: every live lease and every worker gets a full time to live from now."""
    until_ns = now_ns + state.config.ttl_ns
    for lease in state.leases.values():
        lease.expiry_ns = until_ns
    for worker in state.workers.values():
        worker.seen_ns = now_ns
    state.expiry_floor_ns = until_ns


def apply(state: State, fact: Fact) -> None:
    """Change ``state`` by one fact.

    Raises:
        AssertionError: the fact contradicts the state; a fact is never applied by halves.
    """
    match fact:
        case EpochRaised():
            _expect(fact.epoch > state.epoch, fact)
            state.epoch, state.granted = fact.epoch, 0
        case Submitted():
            _submitted(state, fact)
        case Pinned():
            campaign = state.campaigns[fact.campaign]
            _expect(not campaign.pinned, fact)
            campaign.pinned = True
            campaign.software, campaign.device_class = fact.software, fact.device_class
        case WorkerJoined():
            _expect(fact.worker not in state.workers, fact)
            _expect(fact.worker not in state.departed, fact)
            state.workers[fact.worker] = WorkerState(joined=fact)
        case WorkerLeft():
            _expect(not state.workers[fact.worker].tokens, fact)
            del state.workers[fact.worker]
            state.departed.add(fact.worker)
        case Leased():
            _leased(state, fact)
        case Committed():
            _committed(state, fact)
        case AttemptEnded():
            _attempt_ended(state, fact)
        case CaseEnded():
            _case_ended(state, fact)
        case LateAttempt():
            _late(state, fact)
        case Replied():
            state.workers[fact.worker].replied = fact
        case Seen():
            _seen(state, fact)
        case Shortened():
            for token in state.workers[fact.worker].tokens:
                lease = state.leases[token]
                lease.expiry_ns = min(lease.expiry_ns, fact.until_ns)
            state.expiry_floor_ns = min(state.expiry_floor_ns, fact.until_ns)
        case Draining():
            state.draining = True


def _expect(condition: bool, fact: Fact) -> None:
    if not condition:
        raise AssertionError(f"fact contradicts the state: {fact}")


def _submitted(state: State, fact: Submitted) -> None:
    campaign = msgspec.convert(fact.campaign, Campaign)
    _expect(campaign.campaign not in state.campaigns, fact)
    backlog = Backlog()
    ordered = []
    for order, case in enumerate(fact.cases):
        ordered.append(CaseState(case=case, order=order, rig=rig_key(case)))
        backlog.add(ordered[-1].rig, order, alone=False)
    state.campaigns[campaign.campaign] = CampaignState(
        campaign=campaign,
        digest=fact.digest,
        out=fact.out,
        cases={case_state.case.id: case_state for case_state in ordered},
        ordered=ordered,
        backlog=backlog,
        open_batches=dict(Counter(case.batch for case in fact.cases)),
    )


def _find(state: State, campaign: str, case: str) -> tuple[CampaignState, CaseState]:
    campaign_state = state.campaigns[campaign]
    return campaign_state, campaign_state.cases[case]


def _leased(state: State, fact: Leased) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(case.end is None and not case.live, fact)
    _expect(fact.token == token_of(state.epoch, state.granted + 1), fact)
    _expect(fact.attempt == len(case.issued) + 1 and fact.alone == case.alone, fact)
    campaign.backlog.remove(case.rig, case.order, case.alone)
    state.granted += 1
    case.issued.append(fact.token)
    case.live.append(fact.token)
    campaign.leased += 1
    campaign.attempts += 1
    state.workers[fact.worker].tokens[fact.token] = None
    state.leases[fact.token] = LiveLease(
        token=fact.token,
        key=(fact.campaign, fact.case),
        worker=fact.worker,
        attempt=fact.attempt,
        alone=fact.alone,
    )


def _drop(state: State, campaign: CampaignState, case: CaseState, token: int) -> None:
    """The token dies."""
    lease = state.leases.pop(token)
    del state.workers[lease.worker].tokens[token]
    case.live.remove(token)
    if not case.live:
        campaign.leased -= 1


def end_name(end: Committed | CaseEnded) -> str:
    """Under which name an ended case is counted."""
    if isinstance(end, CaseEnded):
        return end.outcome
    if end.result.outcome == "failed":
        return "failed"
    return "passed" if end.result.passed else "not_passed"


def _end(campaign: CampaignState, case: CaseState, end: Committed | CaseEnded) -> None:
    case.end = end
    name = end_name(end)
    campaign.ended[name] = campaign.ended.get(name, 0) + 1
    batch = case.case.batch
    campaign.open_batches[batch] -= 1
    if not campaign.open_batches[batch]:
        del campaign.open_batches[batch]


def _committed(state: State, fact: Committed) -> None:
    campaign, case = _find(state, fact.result.campaign, fact.result.case)
    _expect(case.end is None and fact.result.token in case.live, fact)
    for token in list(case.live):
        _drop(state, campaign, case, token)
    _end(campaign, case, fact)
    campaign.disagreements += sum(not agrees(fact.result, late.result) for late in case.late)


def _attempt_ended(state: State, fact: AttemptEnded) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(case.end is None and fact.token in case.live, fact)
    _drop(state, campaign, case, fact.token)
    if fact.charged:
        case.charges.append(f"{fact.reason}: {fact.detail}" if fact.detail else fact.reason)
    case.alone = fact.alone
    if not case.live:
        campaign.backlog.add(case.rig, case.order, case.alone)


def _case_ended(state: State, fact: CaseEnded) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(case.end is None and not case.live, fact)
    campaign.backlog.remove(case.rig, case.order, case.alone)
    _end(campaign, case, fact)


def _late(state: State, fact: LateAttempt) -> None:
    campaign, case = _find(state, fact.result.campaign, fact.result.case)
    _expect(fact.result.token in case.issued and fact.result.token not in case.live, fact)
    case.late.append(fact)
    if isinstance(case.end, Committed):
        campaign.disagreements += not agrees(case.end.result, fact.result)


def agrees(one: Result, other: Result) -> bool:
    """Whether two attempts of one case came to the same result, to the last bit."""
    return (one.outcome, one.verdict, one.kpi_sha256) == (
        other.outcome,
        other.verdict,
        other.kpi_sha256,
    )


def _seen(state: State, fact: Seen) -> None:
    state.workers[fact.worker].seen_ns = fact.now_ns
    for token in fact.tokens:
        lease = state.leases[token]
        lease.expiry_ns = fact.until_ns
        lease.progress = fact.progress.get(token, lease.progress)
    if fact.tokens:
        state.expiry_floor_ns = min(state.expiry_floor_ns, fact.until_ns)
