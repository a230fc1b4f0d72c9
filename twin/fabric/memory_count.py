"""How many slots fit on a GPU, by the simulator's own count: a process that is asked once."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence

TIMEOUT_S = 60.0
"""Longest time to build the scene and add up [s]."""


def slots_that_fit(of: bytes, options: Sequence[str]) -> int | None:
    """What ``twin memory`` with ``options`` says of a campaign or a case, JSON on its input.

    Returns:
        None if the simulator does not say: a rig that does not fit says it itself then.
    """
    command = [sys.executable, "-m", "twin", "memory", *options, "--output", "json"]
    try:
        done = subprocess.run(command, input=of, capture_output=True, timeout=TIMEOUT_S)
        fits = json.loads(done.stdout)["slots_max"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        return None
    return fits if isinstance(fits, int) else None
