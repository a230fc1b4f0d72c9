"""The rule by which a stack of ROS 2 answers a tick. Pure.

``/clock`` stands still until the tick that it shows has been answered:

- ``stamp``: by a command whose stamp is the time of the tick. A stamp of an earlier tick is a
  command that came too late or twice and is left out; one of a later tick is a mistake. Commands
  on other topics, for gear and lamps, are in force from the tick after their stamp on, so it does
  not matter whether they come before or after the command that answers.
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
"""Lines of a case about commands that were left out."""


class StampError(ValueError):
    """A command that no tick can have asked for; one line."""


@dataclass(slots=True)
class Lockstep:
    """One case: the tick that is asked for, and what has come."""

    answer: Answer
    carried_over: bool = False
    """``stamp`` alone: the nodes ran in a case before; what they sent there may come until they
    answer here, also from a node that has left since."""
    stamp_ns: int = -1
    """Time of the tick that waits for its answer [ns]."""
    latest: dict[str, Any] = field(default_factory=dict)
    """Commands in force by topic."""
    sender: bytes = b""
    """Identifier of whoever commands."""
    late: int = 0
    """Commands that were left out."""
    _answered: bool = True
    _next: dict[str, tuple[int, Any]] = field(default_factory=dict)
    """Stamps and commands by topic that are in force from the tick after their stamp on."""

    def begin(self, stamp_ns: int) -> None:
        """A tick is asked for."""
        self.stamp_ns, self._answered = stamp_ns, self.answer == "newest"
        for topic, (since_ns, value) in list(self._next.items()):
            if since_ns < stamp_ns:
                self.latest[topic] = value
                del self._next[topic]

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
        if main and not self.carried_over:
            self._check_sender(topic, sender)
        if self.answer == "stamp":
            assert stamp_ns is not None, "refused when the case began"
            # Before the first tick, sim time is 0 for nodes.
            if stamp_ns > (self.stamp_ns if main else max(self.stamp_ns, 0)):
                return self._later(topic, stamp_ns)
            if not main:
                self._next.pop(topic, None)
                if stamp_ns >= self.stamp_ns:
                    self._next[topic] = stamp_ns, value
                    return ""
            elif stamp_ns < self.stamp_ns or self._answered:
                return self._left_out(topic, stamp_ns, "which was answered already")
            else:
                self._answered, self.carried_over = True, False
                self._check_sender(topic, sender)
        self.latest[topic] = value
        return ""

    def step(self) -> str:
        """The service of steps was called; why that moved nothing, or nothing."""
        if self.answer != "step":
            return f"answer: {self.answer} is set, where a call moves nothing"
        if self._answered:
            return "no tick waits"
        self._answered = True
        return ""

    def _later(self, topic: str, stamp_ns: int) -> str:
        if self.carried_over:
            return self._left_out(topic, stamp_ns, "later than /clock: of the case before")
        raise StampError(
            f"a command on {topic} has the stamp {stamp_ns / 1e9:.9f} s, but /clock is "
            f"{self.stamp_ns / 1e9:.9f} s; use sim time, and the stamp of what was seen"
        )

    def _left_out(self, topic: str, stamp_ns: int, why: str) -> str:
        self.late += 1
        if self.late > LATE_LINES_MAX:
            return ""
        return (
            f"left out: a command on {topic} with the stamp {stamp_ns / 1e9:.9f} s, {why}; "
            "further ones of this case are not told"
        )

    def _check_sender(self, topic: str, sender: bytes) -> None:
        if self.sender and sender != self.sender:
            raise StampError(
                f"two publishers command on {topic}: {self.sender.hex()[:8]} and "
                f"{sender.hex()[:8]}; one may"
            )
        self.sender = sender
