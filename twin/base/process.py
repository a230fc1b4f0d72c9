"""Child processes that never outlive their parent.

A child asks the kernel for SIGKILL at its parent's death (PR_SET_PDEATHSIG) and, because that is
lost if the parent dies before the call, checks who its parent is; its standard input is a lifeline
pipe that reads end-of-file when the parent is gone.
"""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from twin.base.errors import EXIT_INFRASTRUCTURE, EXIT_UNFINISHED

_PR_SET_PDEATHSIG, _PR_SET_DUMPABLE = 1, 4
PARENT_VARIABLE = "TWIN_PARENT_PID"
"""Environment variable that tells a child who started it."""

UNKNOWN = "0"
"""Value of that variable where the child cannot know the number, or sees another one."""


def spawn(
    arguments: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    log: IO[bytes] | None = None,
    pipe_output: bool = False,
    folder: Path | None = None,
    given: IO[bytes] | None = None,
    whole: Mapping[str, str] | None = None,
    descriptors: Sequence[int] = (),
    kind: type[subprocess.Popen[bytes]] = subprocess.Popen,
) -> subprocess.Popen[bytes]:
    """Start a child in a process group of its own, bound to this process.

    Call it from the main thread, or from one that outlives the child: the kernel sends the death
    signal when the *thread* that forked ends. Standard input is the lifeline; keep the ``Popen``
    object.

    Args:
        arguments: command line.
        environment: added to this process's environment.
        log: receives standard error (and standard output unless ``pipe_output``).
        pipe_output: standard output is a pipe to the caller.
        folder: working folder.
        given: standard input, in place of the lifeline: for a child that ends by itself.
        whole: all of its environment, which says itself who its parent is.
        descriptors: further open files that it inherits under the same numbers.
        kind: what is returned.
    """
    variables = whole or {
        **os.environ,
        **(environment or {}),
        PARENT_VARIABLE: str(os.getpid()),
    }
    return kind(
        list(arguments),
        stdin=given or subprocess.PIPE,
        stdout=subprocess.PIPE if pipe_output else (log or subprocess.DEVNULL),
        stderr=log or subprocess.DEVNULL,
        env=variables,
        cwd=folder,
        # Its own session: Ctrl-C reaches only the parent, which decides what its children do.
        start_new_session=True,
        pass_fds=descriptors,
        bufsize=0,
    )


def bind_to_parent() -> None:
    """In a child: die with the parent. Does nothing when not started by :func:`spawn`."""
    parent = os.environ.pop(PARENT_VARIABLE, "")
    if parent:
        die_with_parent(parent)


def die_with_parent(parent: str) -> None:
    """In a child of the process ``parent``, a number or :data:`UNKNOWN`: be killed when that one
    ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    # In another pid namespace the parent's number reads 0: the lifeline has to do.
    if parent != UNKNOWN and os.getppid() not in (int(parent), 0):
        sys.exit(0)


def keep_to_itself() -> None:
    """Let no other process of this user read or write this one's memory, open files or
    environment; root may. It leaves no core file."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def give_freed_memory_back() -> bool:
    """Have glibc give the system back what is freed above 128 KiB, as it does at first; False:
    there is no glibc.

    Otherwise its thresholds grow with the largest block that was ever freed, and a conductor that
    keeps a store up to date holds a fifth more of nothing.
    """
    m_trim_threshold, usual_bytes = -1, 128 * 1024
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and mallopt(m_trim_threshold, usual_bytes) == 1


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


SHELL_CODES_MIN = 126
"""Exit codes from this one on are a shell's: a command that could not be run, or a signal."""


def left_by_itself(code: int) -> bool:
    """Whether the end of a stack's process is its own doing: an exit code that is neither a signal
    as shells tell it, nor a command that could not be run, nor one of ours for the machine."""
    return 0 <= code < SHELL_CODES_MIN and code not in (EXIT_INFRASTRUCTURE, EXIT_UNFINISHED)


LOG_BYTES_MAX = 64 << 20
"""Space on the disk that a log may take [bytes]."""

LOG_PART_BYTES = 4 << 20
"""Sizes of its beginning and of its end that are kept of a larger log, each [bytes]."""

_KEEP_SIZE_AND_PUNCH = 0x01 | 0x02


def bound_log(log: IO[bytes], starts: Sequence[int] = (), start_bytes: int = 0) -> None:
    """Give back the middle of a log that has grown too large; whoever writes it notices nothing.

    Its size stays: the middle reads as zeros and takes no space.

    Args:
        log: its file.
        starts: places in it of which the next ``start_bytes`` are kept as well [bytes].
        start_bytes: so many of each [bytes].
    """
    descriptor = log.fileno()
    status = os.fstat(descriptor)
    if status.st_blocks * 512 <= LOG_BYTES_MAX:
        return
    library = ctypes.CDLL(None, use_errno=True)
    until, begin = status.st_size - LOG_PART_BYTES, LOG_PART_BYTES
    for start in (*sorted(start for start in starts if begin < start < until), until):
        start_and_length = ctypes.c_int64(begin), ctypes.c_int64(start - begin)
        begin = max(begin, start + start_bytes)
        if start_and_length[1].value <= 0:
            continue
        if library.fallocate(descriptor, _KEEP_SIZE_AND_PUNCH, *start_and_length) != 0:
            os.ftruncate(descriptor, 0)  # a file system without holes gives up all of it
            return


_TRACEBACK = "Traceback (most recent call last):"


def last_frames(text: str) -> list[str]:
    """Lines of the last traceback in ``text`` without its head, what was raised the last of them;
    empty: there is none."""
    start = text.rfind(_TRACEBACK)
    if start < 0:
        return []
    # Frames are indented, and so is what is marked in them; what was raised begins its line.
    match = re.match(r"(?:[ \t]+.*\n|\n)*(?:\S.*)?", text[start + len(_TRACEBACK) + 1 :])
    return [line for line in (match[0] if match else "").splitlines() if line.strip(" ^~")]


def raised_in(log: IO[bytes]) -> str:
    """The last line of the last traceback among the last lines of a log; empty: none is there."""
    size = os.fstat(log.fileno()).st_size
    text = os.pread(log.fileno(), 65536, max(0, size - 65536)).decode("utf-8", "replace")
    raised = next(reversed(last_frames(text)), "")
    return "" if raised[:1].isspace() else raised.rstrip()  # that of a log cut short is a frame


def last_lines(log: IO[bytes], count: int = 3) -> str:
    """The last lines of a child's log, on one line; its write position stays where it is."""
    size = os.fstat(log.fileno()).st_size
    text = os.pread(log.fileno(), 4096, max(0, size - 4096)).decode("utf-8", "replace")
    return " | ".join(line.strip() for line in text.strip().splitlines()[-count:])


@dataclass(frozen=True, slots=True)
class RigChild:
    """A simulator or the host of a stack, which may have been started before there is a rig."""

    process: subprocess.Popen[bytes]
    log: IO[bytes]
    """An unnamed file: gone with its last user, however this process ends. What matters of it, the
    last lines of a process that died, goes to the conductor."""
    protection: str = ""
    """Sandbox of a stack's host: what it is kept from."""

    def discard(self) -> None:
        """End it; it has not been told anything."""
        self.process.kill()
        end(self.process)
        self.log.close()
