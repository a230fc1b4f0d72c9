"""Which waiting cases a worker gets. Fair share, priorities and walltime fit belong here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from conductor.facts import WorkerJoined
from conductor.state import CampaignState, CaseState, LiveLease, State
from schemas.messages import Next


def mismatch(campaign: CampaignState, worker: WorkerJoined) -> str:
    """Why ``worker`` may not run ``campaign``, in one line; empty if it may."""
    name = campaign.campaign.campaign
    if campaign.pinned and campaign.software != worker.software:
        return (
            f"{worker.worker}: software {worker.software[:12]} is not the {campaign.software[:12]} "
            f"that campaign '{name}' began with; it gets no case of it, install the same version"
        )
    if campaign.device_class and campaign.device_class != worker.device_class:
        return (
            f"{worker.worker}: device class {worker.device_class} is not the "
            f"{campaign.device_class} that campaign '{name}' began with; it gets no case of it, "
            "submit with 'device: any' to mix device classes"
        )
    return ""


def mismatches(state: State, worker: WorkerJoined) -> list[str]:
    """One line per unfinished campaign that ``worker`` may not run."""
    lines = (mismatch(campaign, worker) for campaign in state.campaigns.values() if campaign.left)
    return [line for line in lines if line]


def choose(
    state: State, request: Next, worker: WorkerJoined, held: Sequence[LiveLease]
) -> list[CaseState]:
    """The cases to lease now: one rig key, at most ``request.k``; a case that runs alone is alone.

    Args:
        state: after the request's results and released leases were applied.
        request: what the worker asks for.
        worker: what it said when it joined.
        held: its live leases.
    """
    count = min(request.k, state.config.leases_max)
    if state.draining or count < 1 or any(lease.alone for lease in held):
        return []
    campaigns = [c for c in state.campaigns.values() if len(c.backlog) and not mismatch(c, worker)]
    if request.held:
        # The rig is running: only cases that fit it, whatever else waits.
        case = state.case(held[0].key) if held else None
        rig = case.rig if case else request.rig
        return _fill(state, campaigns, rig, count)
    first = _first(state, campaigns, request.rig) if request.rig else None
    first = first or _first(state, campaigns, None)
    if first is None:
        return []
    return [first] if first.alone else _fill(state, campaigns, first.rig, count)


def _first(state: State, campaigns: Sequence[CampaignState], rig: str | None) -> CaseState | None:
    for campaign in campaigns:
        found = campaign.backlog.first(rig, with_alone=True)
        if found is not None and _in_batch(state, campaign, campaign.ordered[found[0]]):
            return campaign.ordered[found[0]]
    return None


def _fill(
    state: State, campaigns: Sequence[CampaignState], rig: str, count: int
) -> list[CaseState]:
    cases: list[CaseState] = []
    for campaign in campaigns:
        cases += _waiting(state, campaign, rig, count - len(cases))
    return cases


def _waiting(state: State, campaign: CampaignState, rig: str, count: int) -> Iterator[CaseState]:
    for order in campaign.backlog.take(rig, count):
        if not _in_batch(state, campaign, campaign.ordered[order]):
            return  # batches are labelled in submission order: the rest is later still
        yield campaign.ordered[order]


def _in_batch(state: State, campaign: CampaignState, case: CaseState) -> bool:
    return not state.config.by_batch or case.case.batch == min(campaign.open_batches)
