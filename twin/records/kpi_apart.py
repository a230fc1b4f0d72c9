"""KPI files that lay where others may write, written anew by a process in the sandbox of stacks."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from twin.base.process import PARENT_VARIABLE


def written_anew(
    pairs: Sequence[tuple[Path, Path]], timeout_s: float | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Have each first file of ``pairs`` read apart, and its values written as the second; how that
    ended: ``EXIT_USAGE`` if one is no KPI file. What it says names the first files.

    Raises:
        OSError: no process could be started.
        TimeoutExpired: it took longer than ``timeout_s`` and was ended.
    """
    return subprocess.run(
        # Parsers of files of others are the business of the simulator's packages.
        [sys.executable, "-m", "twin.kpi.foreign"],
        input=msgspec.json.encode([(str(given), str(wanted)) for given, wanted in pairs]),
        capture_output=True,
        timeout=timeout_s,
        check=False,
        env={**os.environ, PARENT_VARIABLE: str(os.getpid())},  # it ends with us
    )
