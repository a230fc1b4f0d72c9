"""Licences of everything that an installation brings, against the list of those that are allowed.

``python -m release.licences`` checks, as part of ``make check``; exit code 1 names what is not
allowed, or not declared, and says when the page is old. ``--write`` writes ``docs/licences.md``.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import re
import sys
import tomllib
from pathlib import Path

from release.environment import closure

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "licences.md"
EXTRAS = (
    *("export", "gltf", "scenarios", "ros2", "autodrive", "search", "timestamp", "store"),
    *("kubernetes", "notebook", "gym"),
)
"""Extras of users whose packages tests install. `train` and `gpu` are not looked at."""
ALLOWED = frozenset(
    {
        *("0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "EPL-2.0"),
        *("HPND", "ISC", "MIT", "MIT-0", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Python-2.0"),
        *("Unlicense", "Zlib", "any-OSI"),
    }
)
"""SPDX identifiers; `BSD`: the metadata do not say which; `any-OSI`: the user chooses. All let
anybody use and pass on what is installed; none asks for the sources of a program that uses it."""
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "The Unlicense (Unlicense)": "Unlicense",
}
"""End of a classifier -> identifier."""
KNOWN = {
    "asttokens": "Apache-2.0",
    "eclipse-zenoh": "EPL-2.0 OR Apache-2.0",
    "protobuf": "BSD-3-Clause",
}
"""Packages whose metadata do not name the licence that stands in their files, or not by its
identifier."""
HEAD = """\
# Licences of what is installed

The project is under the [Apache License 2.0](../LICENSE). What `pip install drivetwin` brings, and
what its extras bring, is under the licences below, as the packages declare them. `make check`
refuses a package with another licence than these; `make licences` writes this page. The exact
versions of a release are in its CycloneDX file ([versions.md](versions.md#making-a-release)).

Allowed: {allowed}.

Wheels bundle libraries of their own: FFmpeg (LGPL-2.1) in `av` and `opencv-python-headless`, and
others that their wheels list. The extras `train` and `gpu`, and those for work on the project
itself, bring more and are not listed.

| package | licence | needed by |
|---|---|---|
"""


def licence(name: str) -> str:
    """What a distribution declares, as an SPDX expression if it can be; empty: nothing."""
    if name in KNOWN:
        return KNOWN[name]
    metadata = importlib.metadata.metadata(name)
    if "License-Expression" in metadata:
        return metadata["License-Expression"]
    ends = [line.rpartition(" :: ")[2] for line in metadata.get_all("Classifier") or []]
    found = [CLASSIFIERS[end] for end in ends if end in CLASSIFIERS]
    if found:
        return " OR ".join(found)
    return metadata["License"].strip().partition("\n")[0] if "License" in metadata else ""


def is_allowed(expression: str) -> bool:
    """Whether every part that counts of an SPDX expression is allowed: all of ``AND``, one of
    ``OR``."""
    words = re.findall(r"[()]|[^\s()]+", expression)
    allowed = _choice(words)
    return allowed and not words


def _choice(words: list[str]) -> bool:
    """Whether an expression at the beginning of ``words``, which are taken, is allowed."""
    allowed = _combination(words)
    while words[:1] == ["OR"]:
        del words[0]
        allowed |= _combination(words)
    return allowed


def _combination(words: list[str]) -> bool:
    """The same of parts that all count."""
    allowed = _part(words)
    while words[:1] == ["AND"]:
        del words[0]
        allowed &= _part(words)
    return allowed


def _part(words: list[str]) -> bool:
    """The same of an identifier, or of an expression in parentheses."""
    word = words.pop(0) if words else ""
    if word != "(":
        return word in ALLOWED
    allowed = _choice(words)
    return (words.pop(0) if words else "") == ")" and allowed


def needed_by(root: Path = ROOT) -> dict[str, list[str]]:
    """Every package of an installation -> extras that bring it; `drivetwin`: it is always
    there."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    found: dict[str, list[str]] = {}
    for name in closure(project["dependencies"]):
        found[name] = ["drivetwin"]
    for extra in EXTRAS:
        for name in closure(project["optional-dependencies"][extra]):
            if found.get(name) != ["drivetwin"]:
                found.setdefault(name, []).append(extra)
    return dict(sorted(found.items()))


def page(packages: dict[str, list[str]]) -> str:
    """Text of the page."""
    rows = [
        f"| `{name}` | {licence(name)} | {', '.join(f'`{each}`' for each in needed)} |\n"
        for name, needed in packages.items()
    ]
    return HEAD.format(allowed=", ".join(sorted(ALLOWED))) + "".join(rows)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--write", action="store_true", help="write docs/licences.md")
    write: bool = parser.parse_args().write
    packages = needed_by()
    refused = [name for name in packages if not is_allowed(licence(name))]
    for name in refused:
        print(f"licences: {name}: '{licence(name)}' is not allowed", file=sys.stderr)
    text = page(packages)
    if write:
        PAGE.write_text(text)
    elif not PAGE.is_file() or set(text.splitlines()) - set(PAGE.read_text().splitlines()):
        # Rows that are not needed are no mistake: another Python needs other packages.
        print("licences: docs/licences.md is old; `make licences` writes it", file=sys.stderr)
        return 1
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
