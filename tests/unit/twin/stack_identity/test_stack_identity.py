"""Identities of stacks: what differs is named, and what is loaded beside is noticed."""

from __future__ import annotations

import importlib
import sys

import pytest

from schemas.sections.stack_identity import StackIdentity, StackSource, difference
from twin.base.errors import RefusedError
from twin.stack_identity.content import tree_digest
from twin.stack_identity.identity import (
    PARTS_MAX,
    Named,
    confirm,
    find_stack,
    identity_of,
    named_files,
)
from twin.stack_identity.loaded import LoadedModules


def sha(number):
    return f"{number:064x}"[::-1]


def test_what_differs_is_named():
    before = identity_of({"a.py": sha(1), "b.py": sha(2), "installed/x 1": sha(3)})
    same = identity_of({"b.py": sha(2), "a.py": sha(1), "installed/x 1": sha(3)})
    assert difference(before, same) == ""
    changed = identity_of({"a.py": sha(1), "b.py": sha(9), "installed/x 1": sha(3)})
    assert difference(before, changed) == "b.py has changed"
    moved = identity_of({"a.py": sha(1), "b.py": sha(2), "installed/x 2": sha(4)})
    assert difference(before, moved) == "installed/x 1 is missing (and 1 more)"
    more = identity_of({"a.py": sha(1), "b.py": sha(2), "c.py": sha(5), "installed/x 1": sha(3)})
    assert difference(before, more) == "c.py is new"
    assert "have changed" in difference(before, StackIdentity("f00d"))


@pytest.mark.parametrize("count", [PARTS_MAX, PARTS_MAX + 1, 5000])
def test_an_identity_stays_small(count):
    contents = {f"mine/{i % 7}/{i}.py": sha(i + 1) for i in range(count)}
    found = identity_of(contents)
    assert len(found.parts) <= PARTS_MAX
    contents["mine/3/3.py"] = sha(0)
    what = difference(found, identity_of(contents))
    assert what in ("mine/3/3.py has changed", "mine/3 has changed")


def test_distributions_are_put_together_before_files():
    files = {f"{i}.py": sha(i + 1) for i in range(5)}
    installed = {f"installed/d{i} 1": sha(i + 1) for i in range(60)}
    parts = identity_of(files | installed).parts
    assert list(parts) == [*files, "installed"]


def test_so_many_modules_that_none_is_named():
    contents = {f"{i}.py": sha(i + 1) for i in range(100)} | {"autonomy.image": sha(7)}
    assert list(identity_of(contents).parts) == ["one of its files", "autonomy.image"]


@pytest.fixture
def stack(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "stack_of_mine.py").write_text("import counted_beside\n")
    (tmp_path / "counted_beside.py").write_text("")
    (tmp_path / "uncounted.py").write_text("")
    yield tmp_path
    for name in ("stack_of_mine", "counted_beside", "uncounted", "wsgiref.headers"):
        sys.modules.pop(name, None)


def test_another_stack_is_refused_in_one_line(stack):
    named = Named("stack_of_mine:X")
    submitted = find_stack(named).identity
    source = StackSource(identity=submitted)
    assert confirm(named, source, {}).identity == submitted
    assert confirm(named, StackSource(), {}) is None
    (stack / "counted_beside.py").write_text("x = 1")
    with pytest.raises(RefusedError) as caught:
        confirm(named, source, {})
    (line,) = str(caught.value).splitlines()
    assert line.startswith("stack stack_of_mine:X: counted_beside.py has changed since the")
    assert "--out" in line
    (stack / "stack_of_mine.py").unlink()
    with pytest.raises(RefusedError, match="no module 'stack_of_mine'"):
        confirm(named, source, {})


def test_modules_loaded_beside_import_statements_are_noticed(stack):
    loaded = LoadedModules(find_stack(Named("stack_of_mine:X")), "stack stack_of_mine:X")
    importlib.import_module("stack_of_mine")
    importlib.import_module("wsgiref.headers")
    importlib.import_module("schemas.sections.stack_identity")
    loaded.check()
    importlib.import_module("uncounted")
    with pytest.raises(RefusedError, match=r"it loads .*/uncounted.py otherwise .* autonomy.files"):
        loaded.check()


def test_modules_named_by_the_campaign_may_be_loaded_so(stack):
    named = Named("stack_of_mine:X", files=[str(stack / "uncounted.py")])
    loaded = LoadedModules(find_stack(named), "stack stack_of_mine:X")
    importlib.import_module("stack_of_mine")
    importlib.import_module("uncounted")
    assert loaded.check() is None


def test_a_file_that_a_parameter_names_is_compared_by_its_value(stack):
    (stack / "map.json").write_text("1")
    source = StackSource(parameters=named_parameters(stack))
    given = {"map": "map.json", "gain": 2}
    assert confirm(Named("stack_of_mine:X"), source, given) is None
    (stack / "map.json").write_text("2")
    with pytest.raises(RefusedError, match=r"map \(map.json\) has changed since .* --out"):
        confirm(Named("stack_of_mine:X"), source, given)
    (stack / "map.json").unlink()
    with pytest.raises(RefusedError, match=r"parameters.map \(map.json\) is missing since"):
        confirm(Named("stack_of_mine:X"), source, given)


def named_parameters(folder):
    """Digests of the parameters of a case."""
    return {"map": named_files(["map.json"])["map.json"]}


def test_an_image_is_the_same_with_the_empty_folders_that_its_runtime_makes(tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    image = tmp_path / "image"
    (image / "bin").mkdir(parents=True)
    (image / "bin/run").write_text("a")
    before = tree_digest(image)
    (image / "home/me/runs").mkdir(parents=True)
    assert tree_digest(image) == before
    (image / "home/me/runs/evil").write_text("b")
    assert tree_digest(image) != before
