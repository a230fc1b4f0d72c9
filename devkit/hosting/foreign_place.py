"""Places where a foreign stack runs: the files of a repository, in a container, or right here.

Fetching and entering are the business of ``hpc``, which is asked by processes of its own.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys

from schemas.sections.foreign import Foreign
from twin.base.fetch import fetch
from twin.sandbox.reads import script_folder

VACATE_S = 4.0
"""Longest time for that; the worker waits a little longer for the end of a stack [s]."""


def placed(foreign: Foreign, rig: str) -> tuple[list[str], str | None]:
    """The command line that starts ``foreign`` for ``rig``, and its working folder (None: ours).

    Raises:
        InfrastructureError: its files cannot be had.
    """
    folder = fetch(foreign.repository).folder if foreign.repository is not None else None
    if foreign.image is None:
        script = script_folder(foreign)
        return list(foreign.command), folder or (str(script) if script is not None else None)
    image = foreign.image
    words = [sys.executable, "-m", "hpc", "enter", "--container", image.path]
    words += ["--runtime", image.runtime, "--name", _name(rig)]
    for path in image.binds:
        words += ["--bind", path]
    if image.gpus:
        words.append("--gpus")
    return [*words, "--", *foreign.command], folder


def vacate(foreign: Foreign, rig: str) -> None:
    """Remove the dead container that a runtime may keep when the stack's processes have ended."""
    kept = foreign.image is not None and foreign.image.runtime in ("auto", "podman")
    if foreign.image is None or not kept or shutil.which("podman") is None:
        return
    words = [sys.executable, "-m", "hpc", "leave", "--runtime", foreign.image.runtime, _name(rig)]
    with contextlib.suppress(subprocess.TimeoutExpired):  # it costs a name in a list
        subprocess.run(words, stdin=subprocess.DEVNULL, timeout=VACATE_S)


def _name(rig: str) -> str:
    return f"drivetwin-{rig}"
