"""Prose of the documentation and of docstrings, by ``proselint`` with our vocabulary.

``python tests/house/prose.py`` prints what is beside the rules; exit code 1 if anything is. Part of
``make check``. The vocabulary is ``vocabulary.yaml``; of proselint's own checks those run that fit
technical prose. The first sentence of a docstring stands alone: it does not begin with a word that
points at something before it.
"""

from __future__ import annotations

import ast
import re
import sys
from bisect import bisect
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import yaml
from proselint import checks as shipped_checks
from proselint.registry.checks import Check, types

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")
VOCABULARY = Path(__file__).with_name("vocabulary.yaml")
DATED = ("docs/decisions/0", "docs/results/", "CHANGELOG.md")
"""Beginnings of pages that stay as they were written; only the table of sentences counts."""

LEFT_OUT = (
    *("typography", "lexical_illusions", "dates_times", "misc.but", "terms", "restricted"),
    *(
        "weasel_words.very",
        "needless_variants",
        "misc.scare_quotes",
        "spelling.consistency",
        "archaism",
    ),
    *("misc.phrasal_adjectives", "redundancy.misc.after_the_deadline", "cliches.misc.garner"),
)
"""Checks of proselint that do not fit: they want typographic signs, or take terms of ours for
something else ("free memory", "resumes")."""

POINTS_BACK = re.compile(
    r"(?:Of|How|It|Its|They|Their|Them|These|Those|That|This|Such|So|Both|Another|Other|Further"
    r"|The same|Also|And|Each|There)\b|(?:Args|Raises|Returns|Yields):"
)
"""Beginnings of a docstring that say nothing without what stands before it."""
POINTS_BACK_MAX = {
    "schemas": 19,
    "twin": 60,
    "devkit": 9,
    "conductor": 15,
    "viewer": 6,
    "hpc": 9,
    "drivetwin": 0,
}
"""Docstrings that still begin so, by package. These numbers go down only."""

_CODE = re.compile(r"^( *)```.*?^\1```|<!--.*?-->", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"``[^`]*``|`[^`]*`")
_TARGET = re.compile(r"\]\([^)\n]*\)")


class Finding(NamedTuple):
    """Something beside the rules."""

    place: str
    message: str


def vocabulary(sections: Iterable[str] = ("sentences", "terms", "empty")) -> list[Check]:
    """Checks of our own, a section of the vocabulary each."""
    lists = yaml.safe_load(VOCABULARY.read_text())
    return [
        Check(
            check_type=types.PreferredForms({f"(?:{k})": v for k, v in lists[section].items()}),
            path=f"house.{section}",
            message="'{1}': {0}",
        )
        for section in sections
    ]


def shipped() -> list[Check]:
    """Checks of proselint that fit technical prose."""
    return [
        check
        for check in shipped_checks.__register__
        if not any(map(check.matches_partial, LEFT_OUT))
    ]


def plain(text: str) -> str:
    """Markdown without code, comments and targets of links, at its length and with its lines."""
    for pattern in (_CODE, _SPAN, _TARGET):
        text = pattern.sub(lambda found: re.sub(r"[^\n]", "_", found[0]), text)
    return text


def of_page(name: str, text: str, checks: Iterable[Check]) -> Iterator[Finding]:
    """What is beside the rules in the Markdown ``text`` of the page ``name``."""
    prose = plain(text)
    for check in checks:
        for result in check.check(prose):
            line = prose.count("\n", 0, result.span[0]) + 1
            yield Finding(f"{name}:{line}", f"{result.message} ({result.check_path})")


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every docstring of a module."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, kinds) and (text := ast.get_docstring(node)):
            yield node.body[0].lineno, text


def of_module(name: str, source: str, checks: Iterable[Check]) -> Iterator[Finding]:
    """What is beside the vocabulary in the docstrings of the module ``name``."""
    every = list(docstrings(source))
    prose = "\n\n".join(plain(text) for _, text in every)
    starts = list(accumulate((len(text) + 2 for _, text in every), initial=0))
    for check in checks:
        for result in check.check(prose):
            line, _ = every[bisect(starts, result.span[0]) - 1]
            yield Finding(f"{name}:{line}", f"{result.message} ({result.check_path})")


def pointing_back(source: str) -> list[int]:
    """Lines of docstrings whose first sentence does not stand alone."""
    return [line for line, text in docstrings(source) if POINTS_BACK.match(text)]


def pages() -> list[Path]:
    """All pages of the documentation."""
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def look() -> list[Finding]:
    """Read everything."""
    ours, sentences, theirs = vocabulary(), vocabulary(["sentences"]), shipped()
    findings: list[Finding] = []
    for page in pages():
        name = page.relative_to(ROOT).as_posix()
        checks = sentences if name.startswith(DATED) else [*ours, *theirs]
        findings += of_page(name, page.read_text(), checks)
    counts: Counter[str] = Counter()
    last: dict[str, str] = {}
    for path in sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py")):
        name, source = path.relative_to(ROOT).as_posix(), path.read_text()
        findings += of_module(name, source, ours)
        for line in pointing_back(source):
            counts[name.partition("/")[0]] += 1
            last[name.partition("/")[0]] = f"{name}:{line}"
    for package, most in POINTS_BACK_MAX.items():
        if counts[package] > most:
            message = f"{counts[package]} docstrings of {package} begin with a word that points "
            message += f"back, at most {most}: say what it is"
            findings.append(Finding(last[package], message))
    return findings


def main() -> int:
    """Print what was found."""
    findings = look()
    for finding in findings:
        print(f"{finding.place}: {finding.message}")
    if not findings:
        print(f"ok   prose of {len(pages())} pages and of docstrings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
