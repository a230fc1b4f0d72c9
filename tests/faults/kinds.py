"""What a fault is, and the table of all of them.

A fault is one generator function: it injects, yields a few words about what it did, and heals when
it is resumed. If there is nobody to hurt just now it returns without a yield.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from fabric import Fabric

Body = Callable[[Fabric, random.Random], Iterator[str]]


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of the table."""

    name: str
    body: Body
    hold_s: tuple[float, float]
    """It lasts so long, drawn evenly [s]."""
    extras: frozenset[str]
    """What the fabric needs for it."""
    group: str
    """Only one of a group at a time; empty: any number."""
    stormy: bool
    """Part of storms: it needs no extras beyond those of a storm."""


FAULTS: dict[str, Fault] = {}
"""Filled by :func:`fault`, in the order of the table."""


def fault(
    name: str,
    hold_s: tuple[float, float],
    *,
    extras: tuple[str, ...] = (),
    group: str = "",
    stormy: bool = False,
) -> Callable[[Body], Body]:
    """Enter a function into the table."""

    def enter(body: Body) -> Body:
        FAULTS[name] = Fault(name, body, hold_s, frozenset(extras), group, stormy)
        return body

    return enter
