"""What a stack raises: told in its log with all frames, and to the simulator in one line.

An exception of a stack's own is its outcome, which it would have again. The machine's trouble (no
memory, a full disk, a lost connection) is not: such an attempt is repeated.
"""

from __future__ import annotations

import errno
import io
import sys
import traceback
from pathlib import Path

from schemas import SCHEMA_VERSION
from schemas.messages import Commands
from twin.base.errors import StackFaultError, TwinError

SHORTAGES = frozenset(
    (errno.ENOMEM, errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.EIO)
)
"""Errors of the operating system that say that a machine has run out of something."""

OUT_OF_MEMORY = "OutOfMemoryError"
"""Name of the error in libraries of GPUs; they are not imported to ask."""


def is_machines(error: BaseException) -> bool:
    """Whether the machine is to blame for ``error``, and not the stack that raised it."""
    if isinstance(error, TwinError):
        return not isinstance(error, StackFaultError)
    if isinstance(error, OSError) and error.errno in SHORTAGES:
        return True
    return isinstance(error, MemoryError) or type(error).__name__ == OUT_OF_MEMORY


def told(error: BaseException | None) -> None:
    """Print ``error`` with its traceback, unless it is a line for people already."""
    if error is None:
        return
    sys.stdout.flush()
    if isinstance(error, TwinError):
        print(error, file=sys.stderr, flush=True)
    else:
        traceback.print_exception(error)
        sys.stderr.flush()


def refusal(seq: int, error: BaseException) -> Commands:
    """Why the stack cannot go on, in one line."""
    reason = f"{type(error).__name__}: {error} ({_origin(error)})"
    if isinstance(error, TwinError):  # one line for people already
        reason = str(error)
    return Commands(
        v=SCHEMA_VERSION, seq=seq, commands=[], error=reason, infrastructure=is_machines(error)
    )


def line_buffered() -> None:
    """Buffer standard output by line, so that a stack's log shows when a line was printed."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)


def _origin(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return "unknown place"
    return f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
