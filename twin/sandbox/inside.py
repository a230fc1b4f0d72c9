"""What a process of ours in a sandbox does before it loads a stack."""

from __future__ import annotations

import contextlib
import os
import resource

INSIDE_VARIABLE = "TWIN_SANDBOX"
"""Environment variable of a process in a sandbox: it limits itself before it loads a stack."""

SHARES_VARIABLE = "TWIN_SANDBOX_SHARES"
"""Environment variable of such a process: what its sandbox shares with the host, with commas."""

TASKS_MAX = 1024
"""Most processes and threads of a stack. Linux counts them per user namespace since 5.14, and
not at all for root, where the worker counts."""

OPEN_FILES_MAX = 4096
"""Most open files of one process."""

FILE_BYTES_MAX = 1 << 30
"""Largest file that it may write [bytes]."""

PROCESSES_MAX = 256
"""Most processes in a sandbox; the worker ends one that holds more."""

LIMITS = {
    resource.RLIMIT_CORE: 0,
    resource.RLIMIT_NOFILE: OPEN_FILES_MAX,
    resource.RLIMIT_FSIZE: FILE_BYTES_MAX,
    resource.RLIMIT_NPROC: TASKS_MAX,
}
"""Limits of every process. None of its address space: CUDA reserves far more than it uses."""


def is_inside() -> bool:
    """Whether this process is in a sandbox."""
    return os.environ.get(INSIDE_VARIABLE, "") == "1"


def has_own(kind: str) -> bool:
    """Whether this process is in a sandbox that does not share ``network`` or ``ipc``: no process
    outside reaches its loopback, or its ``/dev/shm``, which goes with it."""
    return is_inside() and kind not in os.environ.get(SHARES_VARIABLE, kind).split(",")


def limit_self() -> None:
    """Take on the limits, if this is the inside of a sandbox; nobody in it can raise them."""
    if not is_inside():
        return
    for limit, most in LIMITS.items():
        _, now = resource.getrlimit(limit)
        value = most if now == resource.RLIM_INFINITY else min(most, now)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(limit, (value, value))
