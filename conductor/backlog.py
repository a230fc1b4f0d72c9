"""The waiting cases of one campaign, in submission order, by rig key.

Two queues per rig key: cases that may share a rig, and cases that must run alone. Priorities and
longest-first will change the sort key, nothing else.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice


@dataclass(slots=True)
class Backlog:
    """Positions of waiting cases; every list is sorted and no list is empty."""

    shared: dict[str, list[int]] = field(default_factory=dict)
    alone: dict[str, list[int]] = field(default_factory=dict)

    def add(self, rig: str, order: int, alone: bool) -> None:
        """A case waits (again), at its own place in the order."""
        insort((self.alone if alone else self.shared).setdefault(rig, []), order)

    def remove(self, rig: str, order: int, alone: bool) -> None:
        """A waiting case waits no longer."""
        queues = self.alone if alone else self.shared
        queue = queues[rig]
        index = bisect_left(queue, order)
        if index == len(queue) or queue[index] != order:
            raise AssertionError(f"case {order} of rig {rig} is not waiting")
        del queue[index]
        if not queue:
            del queues[rig]

    def first(self, rig: str | None, with_alone: bool) -> tuple[int, bool] | None:
        """The first waiting case and whether it must run alone; ``rig`` None: any rig key."""
        found: tuple[int, bool] | None = None
        for queues, alone in ((self.shared, False), (self.alone, True)):
            if alone and not with_alone:
                continue
            heads = queues.values() if rig is None else [queues.get(rig, [])]
            for queue in heads:
                if queue and (found is None or queue[0] < found[0]):
                    found = (queue[0], alone)
        return found

    def take(self, rig: str, count: int) -> Iterator[int]:
        """Up to ``count`` cases of ``rig`` that may share it, in order; nothing is removed."""
        return islice(self.shared.get(rig, ()), max(count, 0))

    def __len__(self) -> int:
        return sum(len(q) for queues in (self.shared, self.alone) for q in queues.values())
