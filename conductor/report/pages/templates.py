"""How templates of reports are set up: where they lie, and how they write values."""

from __future__ import annotations

from pathlib import Path

import jinja2

ASSETS = Path(__file__).parents[1] / "assets"


def environment(*, autoescape: bool) -> jinja2.Environment:
    """Jinja for the templates of reports; ``autoescape`` for HTML."""
    jinja = jinja2.Environment(
        loader=jinja2.FileSystemLoader(ASSETS),
        autoescape=autoescape,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {"number": number, "words": words, "short": short}
    return jinja


def number(value: float | int | None, digits: int = 2) -> str:
    """A number for people; a dash where it is missing."""
    return "–" if value is None else f"{value:.{digits}f}"


def words(value: object) -> str:
    """A name for people."""
    return str(value).replace("_", " ")


def short(text: object, most: int) -> str:
    """Text of at most ``most`` characters, with what was left out told; on one line."""
    whole = str(text)
    line = " ".join(whole[: 4 * most].split())
    if len(line) <= most and len(whole) <= 4 * most:
        return line
    return f"{line[:most]}… ({len(whole)} characters)"
