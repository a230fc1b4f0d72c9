"""What people ask for: pause, resume, cancel, retry, drain."""

from __future__ import annotations

from conductor.core.facts import CaseEnded, Paused, Retried, WorkerDraining
from conductor.core.state import CampaignState, CaseState
from conductor.core.turn import RequestTurn
from schemas.wire.control import Control

SHOWN_MAX = 5
"""Most names listed in an error."""


def control(turn: RequestTurn, request: Control) -> tuple[str, int]:
    """Carry out a request.

    Returns:
        What is wrong with it, in one line, or nothing; and how many cases or workers it changed.
        What is so already is no mistake: requests may be repeated.
    """
    if request.action == "drain":
        return _drain(turn, request.worker)
    campaign = turn.state.campaigns.get(request.campaign)
    if campaign is None:
        return f"{_no('campaign', request.campaign, list(turn.state.campaigns))}", 0
    case = campaign.cases.get(request.case)
    if request.case and case is None:
        return f"{request.campaign}: {_no('case', request.case, list(campaign.cases))}", 0
    if request.action in ("pause", "resume"):
        return _pause(turn, campaign, case, request.action == "pause")
    if request.action == "cancel":
        return _cancel(turn, campaign, case)
    return _retry(turn, campaign, case)


def _drain(turn: RequestTurn, name: str) -> tuple[str, int]:
    worker = turn.state.workers.get(name)
    if worker is None:
        return _no("worker", name, list(turn.state.workers)), 0
    if worker.draining:
        return "", 0
    turn.emit(WorkerDraining(worker=name))
    return "", 1


def _pause(
    turn: RequestTurn, campaign: CampaignState, case: CaseState | None, paused: bool
) -> tuple[str, int]:
    name = campaign.campaign.campaign
    if case is None:
        if campaign.paused == paused:
            return "", 0
        turn.emit(Paused(campaign=name, case="", paused=paused))
        return "", campaign.left
    if case.ended:
        return f"{name}: case '{case.case.id}' has ended; pause and resume are for the others", 0
    if case.paused == paused:
        return "", 0
    turn.emit(Paused(campaign=name, case=case.case.id, paused=paused))
    return "", 1


def _cancel(turn: RequestTurn, campaign: CampaignState, case: CaseState | None) -> tuple[str, int]:
    name = campaign.campaign.campaign
    chosen = [case] if case is not None else campaign.ordered
    running = [entry for entry in chosen if not entry.ended]
    if case is not None and not running and not _was(case, "cancelled"):
        return f"{name}: case '{case.case.id}' has ended; its outcome stays", 0
    for cancelled in running:
        turn.emit(
            CaseEnded(
                campaign=name,
                case=cancelled.case.id,
                outcome="cancelled",
                reason="cancelled on request",
            )
        )
    return "", len(running)


def _retry(turn: RequestTurn, campaign: CampaignState, case: CaseState | None) -> tuple[str, int]:
    name = campaign.campaign.campaign
    chosen = [case] if case is not None else campaign.ordered
    again = [entry for entry in chosen if isinstance(entry.end, CaseEnded)]
    if case is not None and not again and case.ended:
        return (
            f"{name}: case '{case.case.id}' has a committed result, which stays; "
            "unresolved and cancelled cases can be retried",
            0,
        )
    for retried in again:
        turn.emit(Retried(campaign=name, case=retried.case.id))
    return "", len(again)


def _was(case: CaseState, outcome: str) -> bool:
    return isinstance(case.end, CaseEnded) and case.end.outcome == outcome


def _no(kind: str, name: str, known: list[str]) -> str:
    shown = ", ".join(known[:SHOWN_MAX]) + (", ..." if len(known) > SHOWN_MAX else "")
    return f"no {kind} '{name[:80]}' here; {kind}s: {shown or 'none'}"
