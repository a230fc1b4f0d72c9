"""The fold: how each fact changes the state. Nothing else changes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
from msgspec import UNSET

from conductor.core.backlog import Backlog
from conductor.core.case_table import pack, unpack
from conductor.core.durations import CaseLengths
from conductor.core.facts import (
    ALONE,
    SHARED,
    AttemptEnded,
    CaseEnded,
    Charge,
    Committed,
    Draining,
    EpochRaised,
    Fact,
    Generation,
    Intervention,
    LateAttempt,
    Leased,
    Paused,
    Pinned,
    RecordingStored,
    Relocated,
    Replied,
    Retried,
    Seen,
    Shortened,
    Snapshot,
    SteeredAttempt,
    Submitted,
    WorkerDraining,
    WorkerJoined,
    WorkerLeft,
)
from conductor.core.lease import token_of
from conductor.core.relocate import campaign_at, case_at, out_at
from conductor.core.searching.record import SearchRecord, begun
from conductor.core.snapshot import restore, submitted_again
from conductor.core.state import (
    FAR_NS,
    IMAGE_CASES,
    CampaignState,
    CaseState,
    Config,
    Issued,
    LiveLease,
    State,
    WorkerState,
    end_name,
)
from schemas.campaign import Campaign
from schemas.identity import rig_key
from schemas.searching.search_points import with_forks
from schemas.wire.control import Result, Touch

DEPARTED_MAX = 10_000
"""Number of ids of workers that left and are known; of an older one a word that was under way for
so long would count as a new worker's, which is forgotten when it is silent."""
ISSUED_MAX = 64
"""Number of tokens of a case that are known; a late result of an older one is fenced as any other,
but no evidence."""
LATE_MAX = 16
"""Most late results of a case that are kept; all are compared with what is committed."""
LOST_WORKERS_MAX = 64
"""Most names of workers that fell silent with a case."""
TOUCH_CHARS_MAX = 300
"""Longest description of an intervention that is kept [characters]."""


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
        lease.granted_ns = lease.granted_ns or now_ns
    for worker in state.workers.values():
        worker.seen_ns = now_ns
    state.expiry_floor_ns = until_ns if state.leases else FAR_NS


def apply(state: State, fact: Fact) -> None:
    """Change ``state`` by one fact.

    Raises:
        AssertionError: the fact contradicts the state; a fact is never applied by halves.
    """
    kind = type(fact)
    state.applied += 1
    _FOLDS[kind](state, fact)
    state.tail += kind in _COUNTED


def _expect(condition: bool, fact: Fact) -> None:
    if not condition:
        raise AssertionError(f"fact contradicts the state: {fact}")


def _epoch_raised(state: State, fact: EpochRaised) -> None:
    _expect(fact.epoch > state.epoch, fact)
    state.epoch, state.granted = fact.epoch, 0
    state.folder = fact.folder or state.folder
    if not fact.before:
        return
    for campaign in state.campaigns.values():
        out = out_at(campaign.out, fact.before, fact.folder)
        if out != campaign.out:
            campaign.out = out
            _bring_again(campaign)


def _submitted(state: State, fact: Submitted) -> None:
    campaign = msgspec.convert(fact.campaign, Campaign)
    _expect(campaign.campaign not in state.campaigns, fact)
    cases = unpack(fact.cases)
    ordered = [
        CaseState(case=case, order=order, rig=rig_key(case)) for order, case in enumerate(cases)
    ]
    lanes: dict[str, list[int]] = {}
    for case_state in ordered:
        lanes.setdefault(case_state.rig, []).append(case_state.order)
    backlog = Backlog()
    for rig, orders in lanes.items():
        backlog.extend(rig, orders, SHARED)
    state.left += len(cases)
    record = _begun(state, campaign, fact.search)
    state.campaigns[campaign.campaign] = CampaignState(
        campaign=campaign,
        digest=fact.digest,
        digests=fact.digests,
        out=fact.out,
        cases={case_state.case.id: case_state for case_state in ordered},
        ordered=ordered,
        backlog=backlog,
        open_batches=dict(Counter(case.variation.batch for case in cases)),
        order=len(state.campaigns),
        priority=fact.priority,
        left=len(cases),
        submitted=fact,
        search=record,
        lengths=CaseLengths.of_table(
            fact.cases, [case.id for case in cases], _earlier_lengths(state, campaign)
        ),
    )


def _earlier_lengths(state: State, campaign: Campaign) -> dict[str, float]:
    """Lengths of cases of the same name, in the run that was given and in campaigns of the same
    scenario and axes [s]."""
    lengths = dict(state.config.lengths_s)
    axes = (campaign.scenario, campaign.matrix)
    for other in state.campaigns.values():
        known = other.lengths.known
        if known and (other.campaign.scenario, other.campaign.matrix) == axes:
            lengths |= {other.ordered[position].case.id: each for position, each in known.items()}
    return lengths


def _begun(state: State, campaign: Campaign, record: SearchRecord | None) -> SearchRecord | None:
    """How far the search of a campaign has come that is submitted, or restored with ``record``."""
    search = campaign.search
    if search is UNSET or search.chosen:
        return None
    record = record or begun(search)
    if not record.ended or record.open:
        state.searches[campaign.campaign] = None
    return record


def _generation(state: State, fact: Generation) -> None:
    campaign = state.campaigns[fact.campaign]
    record, search = campaign.search, campaign.campaign.search
    _expect(record is not None and record.open > 0, fact)
    assert record is not None
    assert search is not UNSET
    number = len(record.results)
    _expect(fact.number == len(record.u) and len(fact.results) == record.sizes[number], fact)
    record.close(fact.results, fact.answer, fact.estimate, fact.ended)
    record.versions = fact.versions
    if fact.cpu not in record.cpus:
        record.cpus.append(fact.cpu)
    campaign.grown = True
    if fact.cases is None:
        _expect(bool(record.ended) or record.open > 0, fact)
        if not record.open:
            del state.searches[fact.campaign]
        return
    _expect(not record.ended, fact)
    cases = unpack(fact.cases)
    record.u.append(fact.u)
    record.chains.append(record.chains[number])
    record.sizes.append(len(cases))
    grown = msgspec.structs.replace(search, proposed=[*search.proposed, fact.values])
    if fact.forks or search.forks is not UNSET:
        grown = msgspec.structs.replace(grown, forks=with_forks(search, fact.number, fact.forks))
    campaign.campaign = msgspec.structs.replace(campaign.campaign, search=grown)
    campaign.digest = fact.digest
    campaign.extend(cases, [rig_key(case) for case in cases])
    state.left += len(cases)


def _reopened(state: State, campaign: CampaignState, case: CaseState) -> None:
    """A search that has ended goes on when a case gets another chance of the generation that ended
    it, or of one that closed since."""
    record = campaign.search
    if record is not None and record.reopen(record.generation_of(case.order)):
        state.searches[campaign.campaign.campaign] = None
        campaign.grown = True


def _relocated(state: State, fact: Relocated) -> None:
    campaign = state.campaigns[fact.campaign]
    campaign.campaign = campaign_at(campaign.campaign, fact.paths)
    # Cases go through a table, which lets them share equal sections.
    cases = pack([case_at(case.case, fact.paths) for case in campaign.ordered])
    for case_state, case in zip(campaign.ordered, unpack(cases), strict=True):
        case_state.case = case
    _bring_again(campaign)


def _bring_again(campaign: CampaignState) -> None:
    """A campaign has changed as a whole: the next snapshot has all of it."""
    campaign.submitted = submitted_again(campaign)
    campaign.grown, campaign.imaged = campaign.search is not None, 0


def _pinned(state: State, fact: Pinned) -> None:
    campaign = state.campaigns[fact.campaign]
    _expect(not campaign.pinned, fact)
    campaign.pinned = True
    campaign.software, campaign.device_class = fact.software, fact.device_class


def _worker_joined(state: State, fact: WorkerJoined) -> None:
    _expect(fact.worker not in state.workers, fact)
    # Whoever decided this had forgotten it: another version may have another limit.
    state.departed.pop(fact.worker, None)
    state.workers[fact.worker] = WorkerState(joined=fact)


def _worker_left(state: State, fact: WorkerLeft) -> None:
    _expect(not state.workers[fact.worker].tokens, fact)
    del state.workers[fact.worker]
    if not fact.forgotten:
        state.departed[fact.worker] = None
        while len(state.departed) > DEPARTED_MAX:
            del state.departed[next(iter(state.departed))]


def _worker_draining(state: State, fact: WorkerDraining) -> None:
    state.workers[fact.worker].draining = True


def _find(state: State, campaign: str, case: str) -> tuple[CampaignState, CaseState]:
    campaign_state = state.campaigns[campaign]
    case_state = campaign_state.cases[case]
    state.dirty.add((campaign, case_state.order // IMAGE_CASES))
    return campaign_state, case_state


def _leased(state: State, fact: Leased) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(not case.ended and len(case.live) == fact.speculative, fact)
    _expect(fact.token == token_of(state.epoch, state.granted + 1), fact)
    _expect(fact.attempt == case.attempts + 1 and fact.alone == case.alone, fact)
    if not fact.speculative:
        campaign.backlog.remove(case.rig, case.order, case.group)
        campaign.leased += 1
    state.granted += 1
    case.attempts += 1
    case.live += (fact.token,)
    worker = state.workers[fact.worker]
    issued = Issued(fact.token, fact.attempt, worker.joined.session)
    case.issued = _latest(case.issued, issued, case.live) if case.issued else (issued,)
    campaign.attempts += 1
    worker.tokens[fact.token] = None
    state.leases[fact.token] = LiveLease(
        token=fact.token,
        key=(fact.campaign, fact.case),
        worker=fact.worker,
        attempt=fact.attempt,
        group=case.group,
        speculative=fact.speculative,
    )


def _latest(
    issued: tuple[Issued, ...], latest: Issued, live: tuple[int, ...]
) -> tuple[Issued, ...]:
    """Tokens of a case with ``latest``; beyond the limit the oldest that is not live is
    forgotten."""
    if len(issued) >= ISSUED_MAX:
        oldest = next(record for record in issued if record.token not in live)
        issued = tuple(record for record in issued if record != oldest)
    return (*issued, latest)


def _evidence(late: tuple[LateAttempt, ...], fact: LateAttempt) -> tuple[LateAttempt, ...]:
    """Late attempts of a case with ``fact``; beyond the limit only if it says something new, in the
    place of the latest."""
    if len(late) < LATE_MAX:
        return (*late, fact)
    if any(agrees(attempt.result, fact.result) is not False for attempt in late):
        return late
    return (*late[:-1], fact)


def _host(state: State, token: int) -> str:
    """Host of a live token."""
    return state.workers[state.leases[token].worker].joined.host


def _drop(state: State, campaign: CampaignState, case: CaseState, token: int) -> None:
    """The token dies."""
    lease = state.leases.pop(token)
    del state.workers[lease.worker].tokens[token]
    alone = len(case.live) == 1
    case.live = () if alone else tuple(other for other in case.live if other != token)
    if not case.live:
        campaign.leased -= 1


def _wait(campaign: CampaignState, case: CaseState) -> None:
    """The case may have come to wait."""
    if case.waits:
        campaign.backlog.add(case.rig, case.order, case.group)


def _end(
    state: State, campaign: CampaignState, case: CaseState, end: Committed | CaseEnded
) -> None:
    if case.waits:
        campaign.backlog.remove(case.rig, case.order, case.group)
    for token in case.live:
        _drop(state, campaign, case, token)
    case.end = end
    name = end_name(end)
    campaign.ended[name] = campaign.ended.get(name, 0) + 1
    campaign.left -= 1
    state.left -= 1
    batch = case.case.variation.batch
    campaign.open_batches[batch] -= 1
    if not campaign.open_batches[batch]:
        del campaign.open_batches[batch]


def _committed(state: State, fact: Committed) -> None:
    campaign, case = _find(state, fact.result.campaign, fact.result.case)
    _expect(not case.ended and fact.result.token in case.live, fact)
    state.deaths.pop(_host(state, fact.result.token), None)
    _end(state, campaign, case, fact)
    campaign.durations.add(fact.result.wall_s)
    if (length_s := fact.result.scalars.get("sim_time_s")) is not None:
        campaign.lengths.add(case.order, float(length_s))
    if case.late:
        campaign.disagreements += sum(
            agrees(fact.result, late.result) is False for late in case.late
        )


def _attempt_ended(state: State, fact: AttemptEnded) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(not case.ended and fact.token in case.live, fact)
    charge = Charge(state.leases[fact.token].worker, fact.reason, fact.detail)
    if fact.charged:
        host, key = _host(state, fact.token), (fact.campaign, fact.case)
        known = state.deaths.get(host, ())
        state.deaths[host] = known if key in known else (*known, key)
    if fact.reason == "refused":
        state.workers[state.leases[fact.token].worker].refused[fact.campaign] = fact.detail
    if fact.reason == "intervened":
        number = state.leases[fact.token].attempt
        case.steered += (SteeredAttempt(number, fact.detail),)
    _drop(state, campaign, case, fact.token)
    if fact.charged:
        case.charges += (charge,)
    if fact.evidence:
        case.losses += (charge,)
    if fact.reason == "lost":
        case.lost_times += 1
        others = tuple(name for name in case.lost if name != charge.worker)
        case.lost = (*others, charge.worker)[-LOST_WORKERS_MAX:]
    case.group = ALONE if fact.alone else fact.group
    state.groups = max(state.groups, fact.group)
    _wait(campaign, case)


def _intervention(state: State, fact: Intervention) -> None:
    _expect(fact.token in state.leases, fact)
    state.leases[fact.token].touched = touch_of(fact)


def touch_of(touch: Touch | Intervention) -> str:
    """Description of an intervention, for people."""
    effect = f"no verdict, changes: {touch.changes}" if touch.changes else "it keeps its verdict"
    return f"{touch.what[:TOUCH_CHARS_MAX]} at tick {touch.tick}; {effect}"


def _case_ended(state: State, fact: CaseEnded) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    _expect(not case.ended, fact)
    _end(state, campaign, case, fact)
    # It was the case that was bad, not the hosts it died on.
    key = (fact.campaign, fact.case)
    for host, deaths in list(state.deaths.items()):
        state.deaths[host] = tuple(death for death in deaths if death != key)


def _paused(state: State, fact: Paused) -> None:
    campaign = state.campaigns[fact.campaign]
    if not fact.case:
        campaign.paused = fact.paused
        return
    _, case = _find(state, fact.campaign, fact.case)
    _expect(not case.ended and case.paused != fact.paused, fact)
    if case.waits:
        campaign.backlog.remove(case.rig, case.order, case.group)
    case.paused = fact.paused
    _wait(campaign, case)


def _retried(state: State, fact: Retried) -> None:
    campaign, case = _find(state, fact.campaign, fact.case)
    end = case.end
    _expect(isinstance(end, CaseEnded), fact)
    assert end is not None
    name = end_name(end)
    campaign.ended[name] -= 1
    if not campaign.ended[name]:
        del campaign.ended[name]
    campaign.left += 1
    state.left += 1
    campaign.reopen(case.case.variation.batch)
    case.end, case.charges, case.losses, case.lost, case.lost_times = None, (), (), (), 0
    case.group, case.paused = SHARED, False
    _reopened(state, campaign, case)
    _wait(campaign, case)


def _late(state: State, fact: LateAttempt) -> None:
    campaign, case = _find(state, fact.result.campaign, fact.result.case)
    _expect(fact.result.token not in case.live, fact)
    case.issued = tuple(record for record in case.issued if record.token != fact.result.token)
    case.late = _evidence(case.late, fact)
    if isinstance(case.end, Committed):
        campaign.disagreements += agrees(case.end.result, fact.result) is False


def _recording_stored(state: State, fact: RecordingStored) -> None:
    _, case = _find(state, fact.campaign, fact.case)
    end = case.end
    _expect(isinstance(end, Committed) and end.result.token == fact.token, fact)
    _expect(case.recording is None, fact)
    case.recording = fact.recording


def _replied(state: State, fact: Replied) -> None:
    state.workers[fact.worker].replied = fact


def agrees(one: Result, other: Result) -> bool | None:
    """Whether two attempts of one case came to the same result, to the last bit; None: they went
    by the wall clock and cannot be expected to."""
    if one.realtime is not None:
        return None
    return (one.outcome, one.verdict, one.kpi_sha256) == (
        other.outcome,
        other.verdict,
        other.kpi_sha256,
    )


def _snapshot(state: State, fact: Snapshot) -> None:
    if not state.epoch:  # the first fact of a journal
        restore(state, fact, _submitted)
    else:
        for campaign in state.campaigns.values():
            campaign.imaged = len(campaign.ordered)
    state.tail = -1  # itself is none to be read
    state.dirty.clear()
    for campaign in state.campaigns.values():
        campaign.submitted, campaign.grown = None, False


def _seen(state: State, fact: Seen) -> None:
    worker = state.workers[fact.worker]
    worker.seen_ns, worker.vanished = fact.now_ns, False
    if fact.remaining_s is not None:
        worker.remaining_s = fact.remaining_s
    for token in fact.tokens:
        lease = state.leases[token]
        lease.expiry_ns = fact.until_ns
        lease.granted_ns = lease.granted_ns or fact.now_ns
        lease.progress = fact.progress.get(token, lease.progress)
    if fact.tokens:
        state.expiry_floor_ns = min(state.expiry_floor_ns, fact.until_ns)


def _shortened(state: State, fact: Shortened) -> None:
    worker = state.workers[fact.worker]
    worker.vanished = True
    for token in worker.tokens:
        lease = state.leases[token]
        lease.expiry_ns = min(lease.expiry_ns, fact.until_ns)
    state.expiry_floor_ns = min(state.expiry_floor_ns, fact.until_ns)


def _draining(state: State, _: Draining) -> None:
    state.draining = True


_FOLDS: dict[type[Any], Callable[[State, Any], None]] = {
    EpochRaised: _epoch_raised,
    Submitted: _submitted,
    Generation: _generation,
    Relocated: _relocated,
    Pinned: _pinned,
    WorkerJoined: _worker_joined,
    WorkerLeft: _worker_left,
    WorkerDraining: _worker_draining,
    Leased: _leased,
    Committed: _committed,
    AttemptEnded: _attempt_ended,
    Intervention: _intervention,
    CaseEnded: _case_ended,
    Paused: _paused,
    Retried: _retried,
    LateAttempt: _late,
    RecordingStored: _recording_stored,
    Replied: _replied,
    Snapshot: _snapshot,
    Seen: _seen,
    Shortened: _shortened,
    Draining: _draining,
}
_COUNTED = frozenset(_FOLDS) - {Seen, Shortened, Draining, Replied}
