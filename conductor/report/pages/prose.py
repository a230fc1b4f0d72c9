"""What people write into a result page: kept between marks when the page is made again."""

from __future__ import annotations

import re
from pathlib import Path

from twin.base.errors import UsageError

SUMMARY = "summary"
"""Name of the text at the top."""

_HINT = "write between these two lines; it stays when the page is made again"
_BEGIN = re.compile(r"^<!-- text ([^:>\n]+):[^>\n]*-->[ \t]*$", re.MULTILINE)


def end_mark(name: str) -> str:
    """The line after a text."""
    return f"<!-- end of text {name} -->"


def block(name: str, text: str) -> str:
    """The lines of the page that hold the text ``name``."""
    inner = f"\n{text}\n" if text else ""
    return f"<!-- text {name}: {_HINT} -->\n{inner}\n{end_mark(name)}"


def model_block(model: str) -> str:
    """Name of the text about a model."""
    return f"model {model}"


def read_texts(page: Path) -> dict[str, str]:
    """The texts of an existing page by name; empty if there is no page.

    Raises:
        UsageError: the file is no such page, or a mark is damaged; one line.
    """
    try:
        content = page.read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{page}: cannot be read as text: {error}") from None
    texts: dict[str, str] = {}
    for begin in _BEGIN.finditer(content):
        name = begin[1]
        end = content.find(end_mark(name), begin.end())
        following = _BEGIN.search(content, begin.end())
        if end < 0 or (following is not None and following.start() < end) or name in texts:
            line = content.count("\n", 0, begin.start()) + 1
            raise UsageError(
                f"{page}: line {line}: the text '{name}' has no line '{end_mark(name)}' of its own "
                "after it; restore it, so that nothing written is lost"
            )
        texts[name] = content[begin.end() : end].strip()
    if not texts and content.strip():
        raise UsageError(
            f"{page}: exists and was not made by this command; give another name, or remove it"
        )
    return texts


def check_known(page: Path, texts: dict[str, str], names: list[str]) -> None:
    """Raise UsageError if a text would be lost because the page has no place for it."""
    for name, text in texts.items():
        if text and name not in names:
            raise UsageError(
                f"{page}: holds the text '{name}', and this campaign has no place for it; it has "
                f"{', '.join(names)}; move the text or give another name"
            )
