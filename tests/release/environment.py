"""An environment that holds a wheel of ours, what the wheel declares, and nothing else.

The files of its dependencies are linked from this environment, so that it takes seconds and no
network. What the wheel uses and does not declare is missing there, as after ``pip install``.

``python -m release.environment WHEEL FOLDER`` makes one and prints what it takes.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterable, Sequence
from email.parser import HeaderParser
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def requirements_of(wheel: Path) -> list[str]:
    """What a wheel declares that it needs, extras included."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        return HeaderParser().parsestr(archive.read(name).decode()).get_all("Requires-Dist") or []


def closure(requirements: Iterable[str], extras: Sequence[str] = ()) -> list[str]:
    """Names of the installed distributions that requirements lead to, sorted.

    Args:
        requirements: of a wheel.
        extras: of that wheel, whose requirements count too.

    Raises:
        SystemExit: one of them is not installed here.
    """
    reached: set[tuple[str, str]] = set()
    waiting = [(Requirement(line), tuple(extras)) for line in requirements]
    while waiting:
        requirement, wanted = waiting.pop()
        if requirement.marker is not None and not any(
            requirement.marker.evaluate({"extra": extra}) for extra in ("", *wanted)
        ):
            continue
        name = canonicalize_name(requirement.name)
        asked = {(name, extra) for extra in ("", *requirement.extras)} - reached
        if not asked:
            continue
        reached |= asked
        try:
            needs = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            raise SystemExit(f"{name} is not installed here; `make install-test` does it") from None
        waiting += [(Requirement(line), tuple(requirement.extras)) for line in needs]
    return sorted({name for name, _ in reached})


def make_environment(wheel: Path, folder: Path, extras: Sequence[str] = ()) -> Path:
    """Make the environment ``folder`` with ``wheel`` in it.

    Returns:
        its interpreter.

    Raises:
        CalledProcessError: pip refuses the wheel, e.g. because a version does not fit.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    site = folder / "lib" / version / "site-packages"
    for name in closure(requirements_of(wheel), extras):
        link_distribution(name, site)
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    named = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    quiet = ["install", "--quiet", "--no-index", "--no-compile", named]
    subprocess.run([*pip, *quiet], check=True)
    return python


def link_distribution(name: str, site: Path) -> None:
    """Link the files that a distribution has installed into the folder ``site``; commands of it
    stay away."""
    distribution = importlib.metadata.distribution(name)
    for file in distribution.files or ():
        if file.parts[0] == ".." or file.suffix == ".pyc":
            continue
        source, target = Path(str(distribution.locate_file(file))), site / file
        if target.exists() or not source.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, target)
        except OSError:  # another file system
            shutil.copy2(source, target)


def sizes(folder: Path) -> dict[str, int]:
    """Bytes of every file and folder at the top of an environment's site-packages, largest
    first; metadata count for what they belong to."""
    site = next((folder / "lib").glob("python*/site-packages"))
    found: dict[str, int] = {}
    for top in site.iterdir():
        name = re.sub(r"-[^-]+\.dist-info$", "", top.name)
        found[name] = found.get(name, 0) + _bytes(top)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _bytes(top: Path) -> int:
    files = [top] if top.is_file() else [p for p in top.rglob("*") if p.is_file()]
    return sum(path.stat().st_size for path in files)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("folder", type=Path, help="new folder")
    parser.add_argument("--extra", action="append", default=[], help="of the wheel, repeatable")
    arguments = parser.parse_args()
    python = make_environment(arguments.wheel, arguments.folder, arguments.extra)
    taken = sizes(arguments.folder)
    for name, size in list(taken.items())[:12]:
        print(f"{size / 1e6:8.1f} MB  {name}")
    print(f"{sum(taken.values()) / 1e6:8.1f} MB  in all, in {python.parents[1]}")


if __name__ == "__main__":
    main()
