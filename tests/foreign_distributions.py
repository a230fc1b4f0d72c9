"""Distributions of somebody else, as an installer would leave them."""

from __future__ import annotations

import os
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def install(site: Path, name: str, version: str, points: str) -> None:
    """The metadata of a distribution in ``site``; ``points`` is its ``entry_points.txt``."""
    info = site / f"{name}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(points)


def of_page(page: str, implementation: str, folder: Path) -> tuple[Path, dict[str, str]]:
    """Install the distribution ``mine`` that a page of docs shows, below ``folder``.

    Args:
        page: with a block of Python for ``mine/kinds.py``, one for ``mine/IMPLEMENTATION.py``, and
            one of TOML with the entry points.
        implementation: name of the second module.

    Returns:
        where it lies, and the environment in which it is found.
    """
    kinds, code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    found = re.search(r"```toml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    points = found[1].replace('project.entry-points."', "").replace('"]', "]").replace('"', "")
    site = folder / "site"
    (site / "mine").mkdir(parents=True)
    (site / "mine/__init__.py").touch()
    (site / "mine/kinds.py").write_text(kinds)
    (site / f"mine/{implementation}.py").write_text(code)
    install(site, "mine", "1.0", points)
    path = os.pathsep.join([str(site), str(ROOT)])
    return site, {**os.environ, "PYTHONPATH": path, "DRIVETWIN_HOME": str(folder / "home")}
