"""The definition of the image, and what is refused before anything is built."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hpc.software.bundle import install_script, write_bundle
from hpc.software.image import (
    BUBBLEWRAP,
    build,
    containerfile,
    default_base,
    definition,
    write_context,
)
from hpc.software.wheels import checked_extras, own_wheel, source_folder
from twin.base.errors import InfrastructureError, UsageError

GOLDEN = Path(__file__).with_name("drivetwin.def")


def test_the_definition():
    assert definition("docker://python:3.11-slim") == GOLDEN.read_text()


@pytest.mark.parametrize(
    ("programs", "asked", "told"),
    [
        ({"bwrap": 0, "apt-get": 0}, "", ""),
        ({"apt-get": 0, "rm": 0}, "update\ninstall bubblewrap\n", ""),
        ({"apt-get": 100}, "update\n", "no bubblewrap"),
        ({}, "", "no bubblewrap"),
    ],
    ids=["in the base", "installed", "no network", "no Debian"],
)
def test_bubblewrap_comes_in_if_it_can_and_the_image_is_built_in_any_case(
    tmp_path, programs, asked, told
):
    note = 'while [ "$1" = -o ]; do shift 2; done; for last; do :; done; '
    note += 'if [ "$1" = install ]; then echo "$1 $last"; else echo "$1"; fi >>notes'
    (tmp_path / "notes").touch()
    for name, code in programs.items():
        words = note if name == "apt-get" else ":"
        (tmp_path / name).write_text(f"#!/bin/sh\n{words}\nexit {code}\n")
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        ["/bin/sh", "-c", f"set -eu\n{BUBBLEWRAP}echo built"],
        env={"PATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "built\n"), done.stderr
    assert (tmp_path / "notes").read_text() == asked
    assert done.stderr.count("no bubblewrap") == bool(told)


def test_the_base_is_a_reference_or_a_path():
    assert "\nBootstrap: localimage\nFrom: /images/base.sif\n" in definition("/images/base.sif")
    assert "\nBootstrap: oras\nFrom: host/base:1\n" in definition("oras://host/base:1")
    assert default_base() == f"docker://python:3.{sys.version_info[1]}-slim"


@pytest.mark.parametrize("base", ["python:3.12", "a folder", "/a b", "docker://a\nFrom: b", ""])
def test_other_bases_are_refused(base):
    with pytest.raises(UsageError, match="--base"):
        definition(base)


def test_the_checkout_is_found_or_asked_for(tmp_path):
    assert (source_folder() / "pyproject.toml").exists()
    with pytest.raises(UsageError, match="--source"):
        source_folder(tmp_path)


def test_one_wheel_of_the_project(tmp_path):
    with pytest.raises(UsageError, match="found none"):
        own_wheel(tmp_path)
    for version in ("1", "2"):
        (tmp_path / f"drivetwin-{version}-py3-none-any.whl").touch()
    with pytest.raises(UsageError, match=r"drivetwin-1-.*drivetwin-2-"):
        own_wheel(tmp_path)


@pytest.fixture
def wheels(tmp_path):
    """A folder that looks like wheels."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    (folder / "drivetwin-1-py3-none-any.whl").touch()
    return folder


def test_an_existing_image_is_kept(tmp_path, wheels):
    out = tmp_path / "image.sif"
    out.write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        build(source_folder(), out, default_base(), wheels)
    assert out.read_text() == "mine"


def test_without_apptainer_one_line_and_nothing_left(tmp_path, wheels, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InfrastructureError, match="no command apptainer on this machine"):
        build(source_folder(), tmp_path / "image.sif", default_base(), wheels)
    assert [path.name for path in tmp_path.iterdir()] == ["wheels"]


@pytest.mark.parametrize("out", ["image.sif", "image"])
def test_what_apptainer_is_given(tmp_path, wheels, monkeypatch, out):
    """A command that writes down where it was called and with what, and makes the image."""
    tool = tmp_path / "bin" / "apptainer"
    tool.parent.mkdir()
    tool.write_text(
        '#!/bin/sh\necho "$@" >words\nls -LR >files\nfor w; do case $w in */image*) n=$w;; esac; '
        f'done\ncp words files "{tmp_path}"\ntouch "$n"\n'
    )
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tool.parent}{os.pathsep}{os.environ['PATH']}")
    build(source_folder(), tmp_path / out, "/images/base.sif", wheels)
    words = (tmp_path / "words").read_text().split()
    assert words[0] == "build"
    assert ("--sandbox" in words) == (out == "image")
    assert words[-1] == "drivetwin.def"
    files = (tmp_path / "files").read_text().split()
    assert {"drivetwin.def", "constraints.txt", "drivetwin-1-py3-none-any.whl"} <= set(files)
    assert (tmp_path / out).exists()
    assert not list(tmp_path.glob(".image*"))


def test_the_definition_is_printed_without_apptainer(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "hpc", "image", "build", "--print", "--base", "docker://a/b:1"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == definition("docker://a/b:1")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_bundle_is_kept(tmp_path):
    (tmp_path / "bundle").mkdir()
    with pytest.raises(UsageError, match="exists already"):
        write_bundle(source_folder(), tmp_path / "bundle", [])
    assert list((tmp_path / "bundle").iterdir()) == []


@pytest.mark.parametrize(
    ("devices", "campaigns", "message"),
    [
        ([], ["aeb-demo"], "--no-kernels leaves them out"),
        (["cpu"], ["aeb-demon"], "--campaign aeb-demon: not a valid campaign"),
    ],
)
def test_campaigns_of_a_bundle_are_looked_at_before_anything_is_fetched(
    tmp_path, devices, campaigns, message
):
    with pytest.raises(UsageError, match=message):
        write_bundle(source_folder(), tmp_path / "bundle", devices, campaigns)
    assert not list(tmp_path.iterdir())


def run_install(folder, *arguments, **variables):
    """``install.sh`` of a bundle for this Python, without anything to install."""
    script = folder / "install.sh"
    script.write_text(install_script(f"3.{sys.version_info[1]}"))
    script.chmod(0o755)
    return subprocess.run(
        [str(script), *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHON": sys.executable, **variables},
        check=False,
    )


def test_install_keeps_an_existing_folder(tmp_path):
    (tmp_path / "venv").mkdir()
    done = run_install(tmp_path, "venv")
    assert done.returncode == 2
    assert "venv exists already" in done.stderr
    assert list((tmp_path / "venv").iterdir()) == []


def test_install_refuses_another_python(tmp_path):
    other = tmp_path / "python"
    other.write_text("#!/bin/sh\necho 3.9\n")
    other.chmod(0o755)
    done = run_install(tmp_path, "venv", PYTHON=str(other))
    assert done.returncode == 2
    assert "is not Python 3." in done.stderr
    assert not (tmp_path / "venv").exists()


def test_what_an_oci_image_is_built_from(tmp_path):
    wheels, out = tmp_path / "wheels", tmp_path / "deep" / "context"
    wheels.mkdir()
    (wheels / "drivetwin-1-py3-none-any.whl").write_bytes(b"wheel")
    source = source_folder(None)
    write_context(source, out, default_base(), wheels)
    found = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert found == {"Containerfile", "constraints.txt", "wheels/drivetwin-1-py3-none-any.whl"}
    text = (out / "Containerfile").read_text()
    assert f"\nFROM python:3.{sys.version_info[1]}-slim\n" in text
    assert text.endswith("\nUSER 10001:10001\n"), "a cluster may refuse images of root"
    assert "--no-index" in text
    with pytest.raises(UsageError, match="exists already"):
        write_context(source, out, default_base(), wheels)
    with pytest.raises(UsageError, match="one wheel drivetwin"):
        write_context(source, tmp_path / "other", default_base(), tmp_path)
    assert not list(tmp_path.rglob(".*")), "nothing is left half done"


def test_extras_of_an_image():
    source = source_folder(None)
    extras = checked_extras(source, ["store", "kubernetes", "store"])
    assert extras == ("kubernetes", "store")
    assert " 'drivetwin[kubernetes,store]' \\\n" in containerfile("python:3.11", extras)
    assert " drivetwin \\\n" in containerfile("python:3.11")
    for name in ("nothing", "store]; rm", ""):
        with pytest.raises(UsageError, match=r"--extra .*the project has .*store") as caught:
            checked_extras(source, [name])
        assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("base", ["", "/images/base.sif", "a b", "x\nRUN rm", "--privileged"])
def test_a_base_that_no_registry_has(base):
    with pytest.raises(UsageError, match="give the name of an image") as caught:
        containerfile(base)
    assert len(str(caught.value).splitlines()) == 1
