"""SIGINT and SIGTERM as something a loop waits for.

``threading.Event`` is not meant for this: a handler that calls ``set()`` while the main thread is
inside ``wait()`` waits for the lock that the thread below it holds, for ever.
"""

from __future__ import annotations

import queue
import signal


class StopSignal:
    """Somebody has asked this process to end; made in the main thread, where it is waited for."""

    def __init__(self) -> None:
        """Take both signals over for the rest of the process."""
        self._asked = False
        # The one queue of Python whose put() may interrupt its own get().
        self._bell: queue.SimpleQueue[None] = queue.SimpleQueue()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._receive)

    def wait(self, timeout_s: float) -> bool:
        """Whether somebody has asked, after ``timeout_s`` at the latest."""
        if not self._asked:
            try:
                self._bell.get(timeout=timeout_s)
            except queue.Empty:
                pass
        return self._asked

    def _receive(self, _number: int, _frame: object) -> None:
        self._asked = True
        self._bell.put(None)
