"""Is this a campaign? The ``conductor`` command knows; it is asked as any user would ask it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from twin.fabric.errors import EXIT_PASS, EXIT_USAGE, InfrastructureError, UsageError

TIMEOUT_S = 120.0
"""Longest wait for the check of a campaign; a cold shared file system is slow [s]."""


def checked(campaign: str) -> str:
    """The campaign as a job can name it: a shipped name, or a file's absolute path.

    Raises:
        UsageError: it is none; one line per mistake.
        InfrastructureError: the check itself did not work.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-m", "conductor", "validate", "--output", "json", "--", campaign],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"{campaign}: not checked in {TIMEOUT_S:.0f} s; try `conductor validate {campaign}`"
        ) from None
    if done.returncode == EXIT_USAGE and done.stdout:
        raise UsageError("\n".join(json.loads(done.stdout)["mistakes"]))
    if done.returncode != EXIT_PASS:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise InfrastructureError(f"{campaign}: `conductor validate` failed: {lines[-1]}")
    path = Path(campaign)
    # A shipped name stays one, also when a file in this folder happens to be called like it.
    is_file = path.is_file() and ("/" in campaign or path.suffix != "")
    return str(path.absolute()) if is_file else campaign
