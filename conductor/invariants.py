"""What must hold after every fact; tests call :func:`check`, and a mistake names itself."""

from __future__ import annotations

from collections import Counter

from conductor.facts import Committed
from conductor.fold import end_name
from conductor.state import CampaignState, CaseState, State

LIVE_MAX = 1
"""Most live tokens of one case."""


def check(state: State) -> None:
    """Raise AssertionError if the state contradicts itself."""
    live: dict[int, tuple[str, str]] = {}
    for name, campaign in state.campaigns.items():
        _check_campaign(name, campaign)
        for case in campaign.cases.values():
            for token in case.live:
                _that(token not in live, f"token {token} is live twice")
                live[token] = (name, case.case.id)
    _that(live == {t: lease.key for t, lease in state.leases.items()}, "leases and cases differ")
    held = [token for worker in state.workers.values() for token in worker.tokens]
    _that(sorted(held) == sorted(live), "leases and workers differ")
    for worker_id, worker in state.workers.items():
        _that(worker_id not in state.departed, f"worker {worker_id} left and is here")
        leases = [state.leases[token] for token in worker.tokens]
        _that(all(lease.worker == worker_id for lease in leases), "a lease of another worker")
        alone = [lease for lease in leases if lease.alone]
        _that(not alone or len(leases) == 1, f"worker {worker_id} holds more than a lone lease")
    for token, lease in state.leases.items():
        _that(token == lease.token and token >> 32 <= state.epoch, f"token {token} of the future")
        _that(lease.expiry_ns >= state.expiry_floor_ns or not lease.expiry_ns, "expiry floor")


def _check_campaign(name: str, campaign: CampaignState) -> None:
    waiting: dict[tuple[str, bool], list[int]] = {}
    ended: Counter[str] = Counter()
    open_batches: Counter[int] = Counter()
    for order, case in enumerate(campaign.ordered):
        _that(campaign.cases[case.case.id] is case and case.order == order, f"{name}: order")
        _check_case(case, campaign.campaign.attempts_max)
        if case.end is None:
            open_batches[case.case.batch] += 1
            if not case.live:
                waiting.setdefault((case.rig, case.alone), []).append(order)
        else:
            ended[end_name(case.end)] += 1
    queues = {(rig, False): queue for rig, queue in campaign.backlog.shared.items()}
    queues |= {(rig, True): queue for rig, queue in campaign.backlog.alone.items()}
    _that(queues == waiting, f"{name}: the backlog is not the waiting cases")
    _that(campaign.ended == dict(ended), f"{name}: counts of ended cases")
    _that(campaign.open_batches == dict(open_batches), f"{name}: open batches")
    _that(campaign.leased == sum(bool(c.live) for c in campaign.ordered), f"{name}: leased")
    _that(campaign.attempts == sum(len(c.issued) for c in campaign.ordered), f"{name}: attempts")
    _that(campaign.pinned or not campaign.attempts, f"{name}: leased before it was pinned")


def _check_case(case: CaseState, attempts_max: int) -> None:
    name = case.case.id
    _that(len(case.live) <= LIVE_MAX, f"{name}: {len(case.live)} live tokens")
    _that(set(case.live) <= set(case.issued), f"{name}: a token that was never issued")
    _that(case.issued == sorted(set(case.issued)), f"{name}: tokens do not grow")
    _that(len(case.charges) <= attempts_max, f"{name}: too many charges")
    if case.end is not None:
        _that(not case.live, f"{name}: ended and leased")
    elif not case.live:
        _that(len(case.charges) < attempts_max, f"{name}: waits after its last charge")
    if isinstance(case.end, Committed):
        _that(case.end.result.token in case.issued, f"{name}: committed with a foreign token")


def _that(condition: bool, text: str) -> None:
    if not condition:
        raise AssertionError(text)
