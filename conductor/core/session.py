"""Proof of who speaks: a worker's requests show the secret of the session that joined under its id.

What a result must fit stands with its token: the session that got the lease, and its attempt.
"""

from __future__ import annotations

from conductor.core.state import CaseState, Issued, State, WorkerState
from schemas.wire.codec import WireError, decode
from schemas.wire.control import Beat, Bye, Next, Recorded, Result, Sealed
from schemas.wire.delivery import AttemptFiles, Delivery
from twin.fabric.session import is_sealed, proves

UNKNOWN_WORKER = "unknown worker, say hello"


def speaker(
    state: State, request: Next | Beat | Bye | Recorded | Delivery
) -> tuple[WorkerState | None, str]:
    """The worker whose request this is; or None and why it is nobody's, in a line."""
    worker = state.workers.get(request.worker)
    if worker is None:
        return None, UNKNOWN_WORKER
    if not proves(request.session, worker.joined.session):
        return None, not_its_session(request.worker)
    return worker, ""


def not_its_session(worker: str) -> str:
    """The answer to whoever speaks for a worker without its secret."""
    return (
        f"worker {worker}: the session's secret is not that of the process that joined; say hello "
        "with an id of your own"
    )


def opened(state: State, sealed: Sealed) -> tuple[Result, WorkerState] | None:
    """A sealed result and whose it is; None: nobody here has sealed it, or it is damaged."""
    worker = state.workers.get(sealed.worker)
    if worker is None or not is_sealed(worker.joined.signer, sealed.result, sealed.seal):
        return None
    try:
        result: Result = decode(sealed.result, Result)
    except WireError:
        return None
    return (result, worker) if result.token == sealed.token else None


def issued_to(case: CaseState, worker: WorkerState, token: int) -> Issued | None:
    """The token as this worker got it; None: it got none such, or that is too long ago."""
    for issued in case.issued:
        if issued.token == token and issued.session == worker.joined.session:
            return issued
    return None


def mistake_of(result: Result, case: CaseState, issued: Issued) -> str:
    """What of a result does not fit the attempt that it is of, in a few words; or nothing."""
    if result.attempt_dir and result.attempt_dir != (
        folder := f"cases/{case.case.id}/attempt-{issued.attempt}"
    ):
        return f"it names the folder {result.attempt_dir}, its attempt has {folder}"
    if case.case.rig.simulator == "noop" or (result.outcome == "failed" and not result.kpi_sha256):
        return ""  # nothing was simulated, or the case failed before its first tick
    if not result.kpi_sha256:
        return "it is a verdict without a digest of its KPIs"
    return "" if result.attempt_dir else "it has KPIs and names no folder"


def folder_for(state: State, message: Delivery) -> tuple[str, str]:
    """The campaign folder that a worker asks for, or brings an attempt's files to; or why not, in
    a line."""
    worker, error = speaker(state, message)
    if worker is None:
        return "", error
    campaign = state.campaigns.get(message.campaign)
    if campaign is None:
        return "", f"{message.campaign}: no such campaign here"
    if isinstance(message, AttemptFiles):
        case = campaign.cases.get(message.case)
        session = worker.joined.session
        if case is None or not any(
            issued.attempt == message.attempt and issued.session == session
            for issued in case.issued
        ):
            return "", (
                f"{message.campaign}: attempt {message.attempt} of case {message.case[:80]!r} is "
                f"not one of worker {message.worker}"
            )
    return campaign.out, ""
