"""What the worker tells its simulator, on the simulator's standard input."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable

from twin.rig.pipe import Downward, Drain, Fail, Unpacker


class Orders:
    """Orders of the worker, read on a thread; end-of-file means the worker is gone."""

    def __init__(self, stream: int) -> None:
        self._drain: Callable[[], None] = lambda: None
        self._drains = threading.Event()
        self.failing = ""
        """Not empty: the stack has ended by itself, so nobody should wait for it; the reason."""
        self._inbox: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._stream = stream
        threading.Thread(target=self._read, name="orders", daemon=True).start()

    def on_drain(self, drain: Callable[[], None]) -> None:
        """``drain``: what :class:`Drain` asks for; at once, since the loop may wait for a stack."""
        self._drain = drain
        self._drains.set()

    def _read(self) -> None:
        unpacker = Unpacker(Downward)
        while data := os.read(self._stream, 65536):
            for message in unpacker.feed(data):
                if isinstance(message, Drain):
                    self._drains.wait()
                    self._drain()
                else:
                    if isinstance(message, Fail):
                        self.failing = message.reason
                    self._inbox.put(message)
        os._exit(0)

    def next(self, timeout_s: float | None) -> object | None:
        """The next order; None after ``timeout_s`` (None: wait for ever)."""
        try:
            if timeout_s == 0:
                return self._inbox.get_nowait()
            return self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            return None
