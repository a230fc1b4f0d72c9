"""``conductor new``: a campaign, stack, scenario or plug-in to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from conductor.new.writing import NewThing

Name = Annotated[str, typer.Argument(help="Its name, e.g. rainy-night; the file is called so.")]
Into = Annotated[Path, typer.Option(help="Folder to write into; it must exist.")]
Stack = Annotated[
    str, typer.Option(metavar="MODULE:CLASS", help="Its stack; default: the shipped one.")
]


def add_new_commands(app: typer.Typer) -> None:
    """Add the group ``new`` to ``app``."""
    group = typer.Typer(
        name="new",
        help="Write a campaign, stack, scenario or plug-in to begin with; it runs as it is. "
        "What exists is never overwritten.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    group.command("campaign")(campaign)
    group.command("stack")(stack_command)
    group.command("scenario")(scenario)
    group.command("plugin")(plugin)
    app.add_typer(group)


def campaign(name: Name, into: Into = Path(), stack: Stack = "") -> None:
    """Write NAME.yaml, a campaign of two short cases."""
    from conductor.new.writing import STACK, new_campaign

    _say(new_campaign(name, into, stack or STACK))


def stack_command(name: Name, into: Into = Path()) -> None:
    """Write NAME.py, a stack that drives and brakes for what is near."""
    from conductor.new.writing import new_stack

    _say(new_stack(name, into))


def scenario(name: Name, into: Into = Path()) -> None:
    """Write NAME.yaml, a scenario in which a car cuts in."""
    from conductor.new.writing import new_scenario

    _say(new_scenario(name, into))


def plugin(name: Name, into: Into = Path()) -> None:
    """Write the folder NAME, a distribution with a perception variant, its test and a campaign."""
    from conductor.new.writing import new_plugin

    _say(new_plugin(name, into))


def _say(made: NewThing) -> None:
    print(f"wrote {made.path}; {made.page} explains it. Next:")
    for step in made.next_steps:
        print(f"  {step}")
