"""Digests of the files behind a campaign's results: scenes, vehicles, models, stack parameters."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

from conductor.report.dossier import Dossier
from schemas.assets import file_digest
from schemas.perception import NetworkPerception, is_model_path
from twin.fabric.software import software_digest


def file_digests(dossier: Dossier) -> list[tuple[str, str]]:
    """Name and SHA-256 of every file that the campaign names, and of the shipped models it uses.

    The digest of a shipped model is left out if other software is installed here than was run.
    """
    given = [(_shown(name), digest) for name, digest in sorted(dossier.campaign.files.items())]
    return [*given, *_shipped_models(dossier)]


def _shown(name: str) -> str:
    """Paths of the machine that ran it are nobody's business."""
    return Path(name).name if Path(name).is_absolute() else name


def _shipped_models(dossier: Dossier) -> list[tuple[str, str]]:
    specs = [row.case.perception for row in dossier.rows]
    used = {
        spec.model
        for spec in specs
        if isinstance(spec, NetworkPerception)
        if not spec.weights and not is_model_path(spec.model)
    }
    if not used or dossier.outcomes.software != software_digest():
        return []
    known = _asked()
    return [(f"model {n}", file_digest(Path(known[n]))) for n in sorted(used) if n in known]


def _asked() -> dict[str, str]:
    """Paths of the shipped models; devkit knows them, and is asked as anyone would."""
    done = subprocess.run(
        [sys.executable, "-m", "devkit", "models", "--output", "json"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
    )
    found: dict[str, str] = json.loads(done.stdout) if done.returncode == 0 else {}
    return found


def text_digest(text: str) -> str:
    """SHA-256 of a text as it is printed."""
    return hashlib.sha256(text.encode()).hexdigest()
