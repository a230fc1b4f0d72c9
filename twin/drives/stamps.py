"""Times of messages: the stamps of their headers, or the times at which they were recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

Put = Callable[[int], None]
"""Keeps something at a time [ns]."""


@dataclass(slots=True)
class TopicStamps:
    """Decides, topic by topic, which clock times its messages.

    A stamp of 0 is the first tick of a simulation if another message of the topic has a later
    stamp. If no message of the topic ever has one, its publisher sets no stamps, and the time of
    the recording is all there is.
    """

    _stamped: set[str] = field(default_factory=set)
    _waiting: dict[str, list[tuple[int, Put]]] = field(default_factory=dict)

    def put(self, topic: str, stamp_ns: int, recorded_ns: int, put: Put) -> None:
        """Call ``put`` with the time of a message, now or as soon as that is decided."""
        if topic in self._stamped:
            put(stamp_ns)
        elif stamp_ns == 0:
            self._waiting.setdefault(topic, []).append((recorded_ns, put))
        else:
            self._stamped.add(topic)
            for _, earlier in self._waiting.pop(topic, ()):
                earlier(0)
            put(stamp_ns)

    def end(self) -> None:
        """The recording has ended: what is undecided has no stamps."""
        for waiting in self._waiting.values():
            for recorded_ns, put in waiting:
                put(recorded_ns)
        self._waiting.clear()
