"""New files are written once, with names that can be used, and nothing is overwritten."""

import os
import shlex
from pathlib import Path

import pytest

from conductor.new.writing import (
    NAME_MAX,
    NO_TEXTS,
    TEMPLATES,
    new_campaign,
    new_plugin,
    new_scenario,
    new_stack,
)
from schemas.files.yaml_file import parse_yaml
from twin.base.errors import InfrastructureError, UsageError

MAKERS = [new_campaign, new_stack, new_scenario, new_plugin]


@pytest.mark.parametrize("make", MAKERS)
def test_nothing_is_left_to_fill_and_nothing_is_overwritten(tmp_path, make):
    made = make("rainy-night", tmp_path)
    files = [made.path] if made.path.is_file() else [p for p in made.path.rglob("*") if p.is_file()]
    texts = {path: path.read_text() for path in files}
    assert texts
    for path, text in texts.items():
        assert "@" not in text.replace("@NAME", ""), path
        assert not path.name.endswith(".template")
        assert all(len(line) <= 100 for line in text.splitlines()), path
    assert made.next_steps
    assert (Path(__file__).parents[4] / made.page).is_file()
    with pytest.raises(UsageError, match="exists already"):
        make("rainy-night", tmp_path)
    assert {path: path.read_text() for path in files} == texts
    assert len(list(tmp_path.iterdir())) == 1, "nothing temporary stays"


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    "name", ["", "Rainy", "1st", "a b", "../a", "a--b", "a-", "a/b", "ä", "a" * (NAME_MAX + 1)]
)
def test_a_name_that_cannot_be_used_is_refused(tmp_path, make, name):
    with pytest.raises(UsageError, match="allowed are at most"):
        make(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("name", NO_TEXTS)
def test_a_name_that_yaml_takes_for_something_else_is_refused(tmp_path, make, name):
    assert not isinstance(parse_yaml(name, "a name"), str)
    with pytest.raises(UsageError, match="no text"):
        make(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", MAKERS)
def test_steps_can_be_typed_where_a_folder_has_a_blank(tmp_path, make):
    folder = tmp_path / "my runs"
    folder.mkdir()
    for step in make("a1", folder).next_steps:
        words = shlex.split(step)
        assert all(str(tmp_path) not in word or str(folder) in word for word in words), step


@pytest.mark.parametrize("make", [new_stack, new_plugin])
@pytest.mark.parametrize("name", ["json", "class", "numpy", "devkit", "viewer"])
def test_a_module_that_exists_is_not_hidden(tmp_path, make, name):
    with pytest.raises(UsageError, match="choose another"):
        make(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", MAKERS)
def test_a_folder_that_is_not_there(tmp_path, make):
    with pytest.raises(UsageError, match="no such folder"):
        make("a", tmp_path / "none")


def test_a_link_in_the_way_is_not_followed(tmp_path):
    (tmp_path / "a.yaml").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match="exists already"):
        new_campaign("a", tmp_path)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
@pytest.mark.parametrize("make", MAKERS)
def test_a_folder_that_cannot_be_written(tmp_path, make):
    tmp_path.chmod(0o500)
    with pytest.raises((UsageError, InfrastructureError), match="Permission denied"):
        make("a", tmp_path)


@pytest.mark.parametrize("stack", ["", "mine", "mine:", ":Mine", "a:b:c", "a b:C", "a:B\nx: 1"])
def test_a_stack_that_is_none_is_refused(tmp_path, stack):
    with pytest.raises(UsageError, match="MODULE:CLASS"):
        new_campaign("a", tmp_path, stack)


def test_templates_of_modules_are_no_modules():
    assert not list(TEMPLATES.rglob("*.py")), "ours are linted and imported"
    assert len(list(TEMPLATES.rglob("*.template"))) == 6
