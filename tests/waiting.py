"""Waiting for what others do: until it is so, or has not become so for minutes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
PATIENCE_S = 240.0
"""Longest wait for a fact, of every kind; generous, for machines that are shared and slow, and of
no cost where the fact comes true."""


def wait_for(look: Callable[[], T], what: str, patience_s: float = PATIENCE_S) -> T:
    """Poll until ``look`` returns something true."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        found = look()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError(f"waited {patience_s:.0f} s in vain for {what}")
