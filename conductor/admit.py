"""Whether a submitted campaign is accepted."""

from __future__ import annotations

import msgspec

from conductor.case_table import pack
from conductor.facts import Submitted
from conductor.state import State
from schemas.campaign import parse_cases
from schemas.identity import campaign_digest
from schemas.messages import Submit
from schemas.words import plain

CAMPAIGNS_MAX = 5000
"""Most campaigns of one conductor."""

CASES_HELD_MAX = 1_000_000
"""Most cases of all campaigns of one conductor together; each takes about a kilobyte of memory."""

OUT_CHARS_MAX = 1000
"""Longest path of a campaign folder."""


def _too_much(state: State, cases: int) -> str:
    held = sum(len(campaign.cases) for campaign in state.campaigns.values())
    hint = "start another conductor with another --state folder"
    if len(state.campaigns) >= CAMPAIGNS_MAX:
        return f"{len(state.campaigns)} campaigns are here, at most {CAMPAIGNS_MAX}; {hint}"
    if held + cases > CASES_HELD_MAX:
        return f"{held} cases are here, {cases} more given, at most {CASES_HELD_MAX}; {hint}"
    return ""


def admit(state: State, request: Submit) -> tuple[Submitted | None, list[str]]:
    """Check a submission.

    Returns:
        The fact and no errors; or None and no errors: the campaign is known, this is a resume; or
        None and the errors, one line each.
    """
    given = str(request.campaign.get("campaign", "campaign"))[:80]
    view = {} if state.config.view is None else {"view": state.config.view.value}
    campaign, cases, mistakes = parse_cases({**request.campaign, **view})
    if campaign is None:
        return None, [mistake.line(given) for mistake in mistakes]
    name = campaign.campaign
    digest = campaign_digest(campaign, cases)
    known = state.campaigns.get(name)
    if known is not None and known.digest == digest:
        return None, []
    if known is not None:
        older = known.software and request.software and known.software != request.software
        why = " (or the software, which is another now, has new defaults)" if older else ""
        return None, [
            f"{name}: {known.out} holds a campaign of this name with other cases{why} (digest "
            f"{known.digest[:12]}, given {digest[:12]}); give it another name or another out folder"
        ]
    out = request.out or f"{state.config.folder}/{name}"
    if not out.startswith("/"):
        return None, [f"{name}: out folder '{plain(out, 200)}': give an absolute path"]
    if not out.isprintable() or len(out) > OUT_CHARS_MAX:
        return None, [
            f"{name}: out folder '{plain(out, 200)}': {len(out)} characters, allowed: "
            f"{OUT_CHARS_MAX} that can be printed"
        ]
    if error := _too_much(state, len(cases)):
        return None, [f"{name}: {error}"]
    for other in state.campaigns.values():
        if other.out == out:
            return None, [
                f"{name}: {out} holds campaign '{other.campaign.campaign}'; "
                "give it another out folder"
            ]
    content = msgspec.to_builtins(campaign)
    fact = Submitted(
        campaign=content,
        cases=pack(cases),
        digest=digest,
        out=out,
        software=request.software,
        priority=request.priority,
    )
    return fact, []
