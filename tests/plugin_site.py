"""``tests/plugin_example``, a distribution of somebody else, installed by pip for a test."""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

from foreign_distributions import install

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "tests" / "plugin_example"


def install_example(folder: Path) -> tuple[Path, dict[str, str]]:
    """Install the example below ``folder``.

    Returns:
        where it lies, and the environment in which it is found.
    """
    site = folder / "site"
    shutil.copytree(_installed(), site)
    path = os.pathsep.join([str(site), str(ROOT)])
    return site, {**os.environ, "PYTHONPATH": path, "DRIVETWIN_HOME": str(folder / "home")}


@cache
def _installed() -> Path:
    """The example as pip installs it, once for this process: pip takes a second."""
    folder = Path(tempfile.mkdtemp(prefix="plugin-example-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    site = folder / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--no-deps", "--no-index", "--target", str(site), str(_wheel(folder))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return site


def beside(folder: Path, version: str) -> dict[str, str]:
    """The environment in which the example's sources are found as if its ``version`` were
    installed, whose metadata go below ``folder``."""
    install(folder, "plugin-example", version, example_points())
    path = os.pathsep.join([str(folder), str(EXAMPLE), str(ROOT), str(ROOT / "tests")])
    return {**os.environ, "PYTHONPATH": path, "DRIVETWIN_HOME": str(folder / "home")}


def example_points() -> str:
    """The example's ``entry_points.txt``."""
    points = [
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in found.items())
        for group, found in _project()["entry-points"].items()
    ]
    return "\n".join(points)


def _project() -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    return found


def _wheel(folder: Path) -> Path:
    """The wheel that a build of the example gives; where tests run there is no build backend."""
    project = _project()
    name, version = project["name"].replace("-", "_"), project["version"]
    files = {
        "METADATA": f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n",
        "WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "entry_points.txt": example_points(),
    }
    path = folder / f"{name}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        packed = {f"{name}/{source.name}": source for source in (EXAMPLE / name).glob("*.py")}
        for inside, source in packed.items():
            wheel.write(source, inside)
        for inside, text in files.items():
            wheel.writestr(f"{name}-{version}.dist-info/{inside}", text)
        names = [*packed, *(f"{name}-{version}.dist-info/{inside}" for inside in files)]
        record = "".join(f"{inside},,\n" for inside in names)
        wheel.writestr(f"{name}-{version}.dist-info/RECORD", record)
    return path
