"""Where a foreign stack runs: in the files of a repository, in a container, or right here.

Fetching and entering are the business of ``hpc``, which is asked by processes of its own.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
from pathlib import Path

from schemas.foreign import Foreign
from twin.fabric.fetch import fetch

VACATE_S = 4.0
"""Longest time for that; the worker waits a little longer for the end of a stack [s]."""


def placed(foreign: Foreign, rig: str) -> tuple[list[str], str | None]:
    """The command line that starts ``foreign`` for ``rig``, and its working folder (None: ours).

    Raises:
        InfrastructureError: its files cannot be had.
    """
    folder = fetch(foreign.repository).folder if foreign.repository is not None else None
    if foreign.image is None:
        return list(foreign.command), folder or _folder_of_script(foreign)
    image = foreign.image
    words = [sys.executable, "-m", "hpc", "enter", "--container", image.path]
    words += ["--runtime", image.runtime, "--name", _name(rig)]
    for path in image.binds:
        words += ["--bind", path]
    if image.gpus:
        words.append("--gpus")
    return [*words, "--", *foreign.command], folder


def _folder_of_script(foreign: Foreign) -> str | None:
    """Where the script behind a bridge lies: published ones find their files in the working folder,
    and are started there. None: its path does not say."""
    if foreign.bridge == "none":
        return None
    for word in foreign.command:
        path = Path(word)
        if path.is_absolute() and path.suffix == ".py" and path.is_file():
            return str(path.parent)
    return None


def vacate(foreign: Foreign, rig: str) -> None:
    """When its processes have ended: a runtime may keep a dead container, which is removed."""
    kept = foreign.image is not None and foreign.image.runtime in ("auto", "podman")
    if foreign.image is None or not kept or shutil.which("podman") is None:
        return
    words = [sys.executable, "-m", "hpc", "leave", "--runtime", foreign.image.runtime, _name(rig)]
    with contextlib.suppress(subprocess.TimeoutExpired):  # it costs a name in a list
        subprocess.run(words, stdin=subprocess.DEVNULL, timeout=VACATE_S)


def _name(rig: str) -> str:
    return f"drivetwin-{rig}"
