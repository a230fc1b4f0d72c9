"""The hub: one process-wide server on loopback that native viewers connect to.

A viewer that is frozen stops the hub's output, not its input: the newest of each stream waits in a
slot, and what is logged waits for a flush that must come back. If there are other viewers, the gate
cuts it off.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import urlsplit

import rerun as rr

from twin.base.errors import InfrastructureError, UsageError
from viewer.live.gate import Gate
from viewer.live.inner_port import InnerPort
from viewer.live.overview import Overview
from viewer.live.pulse import Pulse
from viewer.playback import native
from viewer.recording import naming
from viewer.recording.blueprint import overview_blueprint
from viewer.recording.scenery import Logged

HUB_MEMORY = "128MiB"
"""What late viewers are shown of the past; older images are dropped. The process takes about twice
as much beside its 200 MB (measured with eight cases in full)."""

PROBE_S = 0.05
"""Longest time a flush may take before the viewer counts as stuck; healthy ones need 4-18 ms
[s]."""


READY_TIMEOUT_S = 30.0
"""Longest time Rerun's server may take to listen [s]."""
POLL_S = 0.01

PATIENCE_S = 5.0
"""Time after which a viewer that has stopped reading is cut off [s]."""


def flows(stream: rr.RecordingStream) -> bool:
    """What was logged has left; False: somebody is stuck, log nothing more for now."""
    try:
        stream.flush(timeout_sec=PROBE_S)
    except Exception:
        return False
    return True


STUCK: list[rr.RecordingStream] = []
"""Recordings that could not be ended: to drop one waits for its viewer, as disconnecting does."""


def leave(stream: rr.RecordingStream) -> None:
    """End a recording; does not wait for stuck viewers."""
    if flows(stream):
        stream.disconnect()
    else:
        STUCK.append(stream)


class ViewerHub:
    """The overview's recording, and the address that single cases are sent to."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        url: str,
        gate: Gate | None = None,
        inner: InnerPort | None = None,
    ) -> None:
        self.url = url
        """Address for viewers, and for recordings that are to be shown: the gate's, if there is
        one."""
        self._inner = inner
        self.logged = 0
        self.skipped = 0
        """Pictures left out because a viewer was stuck."""
        self._stream = stream
        self._gate = gate
        self._stuck_s: float | None = None
        """Since when viewers do not keep up."""
        self._styled = False

    @property
    def port(self) -> int:
        """Port of :attr:`url`."""
        return urlsplit(self.url).port or 0

    def open(self) -> bool:
        """Whether viewers keep up."""
        if flows(self._stream):
            self._stuck_s = None
            return True
        self.skipped += 1
        now_s = time.monotonic()
        if self._stuck_s is None:
            self._stuck_s = now_s
        elif self._gate is not None and now_s - self._stuck_s >= PATIENCE_S:
            self._stuck_s = now_s
            self._gate.relieve()
        return False

    def show(self, overview: Overview, now_s: float) -> None:
        """Log the wall as it stands; only while :meth:`open`."""
        self._put(overview.logged(), now_s)
        self.logged += 1

    def tell(self, pulse: Pulse, now_s: float) -> None:
        """Log what the conductor has said; only while :meth:`open`."""
        if not self._styled:
            self._styled = True
            for path, archetype in pulse.styles():
                self._stream.log(path, archetype, static=True)
        self._put(pulse.take(), now_s)

    def close(self) -> None:
        """End the recording; does not wait for stuck viewers."""
        if self._gate is not None:
            self._gate.close()
        leave(self._stream)
        if self._inner is not None:
            self._inner.end()

    def _put(self, logged: list[Logged], now_s: float) -> None:
        if logged:
            self._stream.set_time(naming.WALL, timestamp=now_s)
        for path, archetype in logged:
            self._stream.log(path, archetype)


def open_hub(
    port: int, *, bare: bool = False, say: Callable[[str], None] = lambda _: None
) -> ViewerHub:
    """Listen on loopback ``port``; 0: a free one.

    Args:
        port: where viewers come.
        bare: see :func:`viewer.recording.blueprint.overview_blueprint`.
        say: takes a line for people.

    Raises:
        UsageError: the port is in use.
    """
    stream = rr.RecordingStream(
        naming.OVERVIEW_APP, recording_id=naming.safe_id("live", f"{time.time_ns():x}")
    )
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    inner = native.free_port()
    try:
        gate = Gate(port, say)
    except OSError:
        raise UsageError(
            f"--port {port}: already in use; choose another, or 0 for a free one"
        ) from None
    sink = rr.GrpcServerSink("127.0.0.1", inner, server_memory_limit=HUB_MEMORY)
    stream.set_sinks(sink, default_blueprint=overview_blueprint(bare=bare))
    stream.send_recording_name("All cases")
    closed = _closed(inner)
    gate.serve(closed)
    return ViewerHub(stream, sink.uri.replace(f":{inner}/", f":{gate.port}/"), gate, closed)


def _closed(port: int) -> InnerPort:
    """The hub's own port, as soon as it listens."""
    until_s = time.monotonic() + READY_TIMEOUT_S
    while True:
        try:
            return InnerPort(port)
        except OSError:
            if time.monotonic() > until_s:
                raise InfrastructureError("the hub does not start; try again") from None
            time.sleep(POLL_S)
