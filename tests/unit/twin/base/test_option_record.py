"""Options that several commands share."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from conductor.cli import app as conductor
from twin.base.option_record import with_options
from viewer.cli import app as viewer


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Two options."""

    host: Annotated[str, typer.Option(help="Where.")]
    port: Annotated[int, typer.Option("--port", min=1, help="Which door.")] = 80


@pytest.fixture
def app():
    made = typer.Typer()

    @made.command()
    @with_options
    def visit(
        who: str, place: Place, loud: Annotated[bool, typer.Option("--loud")] = False
    ) -> None:
        """Go there."""
        print(who, place, loud)

    return made


def test_a_record_is_one_option_per_field(app):
    done = CliRunner().invoke(app, ["me", "--host", "h", "--loud"])
    assert done.output == "me Place(host='h', port=80) True\n"
    assert CliRunner().invoke(app, ["me", "--host", "h", "--port", "7"]).output.count("port=7") == 1


def test_fields_are_checked_as_parameters_are(app):
    done = CliRunner().invoke(app, ["me"])
    assert (done.exit_code, "--host" in done.output) == (2, True)
    done = CliRunner().invoke(app, ["me", "--host", "h", "--port", "0"])
    assert (done.exit_code, "--port" in done.output) == (2, True)


def test_help_shows_them_where_the_parameter_stands(app):
    shown = CliRunner().invoke(app, ["--help"]).output
    assert "Go there." in shown
    assert shown.index("--host") < shown.index("--port") < shown.index("--loud")


def _helps(app: typer.Typer, option: str) -> dict[str, str]:
    """Help of an option by command; `--state` where it is no other name of `--run`."""
    group = typer.main.get_command(app)
    return {
        name: parameter.help
        for name, command in group.commands.items()
        for parameter in command.params
        if option in getattr(parameter, "opts", ())
        and not (option == "--state" and "--run" in parameter.opts)
    }


@pytest.mark.parametrize("option", ["--connect", "--state", "--run", "--namespace", "--insecure"])
def test_commands_that_connect_say_it_alike(option):
    found = {**_helps(conductor, option), **_helps(viewer, option)}
    # Others are asked for with the same words: where to listen, whose keys, one rig's stream, the
    # run that was certified.
    apart = ("serve", "keygen", "invite", "revoke", "record", "audit")
    alike = {name: text for name, text in found.items() if name not in apart}
    assert len(alike) >= 8
    assert len(set(alike.values())) == 1
