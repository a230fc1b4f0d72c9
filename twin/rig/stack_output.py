"""What a stack printed while an attempt ran, cut out of the log of its process.

All cases of a rig share one stack and so one log. An attempt has the bytes that arrived between its
start and its end, also those of cases that ran beside it. What came while no case ran (a stack that
loads) belongs to the cases that start next.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field

HEAD_BYTES = 64 << 10
"""Size of the part that is kept of the beginning of an attempt's output [bytes]."""

TAIL_BYTES = 192 << 10
"""Size of the part that is kept of its end [bytes]."""

NEIGHBOURS_SHOWN = 8
"""Most cases that are named as having run beside it."""

ELSEWHERE = "--- the stack ran on another host; what it printed is there ---"
"""Stands in a log in place of the output that did not come here."""

_CONTROL = {code: f"\\x{code:02x}" for code in (*range(32), 127) if code not in (9, 10)}
_CONTROL[13] = "\n"
_CONTROL[0] = None  # type: ignore[assignment]  # what reads as zeros was given back to the disk


@dataclass(frozen=True, slots=True)
class Kept:
    """The output of one attempt."""

    head: bytes
    tail: bytes
    dropped: int
    """Left out between the two [bytes]."""
    neighbours: tuple[str, ...] = ()
    """Cases that ran meanwhile, sorted."""

    def text(self) -> str:
        """Output as it stands in the attempt's log: whole lines, control characters escaped."""
        if not (self.head or self.tail or self.dropped):
            return "--- the stack printed nothing ---\n"
        title = "--- printed by the stack"
        if self.neighbours:
            shown = ", ".join(self.neighbours[:NEIGHBOURS_SHOWN])
            more = len(self.neighbours) - NEIGHBOURS_SHOWN
            title += f", shared with cases that ran beside this one: {shown}"
            title += f" and {more} more" if more > 0 else ""
        if not self.dropped:
            return f"{title} ---\n{_lines(self.head + self.tail)}"
        left_out = f"--- {self.dropped:,} bytes left out ---\n"
        return f"{title} ---\n{_lines(self.head)}{left_out}{_lines(self.tail)}"


@dataclass(slots=True)
class _Window:
    case: str
    start: int
    """Offset of its first byte in the log."""
    head: bytes = b""
    neighbours: set[str] = field(default_factory=set)


class StackOutput:
    """Attempts that run, by token, and where in the log each began."""

    def __init__(self, descriptor: int | None) -> None:
        """``descriptor``: of the log, open for reading; None: it is on another host."""
        self._log = descriptor
        self._windows: dict[int, _Window] = {}
        self._looked = 0
        """Size of the log when it was last looked at [bytes]."""
        self._idle_from = 0
        """Up to here it belongs to cases that have ended."""
        self._first = True
        """Cases that begin now are the first, or the first after a time without any."""

    def begin(self, token: int, case: str, *, again: bool = False) -> None:
        """A case starts; those that start before the next look start together.

        ``again``: nothing is to be done if it has started already.
        """
        if again and token in self._windows:
            return
        self._first |= not self._windows
        window = _Window(case, self._idle_from if self._first else self._size())
        for other in self._windows.values():
            other.neighbours.add(case)
            window.neighbours.add(other.case)
        self._windows[token] = window

    def look(self) -> None:
        """Take in the beginnings of what was printed; its middle may be given back soon."""
        self._first &= not self._windows
        size = self._size()
        if size == self._looked:
            return
        self._looked = size
        for window in self._windows.values():
            known = window.start + len(window.head)
            window.head += self._read(known, min(size, window.start + HEAD_BYTES))

    def end(self, token: int) -> Kept | None:
        """A case is over: what belongs to it; None: it is on another host, or it never began."""
        self.look()
        window = self._windows.pop(token, None)
        end = self._size()
        if not self._windows:
            self._idle_from = end
        if window is None or self._log is None:
            return None
        tail = self._read(max(window.start + len(window.head), end - TAIL_BYTES), end)
        kept = len(window.head.rstrip(b"\0")) + len(tail.lstrip(b"\0"))
        return Kept(
            window.head,
            tail,
            max(0, end - window.start - kept),
            tuple(sorted(window.neighbours)),
        )

    def starts(self) -> list[int]:
        """Places in the log at which the running cases began [bytes]; from any thread."""
        return [window.start for window in list(self._windows.values())]

    def forget(self, token: int) -> None:
        """Forget the output of a case that nobody wants."""
        if self._windows.pop(token, None) is not None and not self._windows:
            self._idle_from = self._size()

    def _size(self) -> int:
        return 0 if self._log is None else os.fstat(self._log).st_size

    def _read(self, start: int, end: int) -> bytes:
        if self._log is None or end <= start:
            return b""
        return os.pread(self._log, end - start, start)


def readable(descriptor: int) -> int | None:
    """A log's descriptor that was passed to this process; -1 or none that is open: None."""
    try:
        os.fstat(descriptor)
    except OSError:
        return None
    return descriptor


def _lines(data: bytes) -> str:
    text = data.decode("utf-8", "replace").replace("\r\n", "\n").translate(_CONTROL)
    return text if not text or text.endswith("\n") else text + "\n"
