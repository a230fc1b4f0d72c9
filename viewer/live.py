"""Shows running cases: thumbnails from the conductor's router to a hub for native viewers.

The hub listens on loopback only. A viewer that is frozen stops the hub's output, not its input: the
newest of each case waits in a slot, and what is logged is gated by a flush that must come back.
"""

from __future__ import annotations

import json
import signal
import threading
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import rerun as rr

from schemas import topics
from schemas.view import Thumbnail
from schemas.wire import ATTACHMENT_BYTES_MAX, WireError, decode
from twin.fabric.errors import UsageError
from twin.fabric.key_file import Key
from twin.fabric.zenoh_bus import open_bus
from viewer import naming, native
from viewer.blueprint import overview_blueprint
from viewer.overview import Overview
from viewer.slots import Slots
from viewer.window import Window, window

HUB_MEMORY = "256MiB"
"""What late viewers are shown of the past; older images are dropped."""

TURN_S = 0.2
"""Shortest time between two pictures of the wall [s]."""

PROBE_S = 0.05
"""How long a flush may take before the viewer counts as stuck; healthy ones need 4-18 ms [s]."""


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """What the command line says."""

    connect: str
    namespace: str
    key: Key | None = None
    """The fabric's key, for an endpoint with TLS."""
    port: int = 0
    """Port of the hub on loopback; 0: a free one."""
    show: bool = True
    """Open a window if there is a display."""
    json: bool = False


class Hub:
    """One recording that native viewers connect to."""

    def __init__(self, stream: rr.RecordingStream, url: str) -> None:
        self.url = url
        self.logged = 0
        self.skipped = 0
        """Pictures left out because a viewer was stuck."""
        self._stream = stream

    def show(self, overview: Overview, now_s: float) -> bool:
        """Log the wall as it stands; False: a viewer is stuck, try again later."""
        try:
            self._stream.flush(timeout_sec=PROBE_S)
        except Exception:
            self.skipped += 1
            return False
        self._stream.set_time(naming.WALL, timestamp=now_s)
        for path, archetype in overview.logged():
            self._stream.log(path, archetype)
        self.logged += 1
        return True

    def close(self) -> None:
        """End the recording; does not wait for stuck viewers."""
        try:
            self._stream.flush(timeout_sec=PROBE_S)
        except Exception:
            return
        self._stream.disconnect()


def open_hub(port: int) -> Hub:
    """Listen on loopback ``port``.

    Raises:
        UsageError: the port is in use.
    """
    stream = rr.RecordingStream(
        naming.OVERVIEW_APP, recording_id=naming.safe_id("live", f"{time.time_ns():x}")
    )
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    # The sink reports a port in use to its log only.
    if not native.is_free(port):
        raise UsageError(f"--port {port}: already in use; choose another, or 0 for a free one")
    sink = rr.GrpcServerSink("127.0.0.1", port, server_memory_limit=HUB_MEMORY)
    stream.set_sinks(sink, default_blueprint=overview_blueprint())
    return Hub(stream, sink.uri)


def run_live(options: LiveOptions) -> int:
    """Show cases until Ctrl-C or until the window is closed; the exit code."""
    port = options.port or native.free_port()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    slots = Slots()
    bus = open_bus(
        "client", connect=[options.connect], namespace=options.namespace, key=options.key
    )
    try:
        hub = open_hub(port)
        bus.subscribe(topics.VIEW_THUMBNAIL.key.format(campaign="*", case="*"), slots.put)
        _tell(hub, port, options)
        opened: AbstractContextManager[Window | None] = nullcontext()
        if options.show and native.has_display():
            opened = window(["--connect", hub.url])
        overview = Overview()
        with opened as shown:
            _loop(slots, overview, hub, shown, stop)
        _conclude(slots, overview, hub, options)
        hub.close()
    finally:
        bus.close()
    return 0


def _loop(
    slots: Slots, overview: Overview, hub: Hub, shown: Window | None, stop: threading.Event
) -> None:
    pending = False
    while not stop.wait(TURN_S):
        for sample in slots.take():
            try:
                thumbnail: Thumbnail = decode(sample.attachment, Thumbnail, ATTACHMENT_BYTES_MAX)
            except WireError:
                continue  # of another version; it is not ours to show
            overview.take(thumbnail, sample.payload)
            pending = True
        if pending and hub.show(overview, time.time()):
            pending = False
        if shown is not None and shown.process.poll() is not None:
            return


def _tell(hub: Hub, port: int, options: LiveOptions) -> None:
    if options.json:
        print(json.dumps({"hub": hub.url, "laptop": native.tunnel_commands(port)}), flush=True)
        return
    print(f"cases of {options.connect} on {hub.url}; Ctrl-C ends")
    print("on a laptop behind ssh, with the same rerun-sdk:")
    for line in native.tunnel_commands(port):
        print(f"  {line}", flush=True)


def _conclude(slots: Slots, overview: Overview, hub: Hub, options: LiveOptions) -> None:
    counters = slots.counters
    found: dict[str, Any] = {
        "cases": len(overview.tiles),
        "ended": len(overview.verdicts),
        "received": counters.received,
        "overwritten": counters.overwritten,
        "refused": counters.refused,
        "logged": hub.logged,
        "skipped": hub.skipped,
    }
    if options.json:
        print(json.dumps(found), flush=True)
        return
    print(
        f"{found['received']} thumbnails of {found['cases']} cases, {found['ended']} ended; "
        f"{found['logged']} pictures shown, {found['skipped']} left out"
    )
