"""Which files a stack consists of, found by the syntax of its sources alone."""

from __future__ import annotations

import os
import sys
import textwrap

import pytest

from schemas.sections.foreign import ContainerImage, Foreign, Repository
from twin.base.errors import UsageError
from twin.stack_identity import content
from twin.stack_identity.identity import Named, find_stack, named_files
from twin.stack_identity.imports import locate


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes files below a folder on the path of modules, which is also the working folder."""
    monkeypatch.chdir(tmp_path)

    def wrote(**files):
        for name, text in files.items():
            path = tmp_path / name.replace("__", "/").replace("_py", ".py").replace("_txt", ".txt")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(textwrap.dedent(text))
        return tmp_path

    return wrote


def package(folder, name, **files):
    """A package of these modules; ``init`` is its ``__init__``."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    for module, text in {"init": "", **files}.items():
        file = "__init__" if module == "init" else module
        (folder / name / f"{file}.py").write_text(text)
    return folder / name


def names(stack, **named):
    """Names of the parts of a stack that are no installed distributions."""
    found = find_stack(Named(stack, **named))
    return [name for name in found.identity.parts if not name.startswith("installed")]


def test_a_module_and_what_it_imports_wherever_the_statement_stands(write):
    write(
        mine_py="""
            import first
            def f():
                from second import anything
            try:
                import absent
            except ImportError:
                pass
            class C:
                import third as renamed
        """,
        first_py="import fourth",
        second_py="anything = 1",
        third_py="",
        fourth_py="",
        unrelated_py="",
    )
    assert names("mine:C") == ["first.py", "fourth.py", "mine.py", "second.py", "third.py"]


def test_a_package_counts_with_all_its_files_and_is_walked_relatively(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = package(tmp_path, "mine", drive="from . import near\nfrom .deep.er import x")
    package(folder, "deep", er="from ..up import y\nfrom ... import beyond", unused="import never")
    (folder / "near.py").write_text("import beside")
    (folder / "up.py").write_text("y = 1")
    (folder / "data.bin").write_bytes(b"\0")
    (tmp_path / "beside.py").write_text("")
    (tmp_path / "never.py").write_text("")
    assert names("mine.drive:X") == [
        *("beside.py", "mine/__init__.py", "mine/data.bin", "mine/deep/__init__.py"),
        *("mine/deep/er.py", "mine/deep/unused.py", "mine/drive.py", "mine/near.py", "mine/up.py"),
    ]


def test_imports_in_a_circle_end(write):
    write(mine_py="import other", other_py="import mine\nimport other")
    assert names("mine:X") == ["mine.py", "other.py"]


def test_a_namespace_of_the_stack_counts_whole_and_one_that_is_imported_by_its_parts(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spaces" / "inner").mkdir(parents=True)
    (tmp_path / "spaces" / "stack.py").write_text("from company.tools import x\nimport company.one")
    (tmp_path / "spaces" / "weights.txt").write_text("1")
    (tmp_path / "company").mkdir()
    (tmp_path / "company" / "one.py").write_text("")
    (tmp_path / "company" / "two.py").write_text("")
    package(tmp_path / "company", "tools", x="")
    assert names("spaces.stack:X") == [
        *("company/one.py", "company/tools/__init__.py", "company/tools/x.py"),
        *("spaces/stack.py", "spaces/weights.txt"),
    ]


def test_nothing_of_a_stack_is_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    boom = "raise SystemExit('run')"
    package(tmp_path, "mine", init=boom, drive=boom)
    before = set(sys.modules)
    assert names("mine.drive:X") == ["mine/__init__.py", "mine/drive.py"]
    assert locate("mine.drive").origin == str(tmp_path / "mine" / "drive.py")
    assert locate("mine.absent") is None
    assert locate("absent") is None
    assert set(sys.modules) - before == set()


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (b"def f(:\n", "mine.py line 1: cannot be read as Python (invalid syntax)"),
        (b"x = 1\0", "mine.py"),
        (b"\xff\xfe = 1", "mine.py"),
        (b"# coding: nonsense\n", "mine.py"),
        (b"-" * 100_000 + b"1", "mine.py"),
    ],
)
def test_a_source_that_is_no_python_is_one_line(tmp_path, monkeypatch, source, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_bytes(source)
    with pytest.raises(UsageError) as caught:
        find_stack(Named("mine:X"))
    (line,) = str(caught.value).splitlines()
    assert words in line
    assert "cannot be read as Python" in line


def test_a_missing_module_is_one_line_with_what_to_do():
    with pytest.raises(
        UsageError, match=r"no module 'not_here.drive'; install it or put its folder on"
    ):
        find_stack(Named("not_here.drive:X"))


def test_runs_caches_environments_and_hidden_files_do_not_count(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = package(tmp_path, "mine", drive="")
    left_out = {
        "runs/aeb/conductor.db": "",
        "runs/aeb/cases/x/kpi.parquet": "",
        "served/campaign.yaml": "",
        "served/outcomes.json": "",
        "env/pyvenv.cfg": "",
        "env/lib/python3.11/site-packages/numpy/__init__.py": "",
        "cached/CACHEDIR.TAG": "",
        "__pycache__/drive.cpython-311.pyc": "",
        ".git/HEAD": "",
        ".hidden": "",
        "drive.py~": "",
        "old.pyc": "",
        "old.py": "",
    }
    for name, text in left_out.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    os.mkfifo(folder / "pipe")
    assert names("mine.drive:X") == ["mine/__init__.py", "mine/drive.py", "mine/old.py"]


def test_links_in_a_circle_end_and_linked_files_count_by_content(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = package(tmp_path, "mine", drive="")
    (folder / "loop").symlink_to(folder)
    (folder / "sub").mkdir()
    (folder / "sub" / "up").symlink_to("..")
    (folder / "nowhere").symlink_to("absent")
    (tmp_path / "table.txt").write_text("1")
    (folder / "table.txt").symlink_to("../table.txt")
    assert names("mine.drive:X") == ["mine/__init__.py", "mine/drive.py", "mine/table.txt"]
    before = find_stack(Named("mine.drive:X")).identity
    (tmp_path / "table.txt").write_text("2")
    assert find_stack(Named("mine.drive:X")).identity.digest != before.digest


@pytest.mark.parametrize(("limit", "value"), [("FILES_MAX", 2), ("BYTES_MAX", 3)])
def test_a_huge_folder_is_one_line(tmp_path, monkeypatch, limit, value):
    monkeypatch.chdir(tmp_path)
    folder = package(tmp_path, "mine", drive="")
    find_stack(Named("mine.drive:X"))
    (folder / "more.txt").write_text("1234")
    monkeypatch.setattr(content, limit, value)
    with pytest.raises(UsageError, match=f"{folder}: more than .* belong to the stack; take"):
        find_stack(Named("mine.drive:X"))


def test_standard_library_and_own_packages_do_not_count_and_a_local_module_of_its_name_does(write):
    write(mine_py="import json, os.path, twin.rig.engine, devkit.aeb, statistics", statistics_py="")
    assert names("mine:X") == ["mine.py", "statistics.py"]
    assert find_stack(Named("devkit.aeb:AebStack")).identity.digest == ""


def test_installed_distributions_count_by_version_and_record(write):
    folder = write(mine_py="import numpy\nimport libfoo.sub", site__libfoo____init___py="")
    info = folder / "site" / "Lib_Foo-1.2.dist-info"
    package(folder / "site", "libfoo", sub="")
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: Lib_Foo\nVersion: 1.2\n")
    record = "libfoo/sub.py,sha256=aa,1\n../../bin/foo,sha256=bb,1\nlibfoo/x.pyc,,\n"
    (info / "RECORD").write_text(record)
    sys.path.append(str(folder / "site"))
    try:
        before = find_stack(Named("mine:X")).identity
        assert "installed/lib-foo 1.2" in before.parts
        assert any(name.startswith("installed/numpy ") for name in before.parts)
        assert "libfoo/sub.py" not in before.parts
        (info / "RECORD").write_text(record.replace("=bb", "=cc"))
        assert find_stack(Named("mine:X")).identity == before, "scripts differ per environment"
        (info / "RECORD").write_text(record.replace("=aa", "=dd"))
        assert find_stack(Named("mine:X")).identity.digest != before.digest
    finally:
        sys.path.remove(str(folder / "site"))


def test_named_files_folders_and_parameters_count_by_content(write):
    folder = write(mine_py="", maps__a_txt="1", maps__deep__b_txt="2", plug_py="")
    named = {
        "files": [str(folder / "plug.py"), str(folder / "maps")],
    }
    assert names("mine:X", **named) == [
        *("autonomy.files[0]", "autonomy.files[1]/a.txt", "autonomy.files[1]/deep/b.txt"),
        "mine.py",
    ]
    values = ["maps/a.txt", "./maps", "maps", 3, True, "", "no such", "x" * 5000, "nul\0"]
    before = named_files(values)
    assert list(before) == ["maps/a.txt", "./maps"]
    (folder / "maps" / "deep" / "b.txt").write_text("3")
    after = named_files(values)
    assert [before[name] == after[name] for name in before] == [True, False]
    with pytest.raises(UsageError, match=r"autonomy.files\[0\]: .*absent: no such file or folder"):
        find_stack(Named("mine:X", files=[str(folder / "absent")]))


def test_the_same_stack_elsewhere_is_the_same(tmp_path, monkeypatch):
    found = []
    for place in ("here", "there"):
        folder = tmp_path / place
        package(folder, "mine", drive="import helper")
        (folder / "helper.py").write_text("")
        monkeypatch.chdir(folder)
        found.append(find_stack(Named("mine.drive:X", files=[str(folder / "helper.py")])).identity)
    assert found[0] == found[1]


def test_the_words_of_a_command_that_are_files_count_with_what_they_import(write):
    folder = write(run_py="import near, numpy", near_py="", conf_txt="a: 1")
    (folder / "app").mkdir()
    (folder / "app" / "__main__.py").write_text("import near\n")
    (folder / "tool").write_text("#!/usr/bin/env python3\nimport near\n")

    def parts(*command, **places):
        return names("", foreign=Foreign(list(command), **places))

    assert parts(sys.executable, "run.py", "--conf=conf.txt", "--fast") == [
        *("autonomy.command[1]", "autonomy.command[2]", "near.py"),
    ]
    assert parts("./tool") == ["autonomy.command[0]", "near.py"]
    assert parts("sh", "-c", "true") == []
    assert parts(sys.executable, "-m", "app") == ["app/__main__.py", "near.py"]
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "there.py").write_text("import nearby")
    (folder / "elsewhere" / "nearby.py").write_text("")
    assert parts("env", "-C", "elsewhere", sys.executable, "there.py") == [
        *("autonomy.command[4]", "nearby.py"),
    ]
    repository = Repository("https://example.org/x", ref="f00d")
    assert parts(sys.executable, "run.py", repository=repository) == ["autonomy.repository"]


def test_an_image_counts_by_its_content_and_is_read_once(write, monkeypatch, tmp_path):
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(content, "KEPT_BYTES_MIN", 1)
    read = []
    monkeypatch.setattr(content, "file_digest", lambda path, most: read.append(path) or "ab" * 32)
    folder = write(x_txt="")
    (folder / "image.sif").write_bytes(b"layers")
    (folder / "unpacked").mkdir()
    (folder / "unpacked" / "link").symlink_to("nowhere")
    (folder / "unpacked" / "file").write_text("1")
    for image in ("image.sif", "unpacked"):
        named = Named("", Foreign(["drive"], image=ContainerImage(str(folder / image))))
        first = find_stack(named).identity
        assert list(first.parts) == ["autonomy.image"]
        count = len(read)
        assert find_stack(named).identity == first
        assert len(read) == count
    (folder / "unpacked" / "file").write_text("22")
    assert len(read) == 2
    find_stack(named)
    assert len(read) == 3
