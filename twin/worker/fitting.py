"""How many slots of a rig fit on a GPU: a process that adds up once, before the rig starts."""

from __future__ import annotations

import json
import subprocess
import sys

import msgspec

from schemas.campaign import Case

GPU_SLOTS = 128
"""Slots of a worker on a GPU unless the user says otherwise, where they fit: with more it gets
little faster, and other workers get less to do."""

TIMEOUT_S = 60.0
"""Longest time to build the scene and add up [s]."""


def fitting(device: str, slots: int, case: Case) -> int:
    """At most ``slots``, and no more than fit into what is free on ``device``; ``slots`` where the
    simulator does not say: a rig that does not fit says it itself then."""
    command = [
        *(sys.executable, "-m", "twin", "memory", "--case", "-"),
        *("--slots", str(slots), "--device", device, "--output", "json"),
    ]
    try:
        done = subprocess.run(
            command, input=msgspec.json.encode(case), capture_output=True, timeout=TIMEOUT_S
        )
        fits = json.loads(done.stdout)["slots_max"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        return slots
    return min(slots, fits) if isinstance(fits, int) else slots
