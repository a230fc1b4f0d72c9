"""Which page an error names."""

import importlib.util
from pathlib import Path

import pytest

from twin.base import command
from twin.base.errors import PAGES, InfrastructureError, UsageError, page_of

DOCS = Path(__file__).parents[4] / "docs"


def raised(module: str, inner: str = "") -> UsageError:
    """An error that a function of ``module`` has raised, in what ``inner`` calls."""
    scope = {"__name__": inner or module, "UsageError": UsageError}
    exec("def fail():\n    raise UsageError('no such thing')\n", scope)
    outer = {"__name__": module, "fail": scope["fail"]}
    exec("def call():\n    fail()\n", outer)
    with pytest.raises(UsageError) as caught:
        outer["call"]()
    return caught.value


@pytest.mark.parametrize("module", PAGES)
def test_every_module_and_page_is_there(module):
    assert importlib.util.find_spec(module) is not None
    assert (DOCS / PAGES[module]).is_file()
    assert page_of(raised(module).__traceback__) == f"docs/{PAGES[module]}"


@pytest.mark.parametrize(
    ("module", "inner", "page"),
    [
        ("conductor.search.space", "", "docs/search.md"),
        ("hpc.sites.file", "", "docs/sites.md"),
        ("hpc.submit", "", "docs/cluster.md"),
        ("conductor.search.driver", "schemas.files.regular_file", "docs/search.md"),
        ("conductor.cli", "conductor.run.places", "docs/gpu.md"),
        ("conductor.cli", "", ""),
        ("searching", "", ""),
        ("hpcx", "", ""),
    ],
)
def test_the_longest_name_counts_and_the_innermost_module(module, inner, page):
    assert page_of(raised(module, inner).__traceback__) == page


def test_an_error_that_was_never_raised_has_none():
    assert page_of(InfrastructureError("lost").__traceback__) == ""


def said(capsys, error: Exception) -> list[str]:
    def app():
        raise error

    with pytest.raises(SystemExit) as stop:
        command.run(app, "conductor")
    assert stop.value.code == 2
    return capsys.readouterr().err.splitlines()


def test_a_command_says_the_page_once_behind_the_last_line(capsys):
    known = raised("conductor.search.space")
    assert said(capsys, known) == ["conductor: no such thing; see docs/search.md"]
    two = UsageError("a: wrong\nb: wrong").with_traceback(known.__traceback__)
    lines = ["conductor: a: wrong", "conductor: b: wrong; see docs/search.md"]
    assert said(capsys, two) == lines
    named = UsageError("wrong; docs/search.md says more").with_traceback(known.__traceback__)
    assert said(capsys, named) == ["conductor: wrong; docs/search.md says more"]
    assert said(capsys, UsageError("wrong")) == ["conductor: wrong"]
