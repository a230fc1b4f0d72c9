"""Names of files in mesh files and material libraries, as programs of all systems write them.

Whoever asks which files a mesh consists of and whoever reads them take the same names, so a picture
that is shown is part of a case's identity.
"""

from __future__ import annotations

import re

CHARS_MAX = 4096
"""Longest name of a file with its options [characters]; longer ones name nothing."""

_OPTIONS = {
    **dict.fromkeys(("-blendu", "-blendv", "-boost", "-cc", "-clamp", "-imfchan"), 1),
    **dict.fromkeys(("-texres", "-type", "-bm"), 1),
    "-mm": 2,
}
"""Options before the name of a picture, and how many words follow them."""
_NUMBERS = ("-o", "-s", "-t")
"""Options that one to three numbers follow."""
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_WORD = re.compile(r"\s*(\S+)")


def as_text(data: bytes) -> str:
    """Text of a file whose encoding nobody says: UTF-8, or Latin-1, which any bytes are."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def file_names(text: str) -> list[str]:
    """Paths that ``text`` may mean, relative to where it stands, the most literal first.

    A material library may write options before a name, the separators of another system, or a path
    of the machine that wrote it; then a file of that name lies beside it.
    """
    if len(text) > CHARS_MAX:
        return []
    found = []
    for name in (text.strip(), _without_options(text)):
        for written in (name, name.replace("\\", "/")):
            found += [written.lstrip("/"), written.rpartition("/")[2]]
    words = text.split()
    return [name for name in dict.fromkeys([*found, *words[-1:]]) if name and "\0" not in name]


def _without_options(text: str) -> str:
    rest = text.strip()
    while (word := _next(rest)).startswith("-"):
        if word in _NUMBERS:
            rest = _after(rest)
            for _ in range(3):
                if _NUMBER.fullmatch(_next(rest)):
                    rest = _after(rest)
        elif word in _OPTIONS:
            for _ in range(1 + _OPTIONS[word]):
                rest = _after(rest)
        else:
            break
    return rest


def _next(text: str) -> str:
    found = _WORD.match(text)
    return found[1] if found else ""


def _after(text: str) -> str:
    found = _WORD.match(text)
    return text[found.end() :].lstrip() if found else ""
