"""What the command lines of the five commands have in common: options, help, ``--version``."""

from __future__ import annotations

import copy
import sys
from enum import StrEnum
from typing import Annotated, Any

import typer
from typer.main import get_command_name
from typer.models import CommandInfo

from twin.base.command import SECONDS_MAX
from twin.base.software import own_version

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


class App(typer.Typer):
    """A typer app that, as a program, takes only the command that is named apart: typer would look
    at the options of all of them at every start, which takes 20 ms."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command of ``sys.argv``."""
        named = copy.copy(self)
        if word := next(iter(sys.argv[1:]), ""):
            commands = [each for each in self.registered_commands if _name(each) == word]
            groups = [each for each in self.registered_groups if each.name == word]
            if commands or groups:  # otherwise it is help, an option or a mistake, which name all
                named.registered_commands, named.registered_groups = commands, groups
        return super(App, named).__call__(*args, **kwargs)


def _name(command: CommandInfo) -> str:
    return command.name or get_command_name(getattr(command.callback, "__name__", ""))


def make_app(name: str, help_text: str) -> typer.Typer:
    """A typer app in the house style."""
    app = App(
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


def _version(value: bool) -> None:
    if value:
        print(f"drivetwin {own_version()}")
        raise typer.Exit
