"""``drivetwin`` lists the commands; what an installation lacks is said in a line."""

import json
import re

import pytest
from typer.testing import CliRunner

from drivetwin.cli import COMMANDS, app
from twin.base.software import ALL_PACKAGES, missing_package


def test_every_command_has_a_line():
    done = CliRunner().invoke(app, [])
    assert done.exit_code == 0
    first = [line.split()[0] for line in done.stdout.splitlines()[: len(COMMANDS)]]
    assert tuple(first) == COMMANDS
    lines = json.loads(CliRunner().invoke(app, ["--output", "json"]).stdout)
    assert set(lines) == set(COMMANDS)
    assert all(re.fullmatch(r"[A-Z].{8,}\.", line) for line in lines.values()), lines
    assert set(COMMANDS) <= set(ALL_PACKAGES)


def test_an_unknown_command_is_refused():
    assert CliRunner().invoke(app, ["condutor"]).exit_code == 2


@pytest.mark.parametrize(
    "name", ["plotly", "plotly.graph_objects", "viewer.cli", "rerun", "pyarrow.parquet"]
)
def test_what_the_workers_distribution_is_without_is_said_in_a_line(name):
    line = missing_package(ModuleNotFoundError(f"No module named '{name}'", name=name))
    assert name.partition(".")[0] in line
    assert "pip install drivetwin" in line


def test_what_the_workers_distribution_has_as_an_option_is_said_in_a_line():
    line = missing_package(ModuleNotFoundError("No module named 'cv2'", name="cv2"))
    assert line.startswith("this needs the package cv2, ")
    assert line.endswith("pip install 'drivetwin-worker[networks]'")


@pytest.mark.parametrize("name", ["numpy", "schemas.nothing", None])
def test_another_missing_module_is_a_mistake_of_ours(name):
    assert missing_package(ModuleNotFoundError("No module", name=name)) == ""
