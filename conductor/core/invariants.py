"""What must hold after every fact; tests call :func:`check`, and a mistake names itself."""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from itertools import pairwise

from conductor.core.facts import ALONE, SHARED, Committed
from conductor.core.state import CampaignState, Issued, State, end_name, unsealed

LIVE_MAX = 2
"""Most live tokens of one case."""


@lru_cache(maxsize=4096)
def _end_of(sealed: bytes) -> tuple[str, int | None]:
    """Name of an end, and the token of its result, if it has one.

    Kept, as all that is said of one case alone: every case is looked at after every fact, and few
    have changed.
    """
    end = unsealed(sealed)
    return end_name(end), end.result.token if isinstance(end, Committed) else None


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
        groups = {lease.group for lease in leases}
        _that(len(groups) <= 1, f"worker {worker_id} mixes groups {groups}")
        _that(groups != {ALONE} or len(leases) == 1, f"worker {worker_id} holds two lone leases")
        _check_group(state, worker_id, groups)
    _that(state.left == sum(c.left for c in state.campaigns.values()), "cases left")
    for token, lease in state.leases.items():
        _that(token == lease.token and token >> 32 <= state.epoch, f"token {token} of the future")
        _that(lease.expiry_ns >= state.expiry_floor_ns or not lease.expiry_ns, "expiry floor")


def _check_group(state: State, worker_id: str, groups: set[int]) -> None:
    """Suspects share a rig with their own half only."""
    for token in state.workers[worker_id].tokens:
        lease = state.leases[token]
        case = state.case(lease.key)
        _that(case is not None and token in case.live, f"token {token} of no case")
        _that(groups == {SHARED} or not lease.speculative, f"suspect {lease.key} runs twice")


def _check_campaign(name: str, campaign: CampaignState) -> None:
    waiting: dict[str, dict[int, list[int]]] = {}
    ended: Counter[str] = Counter()
    committed = 0
    open_batches: Counter[int] = Counter()
    attempts_max = campaign.campaign.attempts_max
    for order, case in enumerate(campaign.ordered):
        sealed, charges = case.sealed, len(case.charges)
        wrong = _contradiction(case.issued, case.live, charges, sealed, attempts_max)
        if campaign.cases[case.case.id] is not case or case.order != order:
            wrong = "order"
        if wrong:
            raise AssertionError(f"{name}: {case.case.id}: {wrong}")
        if sealed:
            end, token = _end_of(sealed)
            ended[end] += 1
            committed += token is not None
            _that(case.recording is None or token is not None, f"{name}: {case.case.id}: recording")
        else:
            _that(case.recording is None, f"{name}: {case.case.id}: recording before its end")
            open_batches[case.case.variation.batch] += 1
            if case.waits:
                waiting.setdefault(case.rig, {}).setdefault(case.group, []).append(-order)
    lanes = {r: {g: q[::-1] for g, q in groups.items()} for r, groups in waiting.items()}
    _that(campaign.backlog.lanes == lanes, f"{name}: the backlog is not the waiting cases")
    count = sum(len(lane) for groups in lanes.values() for lane in groups.values())
    _that(len(campaign.backlog) == count, f"{name}: length of the backlog")
    _that(campaign.left == len(campaign.ordered) - sum(ended.values()), f"{name}: left")
    _that(campaign.durations.total == committed, f"{name}: durations")
    _that(campaign.ended == dict(ended), f"{name}: counts of ended cases")
    _that(campaign.open_batches == dict(open_batches), f"{name}: open batches")
    _that(campaign.leased == sum(bool(c.live) for c in campaign.ordered), f"{name}: leased")
    _that(campaign.attempts == sum(c.attempts for c in campaign.ordered), f"{name}: attempts")
    _that(campaign.pinned or not campaign.attempts, f"{name}: leased before it was pinned")


@lru_cache(maxsize=4096)
def _contradiction(
    issued: tuple[Issued, ...],
    live: tuple[int, ...],
    charges: int,
    sealed: bytes,
    attempts_max: int,
) -> str:
    """What is wrong with a case, or nothing."""
    if len(live) > LIVE_MAX:
        return f"{len(live)} live tokens"
    tokens = [record.token for record in issued]
    if not set(live) <= set(tokens):
        return "a token that was never issued"
    if any(one >= other for one, other in pairwise(tokens)):
        return "tokens do not grow"
    if charges >= attempts_max + LIVE_MAX:
        return "too many charges"
    if not sealed:
        spent = not live and charges >= attempts_max
        return "waits after its last charge" if spent else ""
    return "ended and leased" if live else ""


def _that(condition: bool, text: str) -> None:
    if not condition:
        raise AssertionError(text)
