"""Which sensor messages somebody looks at: the stack, a recording, a viewer."""

from __future__ import annotations

from collections.abc import Iterable

SENSORS_VARIABLE = "TWIN_SENSORS"
"""Environment variable: ``all``: every sensor is read, whether or not somebody looks at it; for
comparisons."""

Wanted = frozenset[str] | None
"""Sensor messages by name; None: all."""

NOTHING: Wanted = frozenset()


def together(wishes: Iterable[Wanted]) -> Wanted:
    """Messages that at least one of several looks at."""
    names: set[str] = set()
    for wanted in wishes:
        if wanted is None:
            return None
        names |= wanted
    return frozenset(names)
