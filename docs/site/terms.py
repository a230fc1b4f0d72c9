"""The glossary as definitions with an index, and links to it from the tutorials.

``docs/glossary.md`` is tables, which every viewer of Markdown shows. On the site each row is a
definition, and the first use of a term on a tutorial page is a link to it.
"""

from __future__ import annotations

import re
from pathlib import Path

ROW = re.compile(r"^\| (?!term \|)([^|]+) \| (.+) \|$", re.MULTILINE)
TABLE = re.compile(r"^\| term \| meaning \|\n\|---\|---\|\n((?:\|.*\n)+)", re.MULTILINE)
EVERYDAY = frozenset(
    {
        *("actor", "attempt", "axis", "front", "inline", "judge", "kind", "preload", "reason"),
        *("role", "row", "run", "session", "share", "site", "target", "trial", "variation"),
        *("view",),
    }
)
"""Terms that are everyday words, too: a page links them by hand where it means the term."""
KEPT = re.compile(
    r"^(?:```|~~~|:::).*?^(?:```|~~~|:::)[^\n]*\n|<!--.*?-->|^#[^\n]*\n|^\|[^\n]*\n"
    r"|`[^`\n]+`|!?\[[^\]]*\]\([^)]*\)",
    re.DOTALL | re.MULTILINE,
)
"""Parts of a page that stay as they are: code, comments, headings, tables, links."""


def terms(glossary: str) -> list[str]:
    """All terms of the glossary's text, in its order."""
    return [term.strip() for term, _ in ROW.findall(glossary)]


def definitions(glossary: str) -> str:
    """The glossary with a definition list in place of each table."""

    def listed(table: re.Match[str]) -> str:
        rows = (
            f"{term.strip()}\n  : {meaning.strip()}\n" for term, meaning in ROW.findall(table[1])
        )
        return ":::{glossary}\n" + "\n".join(rows) + ":::\n"

    return TABLE.sub(listed, glossary)


def with_links(page: str, names: list[str]) -> str:
    """The text of ``page`` with the first use of each of the terms ``names`` as a link."""
    left = sorted((name for name in names if name not in EVERYDAY), key=len, reverse=True)
    done: list[str] = []
    place = 0
    for kept in [*KEPT.finditer(page), None]:
        prose = page[place : kept.start()] if kept else page[place:]
        done.append(_linked(prose, left))
        if kept:
            done.append(kept[0])
            place = kept.end()
    return "".join(done)


def _linked(prose: str, left: list[str]) -> str:
    """``prose`` with links; terms that were linked are taken from ``left``."""
    for name in list(left):
        same = "" if name.isupper() else "(?i:"
        word = re.compile(
            rf"(?<![\w{{<`-]){same}{re.escape(name)}s?{')' if same else ''}(?![\w>}}-])"
        )
        found = word.search(_blank_links(prose))
        if found:
            use = f"{{term}}`{prose[found.start() : found.end()]} <{name}>`"
            prose = prose[: found.start()] + use + prose[found.end() :]
            left.remove(name)
    return prose


def _blank_links(prose: str) -> str:
    """``prose`` with what was linked blanked out, at its length."""
    return re.sub(r"\{term\}`[^`]*`", lambda link: " " * len(link[0]), prose)


def write(docs: Path) -> None:
    """Change the laid-out pages below ``docs``."""
    glossary = docs / "glossary.md"
    text = glossary.read_text()
    names = terms(text)
    glossary.write_text(definitions(text))
    for page in [docs / "start.md", *sorted((docs / "tutorials").glob("*.md"))]:
        page.write_text(with_links(page.read_text(), names))
