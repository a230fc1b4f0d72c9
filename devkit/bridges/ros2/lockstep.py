"""The rule by which a stack of ROS 2 answers a tick. Pure.

``/clock`` stands still until the tick that it shows has been answered:

- ``stamp``: by a command whose stamp is the time of the tick. A stamp of an earlier tick is a
  command that came too late or twice and is left out; one of a later tick is a mistake.
- ``step``: by a call of the service of steps. The newest command counts, also one of an earlier
  tick: it is in force until another comes.
- ``newest``: at once, with the newest command that is there. Its results depend on time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Answer = Literal["stamp", "step", "newest"]
"""How a tick is answered."""

LATE_LINES_MAX = 1
"""Lines of a case about commands that came too late."""


class StampError(ValueError):
    """A command that no tick can have asked for; one line."""


@dataclass(slots=True)
class Lockstep:
    """One case: the tick that is asked for, and what has come."""

    answer: Answer
    stamp_ns: int = -1
    """Time of the tick that waits for its answer [ns]."""
    latest: dict[str, Any] = field(default_factory=dict)
    """Commands in force by topic."""
    sender: bytes = b""
    """Identifier of whoever commands."""
    late: int = 0
    """Commands that were left out."""
    _answered: bool = False

    def begin(self, stamp_ns: int) -> None:
        """A tick is asked for."""
        self.stamp_ns, self._answered = stamp_ns, self.answer == "newest"

    @property
    def is_answered(self) -> bool:
        """Whether the clock may move."""
        return self._answered

    def command(
        self, topic: str, value: Any, stamp_ns: int | None, sender: bytes, *, main: bool
    ) -> str:
        """A command has come; a line for the log, or nothing.

        Args:
            topic: on which it came.
            value: what it holds.
            stamp_ns: its stamp [ns]; None: its type has none.
            sender: identifier of its publisher.
            main: whether it is on the topic that moves the car, which answers ticks.

        Raises:
            StampError: no tick can have asked for it.
        """
        if main:
            self._check_sender(topic, sender)
        if self.answer == "stamp" and main:
            assert stamp_ns is not None, "refused when the case began"
            if stamp_ns > self.stamp_ns:
                raise StampError(
                    f"a command on {topic} has the stamp {stamp_ns / 1e9:.9f} s, but /clock is "
                    f"{self.stamp_ns / 1e9:.9f} s; use sim time, and the stamp of what was seen"
                )
            if stamp_ns < self.stamp_ns or self._answered:
                self.late += 1
                if self.late > LATE_LINES_MAX:
                    return ""
                return (
                    f"left out: a command on {topic} with the stamp {stamp_ns / 1e9:.9f} s, which "
                    "was answered already; further ones of this case are not told"
                )
            self._answered = True
        self.latest[topic] = value
        return ""

    def step(self) -> None:
        """The service of steps was called."""
        self._answered = self._answered or self.answer == "step"

    def _check_sender(self, topic: str, sender: bytes) -> None:
        if self.sender and sender != self.sender:
            raise StampError(
                f"two publishers command on {topic}: {self.sender.hex()[:8]} and "
                f"{sender.hex()[:8]}; one may"
            )
        self.sender = sender
