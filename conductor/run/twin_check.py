"""Whether the scenes, vehicles and plug-ins of a campaign can be used, and the objects it varies.

What a scene or a vehicle means is the business of ``twin``, and so are implementations of kinds: it
is asked as any user would ask it, by a process of its own, once for all of a campaign. Shipped
vehicles, and shipped scenes that nothing is varied of, are not looked at, nor is what was found
good before and is the same.
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
from schemas.digest import digest
from schemas.escape import escape
from schemas.files.assets import asset_digest, file_digest, is_path
from schemas.files.yaml_file import YamlError
from schemas.kinds.plugins import ForeignKind
from schemas.kinds.scenario import kind_of
from schemas.plan import Plan
from schemas.sections.scenario import Scenario
from schemas.validation import Mistake
from twin.base.errors import InfrastructureError, UsageError
from twin.base.process import how_it_ended
from twin.base.software import software_digest

TIMEOUT_S = 600.0
"""Longest time to look at a campaign [s]; less than `hpc` waits for the check of a campaign."""

FILE = "good-campaigns.json"
"""File of the digests of good campaigns, see :mod:`conductor.run.known_good`."""


def twin_mistakes(plan: Plan) -> list[Mistake]:
    """What is wrong with the scenes, vehicles and plug-ins of a campaign's cases.

    What is left out of their files is printed to standard error, a line each.

    Raises:
        InfrastructureError: the check itself did not work.
    """
    cases, kinds = plan.cases, plan.kinds_of_others()
    if not kinds and not any(
        is_path(c.rig.scene)
        or is_path(c.rig.vehicle)
        or c.variation.objects
        or c.variation.scenario.load_kg is not msgspec.UNSET
        or kind_of(c.variation.scenario).checks
        for c in cases
    ):
        return []
    identity = _identity(cases, kinds)
    if identity and identity in remembered(FILE):
        return []
    mistakes, notes = _ask(plan.campaign, kinds)
    for note in notes:
        print(escape(note), file=sys.stderr)
    # What was looked at may be other files than those that were read before; and notes are worth
    # being read every time.
    if not mistakes and not notes and identity and _identity(cases, kinds) == identity:
        remember(FILE, [identity])
    return mistakes


def _ask(campaign: Campaign, kinds: Sequence[ForeignKind]) -> tuple[list[Mistake], list[str]]:
    shown = ", ".join(["scenes", "vehicles", *sorted({" ".join(kind.plugin) for kind in kinds})])
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
            mistakes = [Mistake(row["path"], row["message"]) for row in answer["mistakes"]]
            return mistakes, [str(note) for note in answer["notes"]]
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
    vehicles = {case.rig.vehicle for case in cases if is_path(case.rig.vehicle)}
    varied = {(case.rig.scene, _packed(case.variation.objects)) for case in cases}
    checked = [case for case in cases if kind_of(case.variation.scenario).checks]
    try:
        parts = _checked(checked)
        content = {name: asset_digest(Path(name)) if is_path(name) else name for name in scenes}
        cars = sorted(asset_digest(Path(name)) for name in vehicles)
        cars += sorted({_load(case) for case in cases})
        parts += [software_digest(), *cars, *(_code(kinds) if kinds else ())]
    except (OSError, YamlError, UsageError):
        return ""
    looked_at = sorted((content[scene].encode(), objects) for scene, objects in varied)
    return digest([*map(str.encode, parts), *itertools.chain.from_iterable(looked_at)])


def _checked(cases: Sequence[Case]) -> list[str]:
    """What decides whether a family finds something wrong with its cases; names with the contents
    of their files."""
    files = {name for case in cases for name in kind_of(_scenario(case)).files_of(_scenario(case))}
    content = [f"{name}={asset_digest(Path(name))}" for name in sorted(files) if is_path(name)]
    rigs = {
        f"{case.rig.scene} {case.rig.control_hz} {case.rig.cosim} {_packed(_scenario(case))!r}"
        for case in cases
    }
    return [*content, *sorted(rigs)]


def _load(case: Case) -> str:
    """What a vehicle carries in a case."""
    names = ("load_kg", "load_x_m", "load_y_m", "load_z_m")
    return " ".join([case.rig.vehicle, *(repr(getattr(_scenario(case), name)) for name in names)])


def _scenario(case: Case) -> Scenario:
    return case.variation.scenario


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
