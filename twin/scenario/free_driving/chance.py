"""Random draws of free driving, keyed by what they are for: nothing depends on their order."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

Value = TypeVar("Value")
_BITS = 64


def part_seed(commit: str, part: int) -> int:
    """Seed of a part: the first 8 bytes of SHA-256 over the commit and the part's number, without
    the highest bit, as campaign files hold no more.

    Args:
        commit: that froze the stack, 40 hexadecimal digits.
        part: number of the part.
    """
    text = hashlib.sha256(f"free driving {commit} {part}".encode()).digest()
    return int.from_bytes(text[:8], "big") >> 1


class Draws:
    """A stream of draws for one purpose."""

    def __init__(self, seed: int, purpose: str) -> None:
        """``seed`` of a part; ``purpose`` such as ``motorway-03``."""
        key = hashlib.sha256(f"{seed} {purpose}".encode()).digest()
        # Raw words alone: what other methods make of them may differ between versions of NumPy.
        self._bits = np.random.Philox(key=int.from_bytes(key[:16], "big"))

    def share(self) -> float:
        """Uniform from 0 to below 1, of 53 bits."""
        return (int(self._bits.random_raw()) >> (_BITS - 53)) / 2.0**53

    def between(self, low: float, high: float, step: float = 0.1) -> float:
        """Uniform between two values, in whole steps of ``step`` from 0 on: files stay short."""
        value = low + (high - low) * self.share()
        return round(round(value / step) * step, 6)

    def one_of(self, values: Sequence[Value]) -> Value:
        """One of the values, each as likely."""
        return values[int(self.share() * len(values))]

    def happens(self, probability: float) -> bool:
        """Whether something of this probability happens."""
        return self.share() < probability
