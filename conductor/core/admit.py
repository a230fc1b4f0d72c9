"""Whether a submitted campaign is accepted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import UNSET

from conductor.core.case_table import pack
from conductor.core.facts import Relocated, Submitted
from conductor.core.relocate import moved
from conductor.core.state import PROTECTED_ONLY, CampaignState, State
from conductor.search.libraries import require
from schemas.campaign import CASES_MAX, Campaign, cases_given
from schemas.escape import escape
from schemas.identity import DIGESTS, campaign_digest
from schemas.plan import parse_plan
from schemas.searching.search_points import proposed_count
from schemas.sections.autonomy import open_by_nature
from schemas.sections.stack_identity import difference
from schemas.wire.control import Submit
from schemas.words import counted

CAMPAIGNS_MAX = 5000
"""Most campaigns of one conductor."""

CASES_HELD_MAX = 1_000_000
"""Most cases of all campaigns of one conductor together; each takes about a kilobyte of memory."""

OUT_CHARS_MAX = 1000
"""Longest path of a campaign folder."""
OUT_BYTES_MAX = 3500
"""The same in UTF-8: Linux takes paths of 4096, and names of cases and files follow [bytes]."""
PART_BYTES_MAX = 255
"""Longest name of a folder on Linux [bytes]."""


def out_mistake(out: str) -> str:
    """What is wrong with the path of a campaign folder, whatever is on the disk; or nothing."""
    shown = f"out folder '{escape(out, 200)}'"
    if not out.startswith("/"):
        return f"{shown}: give an absolute path"
    if not out.isprintable() or len(out) > OUT_CHARS_MAX:
        return f"{shown}: {len(out)} characters, allowed: {OUT_CHARS_MAX} that can be printed"
    sizes = [len(part.encode()) for part in out.split("/")]
    if max(sizes) > PART_BYTES_MAX:
        return f"{shown}: a name of {max(sizes)} bytes in it, allowed: {PART_BYTES_MAX}"
    if (size := len(out.encode())) > OUT_BYTES_MAX:
        return f"{shown}: {size} bytes, allowed: {OUT_BYTES_MAX}"
    return ""


def _unfit(state: State, request: Submit, out: str) -> str:
    """Why a campaign of a new name has no place here: looked at before its cases are expanded,
    which takes seconds."""
    if error := out_mistake(out):
        return error
    count = cases_given(request.campaign)
    if count <= CASES_MAX and (error := _too_much(state, count)):
        return error
    for other in state.campaigns.values():
        if other.out == out:
            return f"{out} holds campaign '{other.campaign.campaign}'; give it another out folder"
    return ""


def _too_much(state: State, cases: int) -> str:
    held = sum(len(campaign.cases) for campaign in state.campaigns.values())
    hint = "start another conductor with another --state folder"
    if len(state.campaigns) >= CAMPAIGNS_MAX:
        return f"{len(state.campaigns)} campaigns are here, at most {CAMPAIGNS_MAX}; {hint}"
    if held + cases > CASES_HELD_MAX:
        return f"{held} cases are here, {cases} more given, at most {CASES_HELD_MAX}; {hint}"
    return ""


def _conflict(
    state: State, known: CampaignState, campaign: Campaign, digest: str, software: str
) -> str:
    """Why a campaign is none that is known by its name, in one line."""
    name = campaign.campaign
    # `conductor run` has a state folder per campaign; one that serves knows campaigns by name.
    alone = known.out == state.config.folder
    anew = "give another folder with --out (`conductor serve`: --state)"
    elsewhere = anew if alone else "submit it under another name"
    if known.digests != DIGESTS:
        return (
            f"{name}: {known.out} was begun by another version of drivetwin, whose digests are "
            f"taken over other things; finish it with that version, or {elsewhere}"
        )
    before, now = known.campaign.stack_identity, campaign.stack_identity
    what = difference(before, now) if before.digest else ""
    if what:
        return (
            f"{name}: {known.out} was begun with another version of the stack: {what} (stack "
            f"digest {before.digest[:12]}, now {now.digest[:12] or 'none'}); put it back, or "
            f"{elsewhere}"
        )
    for plugin, version in known.campaign.plugins.items():
        if (here := campaign.plugins.get(plugin, version)) != version:
            return (
                f"{name}: {known.out} was begun with plug-in '{plugin}' {version}, installed is "
                f"{here}; put it back, or {elsewhere}"
            )
    old, new = known.campaign.files | before.named, campaign.files | now.named
    other = [path for path, sha in old.items() if new.get(path, sha) != sha]
    if other:
        return (
            f"{name}: {known.out} was begun with another {escape(other[0], 200)}, or file that it "
            f"names (SHA-256 {old[other[0]][:12]}, now {new[other[0]][:12]}); put it back, or "
            f"{elsewhere}"
        )
    older = known.software and software and known.software != software
    why = " (or the software, which is another now, has new defaults)" if older else ""
    return (
        f"{name}: {known.out} holds a campaign of this name with other cases{why} (digest "
        f"{known.digest[:12]}, given {digest[:12]}); give it another name or another out folder"
    )


def _other_plugins(request: Submit, here: Campaign) -> str:
    """A plug-in of the submitter that is not the one with which cases are made here; or nothing."""
    plugins = request.campaign.get("plugins") or {}
    for name, version in here.plugins.items():
        if plugins.get(name, version) != version:
            return (
                f"uses plug-in '{escape(name, 80)}' {escape(str(plugins[name]), 80)} where it was "
                f"submitted, the conductor has {version}; install the same version on both sides"
            )
    return ""


def _as_begun(known: CampaignState | None, given: dict[str, Any]) -> Mapping[str, object]:
    """A submission of a search that is known, with the first generations that it was begun with:
    what was proposed is read back, wherever it is submitted again."""
    search = given.get("search")
    if known is None or known.search is None or not isinstance(search, dict):
        return given
    before = known.campaign.search
    assert before is not UNSET
    begun = {"first": before.first, "proposed": before.proposed[: before.chains]}
    asked = {key: value for key, value in search.items() if key != "forks"}
    return {**given, "search": {**asked, **begun}}


def _unbegun(campaign: Campaign) -> str:
    """Why a search cannot begin here as it was submitted, or nothing."""
    search = campaign.search
    if search is UNSET or search.chosen:
        return ""
    given = len(search.proposed)
    if given != search.chains or len(search.first) != proposed_count(search):
        wanted = "one" if search.chains == 1 else f"one in each of {search.chains} chains"
        return (
            f"search.proposed: {counted(given, 'generation')} given, a search begins with "
            f"{wanted}; submit it by `conductor run` or `conductor submit`"
        )
    try:
        require(search)
    except ValueError as error:
        return f"where the conductor runs, {error}"
    return ""


def _begun_with(known: CampaignState) -> str:
    """Digest of a campaign as it was submitted, before its search added cases."""
    search = known.campaign.search
    if known.search is None or search is UNSET:
        return known.digest
    begun = msgspec.structs.replace(search, proposed=search.proposed[: search.chains], forks=UNSET)
    campaign = msgspec.structs.replace(known.campaign, search=begun)
    return campaign_digest(campaign, [c.case for c in known.ordered[: len(search.first)]])


def admit(state: State, request: Submit) -> tuple[Submitted | Relocated | None, list[str]]:
    """Check a submission.

    Returns:
        The fact and no errors; or the fact that its files were moved, or None, and no errors: the
        campaign is known, this is a resume; or None and the errors, one line each.
    """
    escaped_name = escape(str(request.campaign.get("campaign", "campaign")), 80)
    out = request.out or f"{state.config.folder}/{escaped_name}"
    if escaped_name not in state.campaigns and (error := _unfit(state, request, out)):
        return None, [f"{escaped_name}: {error}"]
    view = {} if state.config.view is None else {"view": state.config.view.value}
    # The message is all that a conductor knows of a campaign, and what the journal keeps of it: a
    # plan that a client of the same process has made is no part of a submission.
    given = _as_begun(state.campaigns.get(escaped_name), {**request.campaign, **view})
    plan, mistakes = parse_plan(given)
    if plan is None:
        return None, [mistake.line(escaped_name) for mistake in mistakes]
    campaign, cases = plan.campaign, plan.cases
    name = campaign.campaign
    if why := _unbegun(campaign):
        return None, [f"{name}: {why}"]
    if state.config.protected and (why := open_by_nature(campaign.autonomy)):
        return None, [f"{name}: {why}; {PROTECTED_ONLY}"]
    if error := _other_plugins(request, campaign):
        return None, [f"{name}: {error}"]
    digest = campaign_digest(campaign, cases)
    known = state.campaigns.get(name)
    if known is not None and _begun_with(known) == digest:
        paths = moved(known.campaign, campaign)
        return (Relocated(name, paths) if paths else None), []
    if known is not None:
        return None, [_conflict(state, known, campaign, digest, request.software)]
    content = msgspec.to_builtins(campaign)
    fact = Submitted(
        campaign=content,
        cases=pack(cases),
        digest=digest,
        out=out,
        software=request.software,
        priority=request.priority,
        digests=DIGESTS,
    )
    return fact, []
