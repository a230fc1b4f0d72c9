"""What a command does around its work: one-line errors, exit codes, signals.

It does not load typer, so a worker that reads no command line runs in it, too.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
from collections.abc import Callable

from schemas.wire.codec import WireError
from twin.base.errors import (
    EXIT_INFRASTRUCTURE,
    EXIT_INTERRUPTED,
    EXIT_UNFINISHED,
    EXIT_USAGE,
    TwinError,
    page_of,
    storage_error,
)
from twin.base.software import check_packages, missing_package

_is_command = False
"""Whether this process is one of the commands: what it may open is decided for all of it."""


def is_command() -> bool:
    """Whether this process is one of the commands, and not a program that uses the package."""
    return _is_command


SECONDS_MAX = 1e9
"""Longest duration that anybody gives, 32 years; without a limit ``inf`` and ``nan`` pass [s]."""
_AGAIN = "run the same command again to go on"


class Terminated(BaseException):
    """SIGTERM came, to a command that does not handle it otherwise; everything is cleaned up."""


_interrupted: list[int] = []
"""Signals that have come."""


def heed_signals() -> None:
    """Raise again what a signal raised, if what it hit has swallowed it: an import, a callback."""
    if _interrupted:
        raise Terminated if signal.SIGTERM in _interrupted else KeyboardInterrupt


def run(app: Callable[[], object], name: str) -> None:
    """Run an app; user errors become one line on stderr and their exit code."""
    global _is_command
    _is_command = True
    _interrupted.clear()

    def on_interrupt(number: int, _frame: object) -> None:
        _interrupted.append(number)
        raise KeyboardInterrupt

    def on_terminate(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_IGN)
        _interrupted.append(number)
        raise Terminated

    signal.signal(signal.SIGINT, on_interrupt)
    signal.signal(signal.SIGTERM, on_terminate)
    try:
        check_packages()
        app()
    except TwinError as error:
        page = page_of(error.__traceback__) if error.exit_code == EXIT_USAGE else ""
        _fail(name, str(error), error.exit_code, page)
    except WireError as error:
        _fail(name, str(error), EXIT_USAGE)
    except (KeyboardInterrupt, Terminated):
        _stopped(name)
    except BrokenPipeError:
        _unheard()
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # typer makes a 1 of it
            _unheard()
        raise
    except OSError as error:
        failure = storage_error(error, error.filename or name)
        _fail(name, str(failure), failure.exit_code)
    except ModuleNotFoundError as error:
        line = missing_package(error)
        if not line:
            raise
        _fail(name, line, EXIT_USAGE)
    except MemoryError:
        _fail(name, "out of memory; use fewer slots or workers", EXIT_INFRASTRUCTURE)
    except Exception:
        # An interrupt in the middle of an import or a callback comes out as something else.
        if not _interrupted:
            raise
        _stopped(name)


def _unheard() -> None:
    """The reader of our output left (``| head``); Python would complain once more at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(128 + signal.SIGPIPE)


def _stopped(name: str) -> None:
    if signal.SIGTERM in _interrupted:
        _fail(name, f"terminated; {_AGAIN}", EXIT_UNFINISHED)
    _fail(name, f"interrupted; {_AGAIN}", EXIT_INTERRUPTED)


def _fail(name: str, line: str, code: int, page: str = "") -> None:
    parts = line.splitlines()  # none: a process of ours has said it
    if parts and page and page not in parts[-1]:
        parts[-1] = f"{parts[-1]}; see {page}"
    for part in parts:
        print(f"{name}: {part}", file=sys.stderr)
    sys.exit(code)


class StopSignal:
    """Somebody has asked this process to end; made in the main thread, where it is waited for.

    ``threading.Event`` is not meant for this: a handler that calls ``set()`` while the main thread
    is inside ``wait()`` waits for the lock that the thread below it holds, for ever.
    """

    def __init__(self) -> None:
        """Take both signals over for the rest of the process."""
        self._asked = False
        # The one queue of Python whose put() may interrupt its own get().
        self._bell: queue.SimpleQueue[None] = queue.SimpleQueue()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._receive)

    def wait(self, timeout_s: float) -> bool:
        """Whether somebody has asked, after ``timeout_s`` at the latest."""
        if not self._asked:
            try:
                self._bell.get(timeout=timeout_s)
            except queue.Empty:
                pass
        return self._asked

    def _receive(self, _number: int, _frame: object) -> None:
        self._asked = True
        self._bell.put(None)
