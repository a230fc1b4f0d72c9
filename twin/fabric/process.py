"""Child processes that never outlive their parent.

A child asks the kernel for SIGKILL at its parent's death (PR_SET_PDEATHSIG) and, because that is
lost if the parent dies before the call, checks who its parent is; its standard input is a lifeline
pipe that reads end-of-file when the parent is gone.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

_PR_SET_PDEATHSIG = 1
PARENT_VARIABLE = "TWIN_PARENT_PID"
"""Environment variable that tells a child who started it."""


def spawn(
    arguments: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    log: IO[bytes] | None = None,
    pipe_output: bool = False,
    folder: Path | None = None,
    given: IO[bytes] | None = None,
) -> subprocess.Popen[bytes]:
    """Start a child in a process group of its own, bound to this process.

    Call it from the main thread: the kernel sends the death signal when the *thread* that forked
    ends. Standard input is the lifeline; keep the ``Popen`` object.

    Args:
        arguments: command line.
        environment: added to this process's environment.
        log: receives standard error (and standard output unless ``pipe_output``).
        pipe_output: standard output is a pipe to the caller.
        folder: working folder.
        given: standard input, in place of the lifeline: for a child that ends by itself.
    """
    variables = {**os.environ, **(environment or {}), PARENT_VARIABLE: str(os.getpid())}
    return subprocess.Popen(
        list(arguments),
        stdin=given or subprocess.PIPE,
        stdout=subprocess.PIPE if pipe_output else (log or subprocess.DEVNULL),
        stderr=log or subprocess.DEVNULL,
        env=variables,
        cwd=folder,
        # Its own session: Ctrl-C reaches only the parent, which decides what its children do.
        start_new_session=True,
        bufsize=0,
    )


def bind_to_parent() -> None:
    """In a child: die with the parent. Does nothing when not started by :func:`spawn`."""
    parent = os.environ.pop(PARENT_VARIABLE, "")
    if parent:
        die_with_parent(parent)


def die_with_parent(parent: str) -> None:
    """In a child of the process ``parent``, a number: be killed when that one ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    # In another pid namespace the parent's number reads 0: the lifeline has to do.
    if os.getppid() not in (int(parent), 0):
        sys.exit(0)


def leave_signals_to_the_parent() -> None:
    """In a child: ignore SIGTERM and SIGINT.

    Schedulers send SIGTERM to every process of a job at once. A simulator that obeyed before its
    worker did would look like a crash; the worker decides, and ends its children itself.
    """
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def watch_lifeline() -> None:
    """In a child that does not read its standard input: leave when the lifeline is cut."""

    def wait() -> None:
        while os.read(0, 65536):
            pass
        os._exit(0)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()


def end(child: subprocess.Popen[bytes], grace_s: float = 2.0) -> None:
    """Cut the lifeline, ask, then kill; returns when the child is reaped."""
    if child.stdin is not None:
        try:
            child.stdin.close()
        except OSError:
            pass
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(grace_s)
        except subprocess.TimeoutExpired:
            child.kill()
    child.wait()
    if child.stdout is not None:
        child.stdout.close()


def how_it_ended(code: int) -> str:
    """``killed by SIGKILL`` or ``exit code 3``."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


LOG_BYTES_MAX = 64 << 20
"""What a log may take of the disk [bytes]."""

LOG_PART_BYTES = 4 << 20
"""What is kept of its beginning and of its end when it grew larger [bytes]."""

_KEEP_SIZE_AND_PUNCH = 0x01 | 0x02


def bound_log(log: IO[bytes]) -> None:
    """Give back the middle of a log that has grown too large; whoever writes it notices nothing.

    Its size stays: the middle reads as zeros and takes no space.
    """
    descriptor = log.fileno()
    found = os.fstat(descriptor)
    if found.st_blocks * 512 <= LOG_BYTES_MAX:
        return
    until = found.st_size - LOG_PART_BYTES
    library = ctypes.CDLL(None, use_errno=True)
    start, length = ctypes.c_int64(LOG_PART_BYTES), ctypes.c_int64(until - LOG_PART_BYTES)
    if library.fallocate(descriptor, _KEEP_SIZE_AND_PUNCH, start, length) != 0:
        os.ftruncate(descriptor, 0)  # a file system without holes gives up all of it


def last_lines(log: IO[bytes], count: int = 3) -> str:
    """The last lines of a child's log, on one line; its write position stays where it is."""
    size = os.fstat(log.fileno()).st_size
    text = os.pread(log.fileno(), 4096, max(0, size - 4096)).decode("utf-8", "replace")
    return " | ".join(line.strip() for line in text.strip().splitlines()[-count:])
