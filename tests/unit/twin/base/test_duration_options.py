"""Durations on the command line: finite, or one line and exit code 2."""

import importlib

import pytest
import typer
from typer.testing import CliRunner

from twin.base.errors import EXIT_USAGE

COMMANDS = ("twin", "devkit", "conductor", "viewer", "hpc")


def options(command, path):
    for name, below in getattr(command, "commands", {}).items():
        yield from options(below, (*path, name))
    for option in getattr(command, "params", []):
        yield path, option


def durations():
    """Every option whose help has the unit [s] and that is no whole number."""
    for name in COMMANDS:
        app = importlib.import_module(f"{name}.cli").app
        for path, option in options(typer.main.get_command(app), (name,)):
            kind = str(option.type_descriptor.annotation)
            if "float" in kind and "[s]" in (getattr(option, "help", "") or ""):
                yield path, option


def test_every_duration_has_an_end():
    found = {(" ".join(path), option.opts[0]): option for path, option in durations()}
    assert {("twin worker", "--drain-s"), ("conductor serve", "--ttl-s")} <= set(found)
    assert len(found) >= 8
    endless = [name for name, option in found.items() if option.max is None or option.min is None]
    assert not endless, "take twin.base.cli.duration"


@pytest.mark.parametrize("given", ["nan", "inf", "-inf", "1e400"])
@pytest.mark.parametrize("option", ["--drain-s", "--walltime-s", "--wait", "--memory-gb"])
def test_what_is_no_duration_is_one_line(option, given):
    app = importlib.import_module("twin.cli").app
    done = CliRunner().invoke(app, ["worker", "--connect", "tcp/127.0.0.1:1", option, given])
    assert done.exit_code == EXIT_USAGE
    assert done.output.splitlines()[-1].startswith(f"Error: Invalid value for '{option}'")
