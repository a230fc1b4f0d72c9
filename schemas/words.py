"""Nouns and verbs that go with a number."""

from __future__ import annotations

from collections.abc import Sequence


def counted(number: int, one: str, many: str = "") -> str:
    """``1 case``, ``2 cases``; ``many`` is ``one`` with an s if left out."""
    return f"{number} {one if number == 1 else many or f'{one}s'}"


def agree(number: int, one: str, many: str) -> str:
    """The word that goes with a number: ``has`` or ``have``."""
    return one if number == 1 else many


def unended(left: int, cases: int) -> str:
    """``1 of 16 cases has not ended``."""
    return f"{left} of {counted(cases, 'case')} {agree(left, 'has', 'have')} not ended"


def none_of(words: Sequence[str]) -> str:
    """``no a``, ``neither a nor b``, ``none of a, b, c``."""
    if len(words) == 1:
        return f"no {words[0]}"
    if len(words) == 2:
        return f"neither {words[0]} nor {words[1]}"
    return f"none of {', '.join(words)}"
