"""Small libraries in C that stand for drivers which are not on every machine."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest


def compiled(folder: Path, name: str, source: str) -> Path:
    """``folder`` with the library ``name`` in it, for LD_LIBRARY_PATH; skips without a compiler."""
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc")
    (folder / "library.c").write_text(source)
    command = ["gcc", "-shared", "-fPIC", "-o", folder / name, folder / "library.c"]
    subprocess.run(command, check=True)
    return folder
