"""Where compiled kernels are kept; a temporary folder when the usual one cannot be written."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

import warp as wp


def prepare_kernels() -> None:
    """Start Warp quietly with a kernel cache that can be written; repeated calls do nothing.

    ``WARP_CACHE_PATH`` and Warp's default are respected. Otherwise a temporary folder, removed at
    exit, takes their place and one line on stderr says so.
    """
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_ERROR  # a machine without a GPU is nothing to warn about
    wp.init()
    folder = Path(wp.config.kernel_cache_dir)
    if _writable(folder):
        return
    temporary = tempfile.mkdtemp(prefix="drivetwin-kernels-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    wp.config.kernel_cache_dir = temporary
    print(
        f"kernel cache {folder} cannot be written; compiling into {temporary} for this run "
        "(set WARP_CACHE_PATH to keep kernels)",
        file=sys.stderr,
    )


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder)
    except OSError:
        return False
    os.close(handle)
    Path(name).unlink()
    return True
