"""The distribution ``drivetwin-worker``: what a node needs that runs workers and stacks.

It is made of the same files as ``drivetwin``, without the packages that serve, show and report, and
without the libraries that only those use. Both distributions own the same files, so only one of
them can be installed.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

NAME = "drivetwin-worker"
PACKAGES = ("schemas", "twin", "devkit", "hpc")
COMMANDS = ("twin", "devkit", "hpc")
WITHOUT = ("rerun-sdk", "pyarrow", "plotly", "jinja2", "prometheus-client", "matplotlib")
"""Libraries of the conductor, of viewers and of those who read results: workers write them."""
OPTIONAL = {"networks": ("opencv-python-headless",)}
"""Extra -> libraries that ``drivetwin`` has always and workers need for some cases only."""
EXTRAS = ("gltf", "scenarios", "ros2", "autodrive", "kubernetes", "gpu")
"""Extras that make sense on such a node."""


def project(root: Path) -> dict[str, Any]:
    """The table ``project`` of ``drivetwin``."""
    table: dict[str, Any] = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return table


def pyproject(root: Path) -> str:
    """``pyproject.toml`` of the distribution, derived from that of ``drivetwin``."""
    ours = project(root)
    system = tomllib.loads((root / "pyproject.toml").read_text())["build-system"]
    known = {_name(line): line for line in ours["dependencies"]}
    less = {*WITHOUT, *(name for names in OPTIONAL.values() for name in names)}
    assert less <= known.keys(), "a library has another name now"
    needs = [line for name, line in known.items() if name not in less]
    scripts = {name: ours["scripts"][name] for name in COMMANDS}
    extras = {extra: [known[name] for name in names] for extra, names in OPTIONAL.items()}
    extras |= {name: ours["optional-dependencies"][name] for name in EXTRAS}
    return "\n".join(
        [
            "[build-system]",
            *_lines(system),
            "",
            "[project]",
            f'name = "{NAME}"',
            'description = "Workers and stacks of drivetwin, for nodes that run cases."',
            *_lines({k: ours[k] for k in ("version", "readme", "requires-python", "license")}),
            *_lines({"license-files": ours["license-files"], "dependencies": needs}),
            "",
            "[project.scripts]",
            *_lines(scripts),
            "",
            "[project.optional-dependencies]",
            *_lines(extras),
            "",
            "[tool.hatch.build.targets.wheel]",
            *_lines({"packages": list(PACKAGES)}),
            "",
        ]
    )


def write_tree(root: Path, folder: Path) -> None:
    """Write the distribution's source tree into ``folder``, which must not exist."""
    ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
    for name in PACKAGES:
        shutil.copytree(root / name, folder / name, ignore=ignored)
    for name in ("README.md", "LICENSE"):
        shutil.copy(root / name, folder)
    (folder / "pyproject.toml").write_text(pyproject(root))


def _name(requirement: str) -> str:
    return re.split(r"[^A-Za-z0-9._-]", requirement)[0].lower()


def _lines(table: dict[str, Any]) -> list[str]:
    """Keys of TOML whose values are texts and lists of texts, which JSON writes alike."""
    import json

    return [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.items()]
