"""Part of a case's name, typed into the terminal of ``viewer live``, opens the case in full.

Rerun tells nobody what is clicked in a view (0.41: it tells which recording is shown, and jumps to
every new one, so a list of all cases to click on would take the wall away again and again).
"""

from __future__ import annotations

import queue
import signal
import sys
import threading
from collections.abc import Sequence

NAMES_MAX = 8
"""Names listed in an answer, at most."""

HINT = "part of a case's name and Enter: that case in full"


def choose(text: str, names: Sequence[str]) -> tuple[str, str]:
    """The case meant by ``text``, or a line that says why there is none.

    Args:
        text: a case's name, or a part of it that no other case has.
        names: cases of the wall.
    """
    if text in names:
        return text, ""
    matches = [name for name in names if text in name]
    if len(matches) == 1:
        return matches[0], ""
    if not names:
        return "", "no case runs yet"
    some = ", ".join((matches or list(names))[:NAMES_MAX])
    if not text:
        return "", f"{HINT}, e.g. {some}"
    if matches:
        return "", f"'{text}' is in {len(matches)} names: {some}"
    return "", f"'{text}' is in no name on the wall; there are e.g. {some}"


def has_terminal() -> bool:
    """Whether standard input is a terminal, so that somebody can type."""
    return sys.stdin is not None and sys.stdin.isatty()


class Typed:
    """Lines typed into the terminal from :meth:`start` on."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._started = False

    def start(self) -> None:
        """Begin to read, from the main thread; again: nothing. Passwords are asked for before."""
        if self._started or not has_terminal():
            return
        self._started = True
        if hasattr(signal, "SIGTTIN"):
            # In the background a read would stop the whole process; so it fails instead.
            signal.signal(signal.SIGTTIN, signal.SIG_IGN)
        threading.Thread(target=self._read, name="prompt", daemon=True).start()

    def take(self) -> list[str]:
        """Lines since the last call."""
        lines = []
        while not self._lines.empty():
            lines.append(self._lines.get())
        return lines

    def _read(self) -> None:
        try:
            for line in sys.stdin:
                self._lines.put(line.strip())
        except OSError:
            return  # in the background
