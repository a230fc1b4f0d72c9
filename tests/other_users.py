"""Programs of ours that another user than root runs, for tests that root starts."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

NOBODY = 65534
"""Who runs them."""
DAEMON = 1
"""Somebody else."""
PYTHON = "/usr/bin/python3"
"""One that every user may start."""

AS_ROOT = pytest.mark.skipif(
    os.getuid() != 0 or not Path(PYTHON).exists(), reason="takes another user's place"
)


def environment() -> dict[str, str]:
    """Ours and the packages, without this Python's own."""
    folders = [folder for folder in sys.path if folder and not folder.startswith(sys.base_prefix)]
    return {"PYTHONPATH": os.pathsep.join(folders)}


def started_by(
    user: int, words: Sequence[str], folder: str = "/tmp", **options: Any
) -> subprocess.Popen[str]:
    """Python with ``words``, whose home and temporary folder is ``folder``."""
    return subprocess.Popen(
        [PYTHON, *words],
        stdin=subprocess.PIPE,
        text=True,
        cwd=folder,
        user=user,
        group=user,
        env={**environment(), "HOME": folder, "TMPDIR": folder},
        **options,
    )
