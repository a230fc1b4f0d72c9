"""What is left to render, in portions; and who renders which of them next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from msgspec import Struct

IMAGES = 32
"""Images of a task, or those of one batch if that is larger."""


class Task(Struct, frozen=True):
    """Images of one street and camera."""

    split: str
    street: int
    """Number of the street in its split."""
    eye: int
    indices: tuple[int, ...]

    @property
    def place(self) -> tuple[str, int]:
        """The street: its world takes seconds to set up."""
        return self.split, self.street


def divided(split: str, street: int, eye: int, indices: Iterable[int], slots: int) -> list[Task]:
    """Tasks of whole batches, as far as the images go."""
    found, size = list(indices), max(1, IMAGES // slots) * slots
    parts = [found[first : first + size] for first in range(0, len(found), size)]
    return [Task(split, street, eye, tuple(part)) for part in parts]


class Agenda:
    """Hands out tasks so that everybody stays on one street as long as possible."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._left: dict[tuple[str, int], list[Task]] = {}
        for task in tasks:
            self._left.setdefault(task.place, []).append(task)
        self._at: dict[int, Task] = {}

    def __len__(self) -> int:
        return sum(len(tasks) for tasks in self._left.values())

    def take(self, who: int) -> Task | None:
        """The next task of ``who``; None: there is none left.

        First of the same street and camera, then of the same street; otherwise of the street where
        most images wait for each who is there.
        """
        last = self._at.pop(who, None)
        if last is not None and last.place in self._left:
            place = last.place
        else:
            crowd = Counter(task.place for task in self._at.values())
            waiting = {
                place: sum(len(task.indices) for task in tasks) / (1 + crowd[place])
                for place, tasks in self._left.items()
            }
            if not waiting:
                return None
            place = max(waiting, key=lambda one: (waiting[one], one))
        tasks = self._left[place]
        same = (i for i, t in enumerate(tasks) if last is not None and t.eye == last.eye)
        task = tasks.pop(next(same, 0))
        if not tasks:
            del self._left[place]
        self._at[who] = task
        return task
