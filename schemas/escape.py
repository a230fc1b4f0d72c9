"""Untrusted text, escaped on one line."""

from __future__ import annotations

ESCAPED_CHARS_MAX = 1000
"""Longest line of it [characters]."""


def escape(text: str, longest: int = ESCAPED_CHARS_MAX) -> str:
    r"""``text`` escaped on one line: what would end it or move a terminal's cursor becomes
    ``\x1b``, and what is too long is cut."""
    if len(text) > longest:
        text = f"{text[: longest - 3]}..."
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
