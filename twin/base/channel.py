"""A queue between two threads whose size has a limit; its writer waits only if it asks to."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class BoundedChannel(Generic[T]):
    """First in, first out, with a limit on the sum of sizes; what does not fit is refused or waits.

    A single item may be larger than the limit: it fits when the queue is empty.
    """

    def __init__(self, size_max: int) -> None:
        """``size_max``: limit on the sum of the waiting items' sizes, usually bytes."""
        self.refused = 0
        """Items that did not fit."""
        self._size_max = size_max
        self._size = self._writers = 0
        self._items: deque[tuple[T, int]] = deque()
        self._condition = threading.Condition()

    def offer(self, item: T, size: int = 1) -> bool:
        """Append ``item`` if it fits; never waits."""
        with self._condition:
            if self._items and self._size + size > self._size_max:
                self.refused += 1
                return False
            self._items.append((item, size))
            self._size += size
            self._condition.notify_all()
            return True

    def put(self, item: T, size: int = 1) -> None:
        """Append ``item`` as soon as it fits."""
        with self._condition:
            self._writers += 1
            self._condition.wait_for(lambda: not self._items or self._size + size <= self._size_max)
            self._writers -= 1
            self._items.append((item, size))
            self._size += size
            self._condition.notify_all()

    def take(self, timeout_s: float | None = None) -> T | None:
        """The oldest item; None after ``timeout_s`` (None: wait for ever)."""
        with self._condition:
            if not self._condition.wait_for(lambda: self._items, timeout_s):
                return None
            item, size = self._items.popleft()
            self._size -= size
            if self._writers:
                self._condition.notify_all()
            return item

    def __len__(self) -> int:
        with self._condition:
            return len(self._items)
