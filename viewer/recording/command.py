"""The recorder: a process beside the simulator that writes one file per attempt.

It subscribes, and does nothing else to the simulator: what it cannot keep up with is dropped on the
way or here, and the recording says so.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Literal

from schemas.wire import topics
from schemas.wire.codec import WireError, decode
from schemas.wire.view import CaseEnd, CaseStart, RecorderBatch, RecorderSample
from twin.base.channel import BoundedChannel
from twin.base.pauses import settle
from twin.base.process import PARENT_VARIABLE, bind_to_parent, leave_signals_to_the_parent
from twin.fabric.bus import Bus, Sample
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.zenoh_bus import open_bus
from viewer.recording.recording import RecordingFile, release_closed

QUEUE_BYTES_MAX = 256 << 20
"""Most bytes that wait to be written [bytes]."""

CONNECT_TIMEOUT_S = 20.0
"""Longest time the simulator may take to answer [s]."""

TURN_S = 1.0
"""Time between two looks for messages that have waited for too long [s]."""

CLOSED_MAX = 4
"""Recordings that are closed before Rerun is asked to let go of them: asking takes 1 ms."""

END: Literal["end"] = "end"
"""Mark in a recorder's queue: no further sample comes."""


class OpenRecordings:
    """Open recordings by token; fed from one thread."""

    def __init__(self) -> None:
        self._open: dict[int, RecordingFile] = {}
        self._closed = 0
        """Closed recordings of which Rerun still has threads and memory."""
        self.complete = 0
        self.incomplete = 0

    def take(self, message: bytes, now_s: float = 0.0) -> None:
        """Samples of a rig; a message that is damaged is left out.

        ``now_s``: a clock that does not jump [s].
        """
        try:
            batch: RecorderBatch = decode(message, RecorderBatch)
        except WireError as error:
            _say(f"left out: {error}")
            return
        for sample in batch.samples:
            self._sample(sample, now_s)

    def _sample(self, sample: RecorderSample, now_s: float) -> None:
        """Write a sample to its recording; one of no open recording is left out."""
        picture, state = sample.camera, sample.state
        if sample.start is not None:
            self._begin(sample.start)
        if picture is not None and picture.token in self._open:
            self._open[picture.token].camera(picture, sample.jpeg, now_s)
        if state is not None and state.token in self._open:
            self._open[state.token].state(state, now_s)
        if sample.end is not None:
            self._close(sample.end.token, sample.end)

    def write(self, now_s: float) -> None:
        """Write what has waited for too long; call it again and again."""
        for recording in self._open.values():
            recording.write(now_s)
        if self._closed:
            self._release()

    def close(self) -> None:
        """Close what is open; its end never came."""
        for token in list(self._open):
            self._close(token, None)

    def _begin(self, start: CaseStart) -> None:
        self._close(start.token, None)
        try:
            self._open[start.token] = RecordingFile(start)
        except OSError as error:
            self.incomplete += 1
            _say(f"{start.folder}: not recorded: {error.strerror or error}")

    def _close(self, token: int, end: CaseEnd | None) -> None:
        recording = self._open.pop(token, None)
        if recording is None:
            return
        try:
            complete = recording.close(end)
        except OSError as error:
            complete = False
            _say(f"{recording.start.folder}: {error.strerror or error}")
        if complete:
            self.complete += 1
        else:
            self.incomplete += 1
            _say(f"{recording.start.case}: recording is incomplete")
        self._closed += 1
        if self._closed >= CLOSED_MAX:
            self._release()

    def _release(self) -> None:
        self._closed = 0
        release_closed()


def run_record(connect: str, rig: str, namespace: str, key: MemberKey | None) -> int:
    """Record what the feed of ``rig`` at ``connect`` shows, until it ends or nobody wants it."""
    supervised = bool(os.environ.get(PARENT_VARIABLE))
    bind_to_parent()
    channel: BoundedChannel[bytes | Literal["end"]] = BoundedChannel(QUEUE_BYTES_MAX)

    def finish(*_: object) -> None:
        channel.offer(END, 0)

    if supervised:
        leave_signals_to_the_parent()
        threading.Thread(target=_wait_for_lifeline, args=(finish,), daemon=True).start()
    else:
        signal.signal(signal.SIGTERM, finish)
        signal.signal(signal.SIGINT, finish)
    bus = open_bus(
        "peer",
        connect=[connect],
        namespace=namespace,
        key=key,
        connect_timeout_s=CONNECT_TIMEOUT_S,
    )
    try:
        _subscribe(bus, rig, channel, finish)
        recorder = OpenRecordings()
        settle()
        looked_s = 0.0
        while (message := channel.take(TURN_S)) is not END:
            now_s = time.monotonic()
            if isinstance(message, bytes):
                recorder.take(message, now_s)
            if now_s - looked_s >= TURN_S:
                looked_s = now_s
                recorder.write(now_s)
        recorder.close()
    finally:
        bus.close()
    if channel.refused:
        _say(f"{channel.refused} messages did not fit into the queue")
    _say(f"{recorder.complete} recordings complete, {recorder.incomplete} incomplete")
    return 0


def _subscribe(
    bus: Bus, rig: str, channel: BoundedChannel[bytes | Literal["end"]], finish: Callable[[], None]
) -> None:
    def receive(sample: Sample) -> None:
        channel.offer(sample.payload, len(sample.payload))

    bus.subscribe(topics.FEED_RECORDED.key.format(rig=rig), receive)
    bus.subscribe(topics.FEED_END.key.format(rig=rig), lambda _: finish())
    # The feed starts to send when it sees this: the subscriptions stand.
    bus.announce(topics.RECORDER_ALIVE.key.format(rig=rig))


def _wait_for_lifeline(finish: Callable[[], None]) -> None:
    while os.read(0, 65536):
        pass
    finish()


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
