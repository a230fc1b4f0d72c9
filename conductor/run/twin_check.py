"""Whether the scenes and plug-ins of a campaign can be used, and the objects that it varies.

What a scene means is the business of ``twin``, and so are implementations of kinds: it is asked as
any user would ask it, by a process of its own, once for all of a campaign. Shipped scenes that
nothing is varied of are not looked at, nor is what was found good before and is the same.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import itertools
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from conductor.run.known_good import remember, remembered
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.files.assets import asset_digest, file_digest, is_path
from schemas.files.yaml_file import YamlError
from schemas.identity import digest
from schemas.kinds.plugins import ForeignKind
from schemas.plan import Plan
from schemas.validation import Mistake
from twin.base.errors import InfrastructureError, UsageError
from twin.base.process import how_it_ended
from twin.base.software import software_digest

TIMEOUT_S = 100.0
"""Longest time to look at a campaign [s]; less than `hpc` waits for the check of a campaign."""

FILE = "good-campaigns.json"
"""File of the digests of good campaigns, see :mod:`conductor.run.known_good`."""


def twin_mistakes(plan: Plan) -> list[Mistake]:
    """What is wrong with the scenes and plug-ins of a campaign's cases.

    Raises:
        InfrastructureError: the check itself did not work.
    """
    cases, kinds = plan.cases, plan.kinds_of_others()
    if not kinds and not any(is_path(c.rig.scene) or c.variation.objects for c in cases):
        return []
    identity = _identity(cases, kinds)
    if identity and identity in remembered(FILE):
        return []
    mistakes = _ask(plan.campaign, kinds)
    # What was looked at may be other files than those that were read before.
    if not mistakes and identity and _identity(cases, kinds) == identity:
        remember(FILE, [identity])
    return mistakes


def _ask(campaign: Campaign, kinds: Sequence[ForeignKind]) -> list[Mistake]:
    shown = ", ".join(["scenes", *sorted({" ".join(kind.plugin) for kind in kinds})])
    try:
        done = subprocess.run(
            [sys.executable, "-m", "twin", "validate", "campaign"],
            input=msgspec.json.encode(campaign),
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"{shown}: not checked within {TIMEOUT_S:g} s; is the file system busy?"
        ) from None
    try:
        if done.returncode == 0:
            # What implementations may print stands before the answer.
            answer: dict[str, list[Any]] = json.loads(done.stdout.splitlines()[-1])
            return [Mistake(mistake["path"], mistake["message"]) for mistake in answer["mistakes"]]
    except (ValueError, IndexError, TypeError, KeyError):
        pass
    words = done.stderr.decode(errors="replace").strip().splitlines() or ["it said nothing"]
    raise InfrastructureError(
        f"{shown}: the process that checks them ended without an answer"
        f" ({how_it_ended(done.returncode)}): {words[-1][:300]}"
    )


def _identity(cases: Sequence[Case], kinds: Sequence[ForeignKind]) -> str:
    """Digest of what decides whether the check finds anything; empty: that cannot be read."""
    scenes = {case.rig.scene for case in cases}
    varied = {(case.rig.scene, _packed(case.variation.objects)) for case in cases}
    try:
        content = {name: asset_digest(Path(name)) if is_path(name) else name for name in scenes}
        parts = [software_digest(), *(_code(kinds) if kinds else ())]
    except (OSError, YamlError, UsageError):
        return ""
    looked_at = sorted((content[scene].encode(), objects) for scene, objects in varied)
    return digest([*map(str.encode, parts), *itertools.chain.from_iterable(looked_at)])


_packed = msgspec.json.Encoder(order="sorted").encode


def _code(kinds: Sequence[ForeignKind]) -> Iterator[str]:
    """What decides whether implementations can be imported: their packages' code, what is installed
    beside them, and where it is found."""
    yield from (sys.version, sys.executable, *sys.path)
    yield from sorted(f"{d.name}=={d.version}" for d in importlib.metadata.distributions())
    yield from sorted(f"{kind.key} {kind.implementation}" for kind in kinds)
    for package in sorted({kind.implementation.partition(".")[0] for kind in kinds}):
        for file in _files(package.partition(":")[0]):
            yield f"{file}={file_digest(file)}"


def _files(package: str) -> list[Path]:
    """Files of code of a package, or of a single module, found without importing it."""
    spec = importlib.util.find_spec(package) if package else None
    if spec is None:
        return []
    if not spec.submodule_search_locations:
        return [Path(spec.origin)] if spec.origin else []
    roots = map(Path, spec.submodule_search_locations)
    return sorted(p for root in roots for p in root.rglob("*") if p.suffix in (".py", ".so"))
