"""The process of a stack, ``python -m devkit host``, and how a worker starts it.

It is told its rig on its command line or, if it was started to load before there is one, on its
standard input, which is its lifeline in either case.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from msgspec import json

from schemas.case import Case
from schemas.kinds.perception import lacking_perceptions
from schemas.names import SHIPPED_STACKS
from twin.base.gpu.compiled_kernels import compiled_folder
from twin.base.process import RigChild, spawn
from twin.fabric.endpoint import LATER
from twin.fabric.rig_folder import RigFolder
from twin.sandbox.reads import python_reads
from twin.sandbox.start import Entering, spawn_inside
from twin.sandbox.view import SandboxView, encode
from twin.worker.protection import protection

THREADS = ("OPENCV_FOR_THREADS_NUM", "OMP_NUM_THREADS")
"""Variables that say how many threads libraries of a stack start: one unless the user says
otherwise, because there is a worker per core, and its simulator waits while the stack computes."""


@dataclass(frozen=True, slots=True)
class Loading:
    """Processes that load for the first rig."""

    simulator: RigChild
    stack: RigChild
    folder: RigFolder
    """Folder in which the two will meet."""
    stack_log: IO[bytes]
    """Log that the stack writes and the simulator reads, also if another stack takes its place."""

    def discard(self) -> None:
        """End them; they have not been told anything."""
        self.simulator.discard()
        self.stack.discard()
        self.folder.close()
        self.stack_log.close()


def threads() -> dict[str, str]:
    """Variables of :data:`THREADS` for a process in which a stack runs."""
    return {name: os.environ.get(name, "1") for name in THREADS}


def start_stack(
    arguments: Sequence[str],
    log: IO[bytes],
    environment: Mapping[str, str] | None = None,
    view: SandboxView | None = None,
    *,
    later: bool = False,
) -> subprocess.Popen[bytes]:
    """Start a stack's process. Only from the main thread.

    Args:
        arguments: its options.
        log: what it prints.
        environment: added to ours.
        view: what it sees; None: it runs without a sandbox.
        later: it enters the sandbox by itself, when it has fetched its files.
    """
    command = [sys.executable, "-m", "devkit", "host", *arguments]
    variables = {**threads(), **(environment or {})}
    if view is None:
        return spawn(command, environment=variables, log=log)
    view = replace(view, variables={**view.variables, **variables})
    if later:
        command += ["--sandbox", encode(view)]
        return spawn(command, environment=variables, log=log, kind=Entering)
    return spawn_inside(command, view, log)


def compile_kernels(device: str) -> subprocess.Popen[bytes] | None:
    """Have what networks need compiled outside the sandboxes of stacks, which keep nothing; None:
    there is nothing to do. Only from the main thread."""
    folder = compiled_folder(device) if device.startswith("cuda") else None
    if folder is None or folder.is_dir() or lacking_perceptions():
        return None
    words = [sys.executable, "-m", "devkit", "kernels", "--device", device, "--into", str(folder)]
    return spawn(words)


def load_stack(device: str, folder: Path, log: IO[bytes]) -> RigChild:
    """Start one that loads what it needs on ``device``, and waits for :func:`tell_stack`; its rig
    will have ``folder``, and keeps ``log`` also if this one is discarded."""
    shield = protection(None, device, folder)
    arguments = ["--connect", LATER, "--load-for", device]
    copy = os.fdopen(os.dup(log.fileno()), "rb")
    return RigChild(start_stack(arguments, copy, view=shield.view), copy, shield.said)


def may_run(case: Case) -> bool:
    """Whether a process of :func:`load_stack` may run the stack of ``case``."""
    return (
        case.rig.placement == "worker"
        and case.rig.foreign is None
        # These need what is preloaded, and are not disturbed by it.
        and case.rig.stack.startswith(SHIPPED_STACKS)
        and case.rig.sandbox == "default"
        and not case.rig.source.files
        and not case.rig.source.parameters
        and _all_seen(case.rig.models)
    )


def _all_seen(paths: Sequence[str]) -> bool:
    """Whether a sandbox without a campaign shows these files; it does those of our packages."""
    folders = python_reads() if paths else []
    return all(any(folder in Path(path).parents for folder in folders) for path in paths)


def tell_stack(process: subprocess.Popen[bytes], arguments: Sequence[str]) -> bool:
    """Give a process of :func:`load_stack` its options; False: it is dead or frozen, or they are
    more than a pipe takes at once, and another one has to be started."""
    assert process.stdin is not None
    line = json.encode(list(arguments)) + b"\n"
    os.set_blocking(process.stdin.fileno(), False)
    try:
        return os.write(process.stdin.fileno(), line) == len(line)
    except OSError:
        return False
