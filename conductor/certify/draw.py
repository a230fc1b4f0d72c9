"""Which cases an audit runs again, and what it says about all others.

The draw can be made again by anybody with ``sha256sum``: of every case that has a result, SHA-256
of four lines (the words ``drivetwin audit 1``, the root of the certificate, the seed, the name of
the case) is taken; the cases with the smallest digests are drawn. So a draw of 500 cases has those
of 300 in it, and another table gives another draw.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from math import comb

from twin.base.errors import UsageError

CONFIDENCE_PERCENT = 95
SEED_CHARS_MAX = 200
"""Longest seed [characters]."""

_HEAD = "drivetwin audit 1"


def checked_seed(seed: str) -> str:
    """A seed as the draw takes it.

    Raises:
        UsageError: empty, too long, or more than one line of printable ASCII.
    """
    if not re.fullmatch(rf"[ -~]{{1,{SEED_CHARS_MAX}}}", seed) or seed != seed.strip():
        raise UsageError(
            f"--seed '{seed[:40]}': allowed are 1 to {SEED_CHARS_MAX} printable ASCII characters, "
            "no space at either end"
        )
    return seed


def draw(root: str, seed: str, names: Iterable[str], count: int) -> list[str]:
    """Draw ``count`` cases without replacement; all, if there are fewer.

    Args:
        root: of the certificate, hexadecimal.
        seed: public text, best one that nobody knew when the certificate was made.
        names: cases to draw from.
        count: how many.

    Returns:
        Names, in the order in which they are drawn.
    """
    head = hashlib.sha256(f"{_HEAD}\n{root}\n{seed}\n".encode())

    def place(name: str) -> bytes:
        sha = head.copy()
        sha.update(f"{name}\n".encode())
        return sha.digest()

    return sorted(names, key=place)[:count]


def false_at_most(rows: int, drawn: int) -> int:
    """Most false rows with which no drawn one would be false in more than 5 % of all draws.

    With ``K`` false rows of ``N``, none of ``m`` drawn is false with the probability
    ``C(N - K, m) / C(N, m)`` (hypergeometric, without replacement). The largest ``K`` for which
    this is above 5 % is found exactly, in integers; with 95 % confidence there are no more.
    """
    assert 0 <= drawn <= rows
    every, hundred = comb(rows, drawn), 100
    low, high = 0, rows - drawn  # with more false rows than were left out, one is drawn
    while low < high:
        middle = (low + high + 1) // 2
        if comb(rows - middle, drawn) * hundred > every * (hundred - CONFIDENCE_PERCENT):
            low = middle
        else:
            high = middle - 1
    return low


def bound(rows: int, drawn: int) -> str:
    """What follows for the whole table when no drawn case differs, as a sentence's part."""
    most = false_at_most(rows, drawn)
    if drawn == rows:
        return f"no row of {rows} is false: all were run again"
    hundredths = -(-(most + 1) * 10_000 // rows)  # rounded up: never less than is true
    return (
        f"with {CONFIDENCE_PERCENT} % confidence fewer than {most + 1} of {rows} rows are false "
        f"(less than {hundredths / 100:.2f} %)"
    )
