"""What a certificate may have run on the machine of who audits it.

Its campaign was written by somebody else. A stack of ours runs in a sandbox without asking;
whatever else would be loaded or started needs the auditor's word, and is shown to him first.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from schemas.campaign import Campaign
from schemas.escape import escape
from schemas.kinds.bridge import NONE
from schemas.plan import Plan
from schemas.sections.autonomy import open_by_nature
from twin.base.errors import UsageError
from twin.sandbox.possible import why_not

SHIPPED_STACKS = frozenset(
    {"devkit.aeb:AebStack", "devkit.fusion:FusionStack", "devkit.idle:IdleStack"}
)
"""Stacks that run without asking: no parameter of theirs starts or loads anything. An entry point
is looked up as Python does it, so a prefix would let any class of any library in."""

SHOWN_CHARS_MAX = 300
"""Longest command line that is shown [characters]."""


@dataclass(frozen=True, slots=True)
class Consent:
    """The auditor's word."""

    stack: bool = False
    """``--run-stack``: what the certificate names as its stack may run here."""
    unprotected: bool = False
    """``--allow-unprotected``: it may run without a sandbox."""
    files: Path | None = None
    """``--files``: folder of the files that the campaign names by digest."""


def require_consent(plan: Plan, consent: Consent, shown: str) -> None:
    """Refuse what the auditor has not allowed; nothing is read, imported or started.

    Raises:
        UsageError: one line that shows what would run.
    """
    campaign = plan.campaign
    if campaign.simulator == "noop":
        return
    foreign = _foreign(plan)
    if foreign and not consent.stack:
        raise UsageError(
            f"{shown}: would run {foreign} on this machine; if you know what that is, give "
            "--run-stack"
        )
    if (open_here := _open(campaign)) and not consent.unprotected:
        raise UsageError(
            f"{shown}: its stack would run without a sandbox; give --allow-unprotected if it may "
            f"do whatever you may. There is none because: {open_here}"
        )


def _foreign(plan: Plan) -> str:
    """What would run that is not ours, in words; empty: nothing."""
    campaign, autonomy = plan.campaign, plan.campaign.autonomy
    if autonomy.command:
        words = f"the command `{_shown(shlex.join(autonomy.command))}`"
        if autonomy.repository is not None:
            repository = autonomy.repository
            setup = f" after `{_shown(repository.setup)}`" if repository.setup else ""
            words += f" of {_shown(repository.url)} at {_shown(repository.ref)}{setup}"
        if autonomy.image is not None:
            words += f" in the image {_shown(autonomy.image.path)}"
        return words
    if autonomy.bridge != NONE:
        return f"nodes that somebody else starts, behind the bridge {_shown(autonomy.bridge)},"
    if autonomy.stack not in SHIPPED_STACKS:
        return f"the stack {_shown(autonomy.stack)}"
    if campaign.stack_identity.digest or autonomy.files:
        return f"files beside the stack {_shown(autonomy.stack)}"
    kinds = plan.kinds_of_others()
    if kinds:
        return f"the plug-in {_shown(' '.join(kinds[0].plugin))}"
    return ""


def _open(campaign: Campaign) -> str:
    """Why the stack would have no sandbox here; empty: it has one."""
    autonomy = campaign.autonomy
    if autonomy.placement != "worker":
        return open_by_nature(autonomy)
    if autonomy.image is not None and autonomy.image.runtime in ("auto", "podman"):
        return "podman's containers do not start in one"
    return why_not()


def _shown(text: str) -> str:
    return escape(text, SHOWN_CHARS_MAX)
