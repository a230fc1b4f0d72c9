"""Code blocks of the documentation, with what a comment before them says about how they are tested.

A comment stands on the line before the block:

``<!-- not run: REASON -->``: of a page whose commands are run, this block is only checked;
``<!-- not checked: REASON -->``: nothing is checked but that the reason is there;
``<!-- ends with CODE: REASON -->``: its last command ends with another exit code than 0.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = [ROOT / "docs" / "start.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
"""Pages whose blocks are run, from top to bottom."""
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>[^\n]*?) -->\n)?"
    r"^(?P<indent> *)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```",
    re.DOTALL | re.MULTILINE,
)
_MARK = re.compile(r"(not run|not checked|ends with (\d+)): (\S.{10,})")
_NAMED = re.compile(r"`([\w.-]+\.\w+)`[^`\n]*:\n\n(?:<!--[^\n]*-->\n)?\Z")


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block."""

    page: Path
    line: int
    language: str
    text: str
    """Without the fence's indentation."""
    run: bool
    checked: bool
    ends_with: int
    """Exit code of its last command."""
    file: str
    """Name of the file that the sentence before it says it is, such as "Put this into `a.yaml`:";
    empty: none."""

    @property
    def name(self) -> str:
        """Short name for tests."""
        return f"{self.page.stem}-{self.line}"


def blocks(page: Path) -> list[Block]:
    """All blocks of ``page`` with a language.

    Raises:
        ValueError: a comment before a block says something that is not known, or gives no reason.
    """
    text, found = page.read_text(), []
    for match in _BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("indent")) + 1
        mark = _MARK.fullmatch(match["mark"] or "")
        if mark is None and re.match("not |ends ", match["mark"] or ""):
            raise ValueError(f"{page}:{line}: '{match['mark']}': see tests/page_blocks.py")
        if not match["language"]:
            continue
        named = _NAMED.search(text[: match.start()])
        found.append(
            Block(
                page=page,
                line=line,
                language=match["language"],
                text=textwrap.dedent(match["text"]),
                run=mark is None or mark[2] is not None,
                checked=mark is None or mark[1] != "not checked",
                ends_with=int(mark[2]) if mark and mark[2] else 0,
                file=named[1] if named else "",
            )
        )
    return found


def every_block(*languages: str) -> list[Block]:
    """The checked blocks of all pages in one of ``languages``."""
    every = (block for page in PAGES for block in blocks(page))
    return [block for block in every if block.language in languages and block.checked]
