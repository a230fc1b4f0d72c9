"""The waiting cases of one campaign, in submission order, by rig key and group.

A lane is a rig key and a group: cases that may share a rig with any other, cases that run alone,
and each group of suspects. The first case of a lane stands at the end of its list, where taking it
is cheap; a heap of lane heads, cleaned when it is read, finds the first of all lanes.
"""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain, islice
from operator import neg

SPREAD_MAX = 4096
"""Most waiting cases of a lane that a mixture or a share is taken from."""

GOLDEN = (5.0**0.5 - 1.0) / 2.0
"""The golden ratio's part below 1: its multiples, modulo 1, are spread evenly however many."""

LOOK_MAX = 64
"""Most cases of a lane that are looked at for one that the asker may have."""

Usable = Callable[[int], bool]
"""Whether the asker may have the case at this position."""


@dataclass(slots=True)
class LaneMixture:
    """The first ``SPREAD_MAX`` cases of one lane, by the golden fractions of their positions.

    Neighbours in a matrix are alike and take equally long: workers that took blocks of them would
    not end together. By the smallest fractions slow axes of a matrix are met evenly. Some thousand
    cases are ordered once, and not for each request.

    It holds for a lane whose cases leave anywhere and are added behind all others. When a case
    comes back to its own place, another mixture has to be made.
    """

    _last: int = -1
    """Largest position that it has looked at."""
    _heap: list[tuple[float, int]] = field(default_factory=list)
    """(fraction, position) of those cases; some may have left the lane."""

    def __len__(self) -> int:
        """Number of cases that it has looked at and that may still be there."""
        return len(self._heap)

    def take(self, lane: list[int], count: int) -> list[int]:
        """Positions of at most ``count`` cases of ``lane``, ascending; they stay in it.

        ``lane``: negated positions, ascending.
        """
        self._look_further(lane)
        heap = self._heap
        chosen: list[tuple[float, int]] = []
        while heap and len(chosen) < count:
            entry = heapq.heappop(heap)
            place = bisect_left(lane, -entry[1])
            if place < len(lane) and lane[place] == -entry[1]:
                chosen.append(entry)
        for entry in chosen:
            heapq.heappush(heap, entry)
        return sorted(position for _, position in chosen)

    def _look_further(self, lane: list[int]) -> None:
        """For each case that has left, the next one of the lane is looked at."""
        end = bisect_left(lane, -self._last)
        missing = min(SPREAD_MAX, len(lane)) - (len(lane) - end)
        if missing <= 0:
            return
        further = lane[end - missing : end]
        self._last = -further[0]
        if len(self._heap) + missing > 2 * SPREAD_MAX:  # most of them have left
            further, self._heap = lane[end - missing :], []
        if 2 * missing < len(self._heap):
            for negated in further:
                heapq.heappush(self._heap, (-negated * GOLDEN % 1.0, -negated))
        else:
            self._heap += [(-negated * GOLDEN % 1.0, -negated) for negated in further]
            heapq.heapify(self._heap)


@dataclass(slots=True)
class Backlog:
    """Positions of waiting cases; no lane is empty."""

    lanes: dict[str, dict[int, list[int]]] = field(default_factory=dict)
    """Rig key -> group -> negated positions, ascending."""
    count: int = 0
    _heads: list[tuple[int, int, str]] = field(default_factory=list, compare=False, repr=False)
    """(position, group, rig key) of every lane's first case, and stale ones."""
    _mixtures: dict[tuple[str, int], LaneMixture] = field(
        default_factory=dict, compare=False, repr=False
    )
    """Mixtures of lanes that were asked for one, by rig key and group."""

    def add(self, rig: str, order: int, group: int) -> None:
        """A case waits (again), at its own place in the order."""
        lane = self.lanes.setdefault(rig, {}).setdefault(group, [])
        insort(lane, -order)
        self._mixtures.pop((rig, group), None)
        self.count += 1
        if lane[-1] == -order:
            self._push(order, group, rig)

    def extend(self, rig: str, orders: list[int], group: int) -> None:
        """Many cases at once, behind all others of their lane; ``orders`` ascend."""
        lanes = self.lanes.setdefault(rig, {})
        before = lanes.get(group, [])
        if before and -before[0] >= orders[0]:
            raise AssertionError(f"case {orders[0]} is not behind lane {group} of rig {rig}")
        lanes[group] = [-order for order in reversed(orders)] + before
        self.count += len(orders)
        if not before:
            self._push(orders[0], group, rig)

    def remove(self, rig: str, order: int, group: int) -> None:
        """A waiting case waits no longer."""
        lane = self.lanes.get(rig, {}).get(group, [])
        index = bisect_left(lane, -order)
        if index == len(lane) or lane[index] != -order:
            raise AssertionError(f"case {order} of rig {rig}, group {group}, is not waiting")
        del lane[index]
        self.count -= 1
        if lane:
            if index == len(lane):
                self._push(-lane[-1], group, rig)
            return
        del self.lanes[rig][group]
        self._mixtures.pop((rig, group), None)
        if not self.lanes[rig]:
            del self.lanes[rig]

    def first(self, rig: str | None, usable: Usable) -> tuple[int, int] | None:
        """The first usable case and its group; ``rig`` None: any rig key."""
        if rig is not None:
            return min(self._usable(rig, usable), default=None)
        top = self._top()
        if top is None or usable(top[0]):
            return top
        return min((hit for key in self.lanes for hit in self._usable(key, usable)), default=None)

    def take(self, rig: str, group: int, begin: int = 0) -> Iterator[int]:
        """The cases of a lane from position ``begin`` on, in order, and then those before it; do
        not change the backlog meanwhile."""
        lane = self.lanes.get(rig, {}).get(group, [])
        before = len(lane) - bisect_right(lane, -begin)
        # Some thousand cases are looked at per request: no line of Python for each.
        after = islice(reversed(lane), before, None)
        return map(neg, chain(after, islice(reversed(lane), before)))

    def mixed(self, rig: str, group: int, count: int) -> list[int]:
        """At most ``count`` cases from all over a lane, ascending."""
        lane = self.lanes.get(rig, {}).get(group)
        if not lane:
            return []
        return self._mixtures.setdefault((rig, group), LaneMixture()).take(lane, count)

    def __len__(self) -> int:
        return self.count

    def _usable(self, rig: str, usable: Usable) -> Iterator[tuple[int, int]]:
        for group in self.lanes.get(rig, ()):
            for order in islice(self.take(rig, group), LOOK_MAX):
                if usable(order):
                    yield order, group
                    break

    def _push(self, order: int, group: int, rig: str) -> None:
        heapq.heappush(self._heads, (order, group, rig))
        if len(self._heads) > 2 * self.count + LOOK_MAX:
            heads = [(-q[-1], g, r) for r, lanes in self.lanes.items() for g, q in lanes.items()]
            heapq.heapify(heads)
            self._heads = heads

    def _top(self) -> tuple[int, int] | None:
        heads = self._heads
        while heads:
            order, group, rig = heads[0]
            lane = self.lanes.get(rig, {}).get(group)
            if lane and lane[-1] == -order:
                return order, group
            heapq.heappop(heads)
        return None
