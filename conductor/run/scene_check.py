"""Whether scene files can be used, and the objects in them that a campaign varies.

What a scene means is the business of ``twin``, which is asked as any user would ask it: by a
process of its own, once for all scenes. Shipped scenes that nothing is varied of are not looked at.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence

import msgspec

from schemas.campaign import Campaign
from schemas.case import Case
from schemas.files.assets import is_path
from schemas.validation import Mistake
from twin.base.errors import EXIT_PASS, EXIT_USAGE, InfrastructureError
from twin.base.process import how_it_ended

TIMEOUT_S = 100.0
"""Longest time to look at all scenes [s]; less than `hpc` waits for the check of a campaign."""


def scene_mistakes(campaign: Campaign, cases: Sequence[Case]) -> list[Mistake]:
    """What is wrong with the scenes of ``cases``.

    Raises:
        InfrastructureError: the check itself did not work.
    """
    if not any(is_path(case.rig.scene) or case.variation.objects for case in cases):
        return []
    command = [sys.executable, "-m", "twin", "validate", "scene", "--campaign", "-"]
    try:
        done = subprocess.run(
            [*command, "--output", "json"],
            input=msgspec.json.encode(campaign),
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"scenes: not checked within {TIMEOUT_S:g} s; is the file system busy?"
        ) from None
    if done.returncode not in (EXIT_PASS, EXIT_USAGE) or not done.stdout:
        words = done.stderr.decode(errors="replace").strip().splitlines() or ["it said nothing"]
        raise InfrastructureError(
            f"scenes: the process that checks them ended without an answer"
            f" ({how_it_ended(done.returncode)}): {words[-1][:300]}"
        )
    lines = json.loads(done.stdout)["mistakes"]
    return [Mistake("scenario.scene", str(line)) for line in lines]
