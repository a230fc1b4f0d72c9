"""Ends of attempts: with a result, without one, or too late."""

from __future__ import annotations

from collections.abc import Sequence

from conductor.core.facts import (
    ALONE,
    AttemptEnded,
    CaseEnded,
    Charge,
    Committed,
    LateAttempt,
    RecordingStored,
)
from conductor.core.lease import POLICIES, expired, first_expiry_ns
from conductor.core.session import issued_to, mistake_of
from conductor.core.state import CaseState, LiveLease, State, WorkerState
from conductor.core.turn import RequestTurn
from schemas.wire.control import Recorded, Release, Result
from schemas.words import counted

DETAIL_CHARS_MAX = 2000
"""Longest reason kept of an attempt [characters]."""
STEERED_MAX = 16
"""Number of attempts with interventions after which a case stays unresolved: they are uncharged,
and a script that finds every new one would keep it for ever. A retry allows as many again."""
LOSSES_ANYWAY = 4
"""Multiple of the usual number of losses that quarantines a case even if others died as well."""


def expire(turn: RequestTurn) -> None:
    """Leases whose time is over are lost."""
    over = expired(turn.state, turn.now_ns)
    by_worker: dict[str, list[LiveLease]] = {}
    for lease in over:
        by_worker.setdefault(lease.worker, []).append(lease)
    for worker, leases in by_worker.items():
        _lose(turn, worker, leases)
    if over or turn.now_ns >= turn.state.expiry_floor_ns:
        turn.state.expiry_floor_ns = first_expiry_ns(turn.state)


def commit(turn: RequestTurn, result: Result, worker: WorkerState) -> bool:
    """Record a result of ``worker``, who has proved its session; False if it is fenced."""
    state = turn.state
    case = state.case((result.campaign, result.case))
    issued = issued_to(case, worker, result.token) if case is not None else None
    if case is None or issued is None:
        return False
    mistake = mistake_of(result, case, issued)
    if result.token in case.live:
        lease = state.leases[result.token]
        if mistake:
            # Not for ever again: whatever makes such results ends in quarantine.
            end_attempt(turn, lease, "crash", f"its result is refused: {mistake}")
            return False
        turn.emit(
            Committed(
                result=result,
                worker=lease.worker,
                device_class=worker.joined.device_class,
                attempt=lease.attempt,
            )
        )
        return True
    if mistake:
        return False
    end = case.end
    if (
        isinstance(end, Committed)
        and end.result.token == result.token
        and end.result.kpi_sha256 == result.kpi_sha256
    ):
        return True
    turn.emit(LateAttempt(result=result, worker=worker.joined.worker))
    return False


def keep_recording(turn: RequestTurn, request: Recorded, worker: WorkerState) -> str:
    """Note that the recording of an attempt lies in the store; or why not, in a line.

    It must be the attempt that ``worker``, who has proved its session, has committed; the first
    recording that it names of it counts.
    """
    if not turn.state.config.store:
        return "this conductor has no result store"
    case = turn.state.case((request.campaign, request.case))
    end = case.end if case is not None else None
    if (
        case is None
        or issued_to(case, worker, request.token) is None
        or not isinstance(end, Committed)
        or end.result.token != request.token
    ):
        return (
            f"case {request.case[:80]!r} of campaign {request.campaign[:80]!r}: token "
            f"{request.token} is not one that worker {request.worker} has committed"
        )
    if case.recording is None:
        turn.emit(
            RecordingStored(
                campaign=request.campaign,
                case=request.case,
                token=request.token,
                recording=request.recording,
            )
        )
    elif case.recording != request.recording:
        return f"case {request.case[:80]!r} has another recording already"
    return ""


def end_attempt(turn: RequestTurn, lease: LiveLease, reason: Release, detail: str) -> None:
    """The lease ends without a result; the last charge ends the case as well."""
    policy = POLICIES[reason]
    case = turn.state.campaigns[lease.key[0]].cases[lease.key[1]]
    group = ALONE if policy.alone else case.group
    _emit_end(turn, lease, reason, detail, group)


def end_suspects(
    turn: RequestTurn, leases: Sequence[LiveLease], reason: Release, detail: str
) -> None:
    """The cases of one rig that died: uncharged, and leased again in two halves.

    A half shares its next rig with nobody else, so that the guilty case dies alone in the end and
    is the only one that is charged.
    """
    middle = (len(leases) + 1) // 2
    for half in (leases[:middle], leases[middle:]):
        group = turn.state.groups + 1 if len(half) > 1 else ALONE
        for lease in half:
            _emit_end(turn, lease, reason, detail, group, evidence=reason == "lost")


def _lose(turn: RequestTurn, worker: str, leases: list[LiveLease]) -> None:
    """A worker fell silent; if it alone did, what it ran may be the reason."""
    state = turn.state
    whole = len(leases) == len(state.workers[worker].tokens)
    vanished = state.workers[worker].vanished
    detail = "its session vanished" if vanished else "no sign of life from the worker"
    cases = [state.campaigns[lease.key[0]].cases[lease.key[1]] for lease in leases]
    # Those that died with one of these cases are no alibi for it.
    apart = {worker}.union(*(case.lost for case in cases))
    if whole and _others_live(state, apart, turn.now_ns):
        end_suspects(turn, leases, "lost", detail)
    else:
        for lease in leases:
            end_attempt(turn, lease, "lost", detail)
    if whole and len(leases) == 1:
        _judge_loss(turn, leases[0])


def _others_live(state: State, apart: set[str], now_ns: int) -> bool:
    """No other worker fell silent of late: a storm, a dead node, the end of an allocation."""
    for name, other in state.workers.items():
        silent_ns = now_ns - other.seen_ns
        if name in apart or silent_ns > 3 * state.config.ttl_ns:
            continue
        if other.vanished or 2 * silent_ns > state.config.ttl_ns:
            return False
    return True


def _emit_end(
    turn: RequestTurn,
    lease: LiveLease,
    reason: Release,
    detail: str,
    group: int,
    evidence: bool = False,
) -> None:
    campaign = turn.state.campaigns[lease.key[0]]
    case = campaign.cases[lease.key[1]]
    turn.emit(
        AttemptEnded(
            campaign=lease.key[0],
            case=lease.key[1],
            token=lease.token,
            reason=reason,
            charged=POLICIES[reason].charged,
            alone=group == ALONE,
            detail=detail[:DETAIL_CHARS_MAX],
            group=group,
            evidence=evidence,
        )
    )
    if not case.live and len(case.charges) >= campaign.campaign.attempts_max:
        _quarantine(turn, lease, case, _told("charged attempt", case.charges))
    elif not case.live and reason == "intervened" and len(case.steered) % STEERED_MAX == 0:
        text = (
            f"{len(case.steered)} attempts were steered by hand, the last one: {case.steered[-1]}"
        )
        _quarantine(turn, lease, case, text)


def _judge_loss(turn: RequestTurn, lease: LiveLease) -> None:
    """Workers are killed for many reasons: one or two that died with a case prove nothing."""
    campaign = turn.state.campaigns[lease.key[0]]
    case = campaign.cases[lease.key[1]]
    if case.live or case.ended:
        return
    least = max(campaign.campaign.attempts_max, turn.state.config.losses_min)
    if len({loss.worker for loss in case.losses}) >= least:
        _quarantine(turn, lease, case, _told("loss", case.losses, "losses"))
    elif case.lost_times >= LOSSES_ANYWAY * least:
        _quarantine(turn, lease, case, f"lost with its worker {case.lost_times} times")


def _quarantine(turn: RequestTurn, lease: LiveLease, case: CaseState, text: str) -> None:
    turn.emit(
        CaseEnded(
            campaign=lease.key[0],
            case=lease.key[1],
            outcome="unresolved",
            reason=f"quarantined: {text}",
            evidence=[*case.charges, *case.losses],
        )
    )


def _told(one: str, charges: Sequence[Charge], many: str = "") -> str:
    workers = len({charge.worker for charge in charges})
    return (
        f"{counted(len(charges), one, many)} on {counted(workers, 'worker')}, "
        f"the last one: {charges[-1]}"
    )
