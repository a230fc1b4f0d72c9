"""How many slots fit on a GPU, by the simulator's own count: a process that is asked once."""

from __future__ import annotations

import json
import subprocess
import sys

import msgspec

from schemas.campaign import Campaign

TIMEOUT_S = 60.0
"""Longest time to build the scene and add up [s]."""


def slots_that_fit(campaign: Campaign, free_bytes: int) -> int | None:
    """Most slots of the campaign's rigs in ``free_bytes`` of a GPU's memory [bytes].

    Returns:
        None if the simulator does not say: a rig that does not fit says it itself then.
    """
    command = [
        *(sys.executable, "-m", "twin", "memory", "--campaign", "-"),
        *("--free-gb", str(free_bytes / 1e9), "--output", "json"),
    ]
    try:
        done = subprocess.run(
            command, input=msgspec.json.encode(campaign), capture_output=True, timeout=TIMEOUT_S
        )
        fits = json.loads(done.stdout)["slots_max"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        return None
    return fits if isinstance(fits, int) else None
