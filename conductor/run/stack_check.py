"""Whether a campaign's stack can be built on this machine; nothing of it is imported or run."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable

from schemas.campaign import Campaign
from schemas.case import Case
from schemas.kinds.bridge import bridges
from schemas.sections.autonomy import Autonomy
from schemas.validation import Mistake
from twin.stack_identity.imports import locate
from twin.stack_identity.stack_class import class_mistakes

BRIDGE_S = 60.0
"""Longest time to ask for the parameters of a bridge [s]."""


def stack_mistakes(campaign: Campaign, cases: Iterable[Case]) -> list[Mistake]:
    """A missing module, class or package, and parameters that the class does not take, no
    camera for one that drives by it."""
    mistakes = _missing_packages(campaign.autonomy) + bridge_mistakes(campaign.autonomy)
    wanted: dict[str, set[str]] = {}
    for case in cases:
        if case.rig.stack:
            wanted.setdefault(case.rig.stack, set()).update(case.rig.parameters)
    for entry_point, parameters in wanted.items():
        mistakes += class_mistakes(entry_point, sorted(parameters), blind=not campaign.render)
    return mistakes


def bridge_mistakes(autonomy: Autonomy) -> list[Mistake]:
    """Values that a bridge does not take: ``devkit`` is asked, in a process of its own."""
    bridge = bridges().get(autonomy.bridge)
    if bridge is None or not autonomy.parameters or bridge.lacking():
        return []
    words = [sys.executable, "-m", "devkit", "check-bridge", bridge.name]
    try:
        done = subprocess.run(
            [*words, json.dumps(autonomy.parameters)],
            capture_output=True,
            text=True,
            timeout=BRIDGE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return []  # the rig says it when it starts
    if done.returncode:
        return []
    *_, answer = done.stdout.splitlines()  # a bridge may print while it is imported
    found: dict[str, str] = json.loads(answer)
    return [Mistake(f"autonomy.parameters.{name}", line) for name, line in found.items()]


def _missing_packages(autonomy: Autonomy) -> list[Mistake]:
    """Packages of a bridge that is started on this machine or one that is set up alike."""
    bridge = bridges().get(autonomy.bridge)
    if autonomy.placement == "node" or bridge is None:
        return []
    return [
        Mistake(
            "autonomy.bridge",
            f"'{autonomy.bridge}' needs the package {package}, which is not installed: "
            f"pip install '{bridge.installed_by}'",
        )
        for package in bridge.packages
        if locate(package) is None
    ]
