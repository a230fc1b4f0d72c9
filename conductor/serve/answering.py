"""Messages that a thread of its own answers, one after the other: neither a slow disk nor somebody
who asks for much holds up the turn of the conductor."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable

from twin.base.channel import BoundedChannel
from twin.fabric.bus import Respond

_log = logging.getLogger(__name__)


class AnsweringThread:
    """Answers what it is offered."""

    def __init__(
        self,
        name: str,
        waiting_max: int,
        answer: Callable[[bytes], bytes],
        mistaken: Callable[[str], bytes],
    ) -> None:
        """Begin to answer.

        Args:
            name: of the thread; the log says it of mistakes.
            waiting_max: limit on the sum of the sizes of what waits.
            answer: to a message.
            mistaken: the answer where a mistake of ours keeps that one from being given, with the
                line that says so.
        """
        self._name, self._answer, self._mistaken = name, answer, mistaken
        self.ended = False
        """Whether nothing more is answered."""
        self._channel: BoundedChannel[tuple[bytes, Respond] | None] = BoundedChannel(waiting_max)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def offer(self, payload: bytes, respond: Respond, size: int = 1) -> bool:
        """Take a message if there is room for its ``size``; from any thread, never waits."""
        return self._channel.offer((payload, respond), size)

    def close(self, *, answering: bool) -> None:
        """End; what is waiting is answered before, or not at all."""
        self.ended = not answering
        self._channel.offer(None, 0)
        self._thread.join()

    def _run(self) -> None:
        while (item := self._channel.take()) is not None:
            if self.ended:
                continue
            payload, respond = item
            try:
                answer = self._answer(payload)
            except Exception:  # a mistake of ours; the next message is another one's
                _log.exception("%s: a message could not be answered", self._name)
                answer = self._mistaken("internal error of the conductor; see its log")
            with contextlib.suppress(Exception):  # whoever asked is gone and will ask again
                respond(answer)
