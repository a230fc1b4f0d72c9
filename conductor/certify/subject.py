"""The campaign in a certificate: what follows from it, and how it is made ready to run here.

Somebody else wrote it. What follows from it alone is held against what was signed before a file is
touched. A path in it is a name: files are looked for in the folder that the auditor gives, by their
content.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec

from conductor.certify.consent import Consent, require_consent
from conductor.certify.form import Certificate
from conductor.run.source import check, completed, named_paths, with_repository
from schemas.campaign import Campaign
from schemas.escape import escape
from schemas.files.assets import asset_digest, file_digest
from schemas.files.json_text import JsonError, decode_json
from schemas.files.yaml_file import YamlError
from schemas.identity import campaign_digest
from schemas.plan import Plan, parse_plan
from schemas.sections.stack_identity import difference
from schemas.sections.view_mode import Recording
from twin.base.errors import InfrastructureError, UsageError
from twin.stack_identity.identity import named_files

FILES_MAX = 10_000
"""Most files of the folder that the auditor gives that are looked at."""
_KEPT = ("files", "plugins", "stack_identity", "description")
"""Keys of a campaign in which no path is put in place of another."""
_LOCAL: dict[str, Any] = {"requires": {}, "device": "any"}
"""Keys that say where cases may run, and decide no result."""


def plan_in(certificate: Certificate, shown: str) -> Plan:
    """The plan that follows from a certificate's campaign, held against what was signed.

    No file is touched, nothing is run.

    Raises:
        InfrastructureError: it is no campaign, or another one than the rows are of.
    """
    data = _data(certificate, shown)
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise InfrastructureError(f"{shown}: its campaign: {mistakes[0].line('campaign')}")
    given = data.get("plugins") or {}
    for name, version in plan.campaign.plugins.items():
        if given.get(name) != version:
            raise UsageError(
                f"{shown}: needs the plug-in {escape(name, 100)} {escape(str(given.get(name)), 60)}"
                f", installed is {version}; install that version"
            )
    _require_same(certificate, plan, shown)
    return plan


def prepared(certificate: Certificate, plan: Plan, consent: Consent, shown: str) -> Plan:
    """The plan with files, stack and sandbox of this machine; its cases are those of the rows.

    Args:
        certificate: the certificate.
        plan: of :func:`plan_in`.
        consent: what may run here.
        shown: name of the certificate.

    Raises:
        UsageError: the auditor has not allowed what would run, or a file is missing.
        InfrastructureError: files or stack here are others.
    """
    require_consent(plan, consent, shown)
    data = _data(certificate, shown) | _LOCAL
    places = _places(plan.campaign, consent.files, shown)
    data = {key: data[key] if key in _KEPT else _replaced(data[key], places) for key in data}
    _require_named(plan.campaign, shown)
    ready, mistakes = check(data)
    if ready is None:
        raise UsageError(f"{shown}: its campaign: {mistakes[0].line('campaign')}")
    if consent.stack:
        ready = ready.amended(with_repository(ready.campaign, shown))
    ready = completed(_contained(ready, consent), shown)
    before, now = plan.campaign.stack_identity, ready.campaign.stack_identity
    if words := difference(before, now):
        raise InfrastructureError(
            f"{shown}: the stack here is another one: {words} (stack digest {before.digest[:12]}, "
            f"here {now.digest[:12]})"
        )
    _require_names(certificate, ready, places, shown)
    _require_same(certificate, ready, shown)
    return ready


def _contained(plan: Plan, consent: Consent) -> Plan:
    """The plan in a sandbox, with nothing recorded or shown: no result depends on either."""
    campaign = plan.campaign
    autonomy = campaign.autonomy
    if autonomy.sandbox == "off" and not consent.unprotected:
        autonomy = msgspec.structs.replace(autonomy, sandbox="default")
    recording = Recording(keep="none")
    return plan.amended(
        msgspec.structs.replace(campaign, autonomy=autonomy, view="none", recording=recording)
    )


def _data(certificate: Certificate, shown: str) -> dict[str, Any]:
    try:
        return decode_json(certificate.campaign, dict[str, Any])
    except JsonError as error:
        raise InfrastructureError(f"{shown}: its campaign: {error}") from None


def _require_same(certificate: Certificate, plan: Plan, shown: str) -> None:
    """The cases of a plan are those of the rows, and decide the same."""
    head = certificate.head
    found = campaign_digest(plan.campaign, plan.cases)
    if plan.campaign.campaign != head.name or found != head.digest:
        raise InfrastructureError(
            f"{shown}: its campaign '{plan.campaign.campaign}' is not the one whose rows it has "
            f"(digest {found[:12]}, signed {head.digest[:12]})"
        )
    names, rows = {case.id for case in plan.cases}, {row.case for row in certificate.rows}
    if names != rows:
        odd = min(names ^ rows)
        where = "no row" if odd in names else "a row and is no case of its campaign"
        raise InfrastructureError(f"{shown}: {escape(odd, 200)} has {where}")


def _require_names(
    certificate: Certificate, plan: Plan, places: dict[str, str], shown: str
) -> None:
    """An axis of files gives its cases names that have the paths in them, and names decide random
    numbers."""
    if {case.id for case in plan.cases} == {row.case for row in certificate.rows}:
        return
    moved = [path for path, place in places.items() if path != place]
    if moved:
        raise UsageError(
            f"{shown}: names of its cases have the paths of files in them; put the file at "
            f"{escape(moved[0], 200)}, and give its folder with --files"
        )


def _places(campaign: Campaign, folder: Path | None, shown: str) -> dict[str, str]:
    """Path in the campaign -> path of the file here with the same content."""
    assets, models = named_paths(campaign)
    places: dict[str, str] = {}
    for path in [*assets, *models]:
        sha = campaign.files.get(path)
        if sha is None:
            raise InfrastructureError(
                f"{shown}: names the file {escape(path, 200)}, of which it has no digest"
            )
        place = _found(folder, sha, path, whole=path in assets) if folder else None
        if place is None:
            where = f"is not in {folder}" if folder else "is needed"
            raise UsageError(
                f"{shown}: a file {where} whose digest is {sha[:12]} (it was called "
                f"{escape(path, 200)}); ask for it, and give its folder with --files"
            )
        places[path] = str(place)
    return places


def _found(folder: Path, sha: str, path: str, *, whole: bool) -> Path | None:
    """A file below ``folder`` with this digest; ``whole``: with the files that it names."""
    suffix = Path(path).suffix
    looked = 0
    given = Path(path)
    is_below = folder.absolute() in given.parents and ".." not in given.parts
    if is_below and _has(given, sha, whole=whole):
        return given  # before any copy of it
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            looked += 1
            if looked > FILES_MAX:
                raise UsageError(f"--files {folder}: more than {FILES_MAX} files; give fewer")
            if Path(name).suffix != suffix:
                continue
            place = Path(parent, name).absolute()
            if _has(place, sha, whole=whole):
                return place
    return None


def _has(place: Path, sha: str, *, whole: bool) -> bool:
    try:
        return (asset_digest(place) if whole else file_digest(place)) == sha
    except (OSError, YamlError):
        return False  # not the one that is looked for


def _require_named(campaign: Campaign, shown: str) -> None:
    """Parameters that are paths here lead to what they led to where the run was."""
    autonomy = campaign.autonomy
    values = list(autonomy.parameters.values())
    axes = [(axis, value) for axis, each in campaign.matrix.items() for value in each]
    axes += [pair for point in campaign.cases for pair in point.items()]
    values += [value for axis, value in axes if axis.startswith("autonomy.parameters.")]
    here = named_files(values)
    for path in sorted(here.keys() | campaign.stack_identity.named.keys()):
        if here.get(path) != campaign.stack_identity.named.get(path):
            what = "is another one here" if path in here else "is not here"
            raise InfrastructureError(
                f"{shown}: the file {escape(path, 200)}, which a parameter names, {what}"
            )


def _replaced(value: Any, places: dict[str, str]) -> Any:
    """Plain data with paths of this machine in place of those of another."""
    if isinstance(value, str):
        return places.get(value, value)
    if isinstance(value, list):
        return [_replaced(each, places) for each in value]
    if isinstance(value, dict):
        return {key: _replaced(each, places) for key, each in value.items()}
    return value
