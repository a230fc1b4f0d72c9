"""What strangers wrote, as it may stand in one of our lines."""

from __future__ import annotations

WORDS_MAX = 1000
"""Longest line made of them [characters]."""


def plain(text: str, longest: int = WORDS_MAX) -> str:
    """``text`` on one line: what would end it or move a terminal's cursor is written out
    (``\\x1b``), and what is too long is cut."""
    if len(text) > longest:
        text = f"{text[: longest - 3]}..."
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
