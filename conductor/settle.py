"""How attempts end: with a result, without one, or too late."""

from __future__ import annotations

from conductor.facts import AttemptEnded, CaseEnded, Committed, LateAttempt
from conductor.lease import POLICIES, expired, next_expiry_ns
from conductor.state import LiveLease
from conductor.turn import Turn
from schemas.messages import Release, Result

DETAIL_CHARS_MAX = 2000
"""Longest reason kept of an attempt [characters]."""


def expire(turn: Turn) -> None:
    """Leases whose time is over are lost."""
    over = expired(turn.state, turn.now_ns)
    for lease in over:
        end_attempt(turn, lease, "lost", "no sign of life from the worker")
    if over or turn.now_ns >= turn.state.expiry_floor_ns:
        turn.state.expiry_floor_ns = next_expiry_ns(turn.state)


def commit(turn: Turn, result: Result, worker: str) -> bool:
    """Record a result; False if it is fenced."""
    state = turn.state
    case = state.case((result.campaign, result.case))
    if case is None:
        return False
    if result.token in case.live:
        lease = state.leases[result.token]
        turn.emit(
            Committed(
                result=result,
                worker=lease.worker,
                device_class=state.workers[lease.worker].joined.device_class,
                attempt=lease.attempt,
            )
        )
        return True
    end = case.end
    if (
        isinstance(end, Committed)
        and end.result.token == result.token
        and end.result.kpi_sha256 == result.kpi_sha256
    ):
        return True
    known = any(
        late.result.token == result.token and late.result.kpi_sha256 == result.kpi_sha256
        for late in case.late
    )
    if result.token in case.issued and not known:
        turn.emit(LateAttempt(result=result, worker=worker))
    return False


def end_attempt(turn: Turn, lease: LiveLease, reason: Release, detail: str) -> None:
    """The lease ends without a result; the last charge ends the case as well."""
    campaign = turn.state.campaigns[lease.key[0]]
    case = campaign.cases[lease.key[1]]
    policy = POLICIES[reason]
    turn.emit(
        AttemptEnded(
            campaign=lease.key[0],
            case=lease.key[1],
            token=lease.token,
            reason=reason,
            charged=policy.charged,
            alone=policy.alone or case.alone,
            detail=detail[:DETAIL_CHARS_MAX],
        )
    )
    if not case.live and len(case.charges) >= campaign.campaign.attempts_max:
        count = len(case.charges)
        text = (
            f"{count} charged attempt{'s' if count > 1 else ''}, the last one: {case.charges[-1]}"
        )
        turn.emit(
            CaseEnded(campaign=lease.key[0], case=lease.key[1], outcome="unresolved", reason=text)
        )
