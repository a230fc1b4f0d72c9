"""What the five commands have in common: one-line errors, exit codes, ``--version``."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any

import typer

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
from twin.base.software import check_packages, missing_package, own_version

EXIT_CODES = (
    "Exit codes: 0 all passed, 1 a verdict is not a pass, 2 usage or bad input, "
    "3 infrastructure lost, 75 unfinished (run again to resume), 130 interrupted, "
    "141 nobody read the output."
)
"""Stands below every command's help."""


class Output(StrEnum):
    """Format in which results are printed."""

    human = "human"
    json = "json"


OutputOption = Annotated[Output, typer.Option("--output", help="Format on standard output.")]

_is_command = False
"""Whether this process is one of the commands: what it may open is decided for all of it."""


def is_command() -> bool:
    """Whether this process is one of the commands, and not a program that uses the package."""
    return _is_command


SECONDS_MAX = 1e9
"""Longest duration that an option takes, 32 years; without a limit ``inf`` and ``nan`` pass [s]."""


def duration(text: str, *, least: float = 0.0, most: float = SECONDS_MAX, **more: Any) -> Any:
    """The option of a duration [s]: a finite number in a range, anything else is one clear line.

    Args:
        text: its help.
        least, most: its range [s].
        more: further arguments of :func:`typer.Option`.
    """
    return typer.Option(min=least, max=most, help=text, **more)


def version_option() -> Any:
    """The option ``--version`` of a command."""
    return typer.Option(
        False, "--version", is_eager=True, callback=_version, help="Print the version."
    )


def make_app(name: str, help_text: str) -> typer.Typer:
    """A typer app in the house style."""
    app = typer.Typer(
        name=name,
        help=help_text,
        epilog=EXIT_CODES,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback(invoke_without_command=False)
    def _root(version: bool = version_option()) -> None:
        """Options of every command."""

    # typer takes the group's help from the callback's docstring otherwise.
    assert app.registered_callback is not None
    app.registered_callback.help = help_text
    app.registered_callback.epilog = EXIT_CODES
    return app


_AGAIN = "run the same command again to go on"


class Terminated(BaseException):
    """SIGTERM came, to a command that does not handle it otherwise; everything is cleaned up."""


def _version(value: bool) -> None:
    if value:
        print(f"drivetwin {own_version()}")
        raise typer.Exit


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
