"""Warp's own headers, compiled once by each thread that compiles kernels.

They take most of the time of a small kernel. Warp puts them into a folder below ``TMPDIR``, which a
process that is killed leaves behind.
"""

from __future__ import annotations

import functools
import importlib
import tempfile
import threading
from pathlib import Path

from twin.fabric.rig_folder import PrivateFolder


def keep_headers() -> None:
    """Have Warp, which has started, put them into a folder that goes with this process however it
    ends. On a GPU they are kept in memory."""
    runtime = importlib.import_module("warp._src.context").runtime
    usual, one_at_a_time = runtime.get_clang_pch_dir, threading.Lock()

    def of_thread() -> str | None:
        with one_at_a_time:
            folder = _folder()
        if folder is None:
            of_warp: str | None = usual()
            return of_warp
        own = folder.path / str(threading.get_ident())
        own.mkdir(exist_ok=True)
        return str(own)

    runtime.get_clang_pch_dir = of_thread


@functools.cache
def _folder() -> PrivateFolder | None:
    """Made for the first kernel that is compiled; None: none can be made."""
    try:
        return PrivateFolder(Path(tempfile.gettempdir()), "drivetwin-headers-")
    except OSError:
        return None
