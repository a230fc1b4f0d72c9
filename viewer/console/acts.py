"""What a page may have done to a campaign, a worker or a running case, and what that costs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from schemas.files.json_text import JsonError, decode_json
from schemas.wire.interventions import Action, changes_simulation
from schemas.words import counted
from twin.base.errors import UsageError

Name = Annotated[str, Meta(max_length=256)]
ActName = Literal["pause", "resume", "drain", "cancel", "intervene"]
ACTS: tuple[ActName, ...] = ("pause", "resume", "drain", "cancel", "intervene")


class ActRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks; unknown keys are errors."""

    run: Name = ""
    case: Name = ""
    worker: Name = ""
    confirm: bool = False
    """False: say what it would do, and do nothing."""
    campaign: Name = ""
    """Of an intervention: campaign, and token of the attempt, as the leases say."""
    token: int = 0
    settings: dict[str, str | float | bool] = {}
    action: Action | None = None


def parse_act(body: bytes) -> ActRequest:
    """The request of a page.

    Raises:
        UsageError: it is none; one line.
    """
    try:
        return decode_json(body, ActRequest)
    except (JsonError, ValueError) as error:
        raise UsageError(str(error)) from None


def warning_of(act: ActName, request: ActRequest, campaign: str, left: int | None) -> str:
    """What an act does, also to the verdicts: what a person confirms.

    Args:
        act: which one.
        request: what it is about.
        campaign: name of the campaign.
        left: cases that have not ended; None: nobody knows.

    Raises:
        UsageError: it says too little.
    """
    what = f"case {request.case} of {campaign}" if request.case else campaign
    match act:
        case "pause":
            return (
                f"No more of {what} is leased until it is resumed; what runs goes on. "
                "No verdict changes."
            )
        case "resume":
            return f"What waits of {what} is leased again. No verdict changes."
        case "drain":
            if not request.worker:
                raise UsageError("drain: say which worker")
            return (
                f"Worker {request.worker} finishes or gives back its cases and leaves; they run "
                "on other workers. No verdict changes."
            )
        case "cancel":
            cases = request.case or ("all cases" if left is None else counted(left, "case"))
            return (
                f"{campaign}: {cases} that have not ended end as cancelled: without a verdict, "
                "which is never a pass. Outcomes that are there stay."
            )
    if changes(request):
        return (
            f"The attempt of {what} ends as intervened: it gets no verdict, is not "
            "charged, and the case runs once more, unchanged."
        )
    return f"Pace of {what} changes; no byte of its result does, and its verdict stays."


def changes(request: ActRequest) -> bool:
    """Whether an intervention costs the attempt its verdict; settings do, but for the pace."""
    if request.action is not None and changes_simulation(request.action):
        return True
    return any(name != "pace" for name in request.settings)


def panel_body(request: ActRequest) -> bytes:
    """The intervention as :meth:`viewer.browser.desk.Desk.do` takes it.

    Raises:
        UsageError: it asks for nothing.
    """
    if not request.settings and request.action is None:
        raise UsageError("intervene: give settings or an action")
    body: dict[str, Any] = {
        "campaign": request.campaign,
        "case": request.case,
        "token": request.token,
        "settings": request.settings,
    }
    if request.action is not None:
        body["action"] = request.action
    return msgspec.json.encode(body)
