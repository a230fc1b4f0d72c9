"""Digests of the files behind a campaign's results: scenes, vehicles, models, stack parameters."""

from __future__ import annotations

import hashlib
from pathlib import Path

from conductor.report.reading.dossier import Dossier
from schemas.files.assets import file_digest
from schemas.kinds.perception import perception_kind
from twin.base.software import package_folder, software_digest

NAMES_MAX = 8
"""Scenes and vehicles that a report names; of more, their number."""


def file_digests(dossier: Dossier) -> list[tuple[str, str]]:
    """Name and SHA-256 of the stack, if it is none of the shipped ones, of every file that the
    campaign names, and of the shipped models it uses.

    The digest of a shipped model is left out if other software is installed here than was run.
    """
    stack = dossier.campaign.stack_identity.digest
    digests = [("Stack digest", stack)] if stack else []
    digests += [(_shown(name), digest) for name, digest in sorted(dossier.campaign.files.items())]
    return [*digests, *_shipped_models(dossier)]


def built_of(dossier: Dossier) -> list[str]:
    """The scenes of the cases and their vehicles, one text each, in the order of the cases. A case
    of a scenario file that brings its road takes place there, whatever the campaign's scene is.
    """
    rigs = [row.case.rig for row in dossier.rows]
    return [_listed([rig.scene for rig in rigs]), _listed([rig.vehicle for rig in rigs])]


def _listed(names: list[str]) -> str:
    different = list(dict.fromkeys(_shown(name) for name in names))
    left_out = len(different) - NAMES_MAX
    more = [f"{left_out} more"] if left_out > 0 else []
    return " and ".join([", ".join(different[:NAMES_MAX]), *more])


def _shown(name: str) -> str:
    """Paths of the machine that ran it are nobody's business."""
    return Path(name).name if Path(name).is_absolute() else name


def _shipped_models(dossier: Dossier) -> list[tuple[str, str]]:
    named: dict[str, str] = {}
    for row in dossier.rows:
        spec = row.case.variation.perception
        named.update(perception_kind(spec).shipped(spec))
    if not named or dossier.outcomes.software != software_digest():
        return []
    # Found without asking `devkit models`, which takes as long to start as a report of 256 cases.
    root = package_folder("devkit").parent
    return [
        (name, file_digest(root / path))
        for name, path in sorted(named.items())
        if (root / path).is_file()
    ]


def text_digest(text: str) -> str:
    """SHA-256 of a text as it is printed."""
    return hashlib.sha256(text.encode()).hexdigest()
