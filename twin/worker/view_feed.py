"""The view feed of a simulator: shows what happens, and never holds it up.

The simulator's loop copies and enqueues; a thread of the feed's own encodes and publishes. The
queue has a limit: what does not fit is left out, which receivers notice by the running number.
"""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from schemas import SCHEMA_VERSION, topics
from schemas.messages import Command, Lease
from schemas.topics import Topic
from schemas.view import FeedEnd, ViewMode
from schemas.wire import encode
from twin.fabric.bus import Bus
from twin.fabric.channel import Channel
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.errors import TwinError
from twin.fabric.key_file import Key
from twin.fabric.zenoh_bus import open_bus
from twin.worker.view_items import Began, Ended, Item, Run, Seen, Ticked

if TYPE_CHECKING:
    from twin.engine import Engine, Finished
    from twin.sensors.data import SensorData

QUEUE_BYTES_MAX = 128 << 20
"""Most bytes that wait to be encoded; raw pictures, so about 190 of 640x360 [bytes]."""

RECORDER_WAIT_S = 20.0
"""How long samples wait for a recorder that is starting, before it is given up [s]."""

THUMBNAIL_PERIOD_S = 0.25
"""Shortest wall time between two thumbnails of a case [s]."""

SPARE_MAX = 64
"""Buffers of encoded pictures kept for the next; fresh memory costs more than the copy."""

_TICK_BYTES = 1024
"""What a tick without its picture counts for in the queue [bytes]."""


class Feed(Protocol):
    """What the simulator's loop tells; every call returns at once."""

    endpoint: str
    """Where a recorder connects; empty: there is none to come."""

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """A case begins in ``slot``."""

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """All active slots are at a tick, sensed and commanded, not yet stepped."""

    def end(self, finished: Finished) -> None:
        """The case of a slot has ended."""

    def abandon(self, slot: int) -> None:
        """The case of a slot is no longer wanted."""

    def close(self, timeout_s: float) -> None:
        """Publish what waits and say that nothing follows; gives up after ``timeout_s`` [s]."""


class NoFeed:
    """Nobody looks."""

    endpoint = ""

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Where a simulator shows itself."""

    mode: ViewMode = ViewMode.none
    namespace: str = "twin"
    connect: str = ""
    """The conductor's router, for viewers; need not be reachable."""
    key: Key | None = None
    """The fabric's key; with it the recorder's session is TLS too."""


class _Harmless:
    """Passes on to a feed until that fails, once: whoever looks must not break what they see."""

    def __init__(self, feed: Feed) -> None:
        self.endpoint = feed.endpoint
        self._feed = feed

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.begin(slot, lease, engine))

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.tick(engine, sensed, commands))

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.end(finished))

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.abandon(slot))

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""
        self._try(lambda: self._feed.close(timeout_s))

    def _try(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception:
            traceback.print_exc()
            self._feed = NoFeed()


def open_feed(rig: str, slots: int, options: ViewOptions) -> Feed:
    """The feed of a rig; a feed that cannot be opened is none, and says so."""
    mode = options.mode
    if mode is ViewMode.none:
        return NoFeed()
    try:
        bus = open_bus(
            "peer",
            listen=[to_listen(LOOPBACK, keyed=options.key is not None)] if mode.records else [],
            connect=[options.connect] if mode.shows and options.connect else [],
            connect_required=False,
            namespace=options.namespace,
            key=options.key,
        )
    except TwinError as error:
        print(f"no view of this rig: {error}", file=sys.stderr, flush=True)
        return NoFeed()
    return _Harmless(ViewFeed(bus, rig, slots, mode))


class ViewFeed:
    """Publishes on the view plane; see the module."""

    def __init__(self, bus: Bus, rig: str, slots: int, mode: ViewMode) -> None:
        """If ``mode`` records, samples wait for the recorder that is about to connect."""
        self.endpoint = bus.endpoints[0] if bus.endpoints else ""
        self._shows = mode.shows
        self._bus = bus
        self._rig = rig
        self._runs: list[Run | None] = [None] * slots
        self._channel: Channel[Item | None] = Channel(QUEUE_BYTES_MAX)
        self._recorder = threading.Event()
        self._recorder_gone = not mode.records
        self._closed = threading.Event()
        self._spare: deque[np.ndarray] = deque(maxlen=SPARE_MAX)
        bus.watch(topics.RECORDER_ALIVE.key.format(rig=rig), self._on_recorder)
        threading.Thread(target=self._run, name="view-feed", daemon=True).start()

    # --- the simulator's loop ---------------------------------------------------------------

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""
        run = self._runs[slot] = Run(lease, recorded=not self._recorder_gone)
        if run.recorded:
            self._channel.offer(Began(run, run.number(), engine.colliders, engine.cars), 0)

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""
        shown = self._shown()
        now_s = time.monotonic() if shown else 0.0
        for slot, run in enumerate(self._runs):
            if run is None:
                continue
            run.last_tick = int(engine.tick[slot])
            # Numbers go on while the recorder is away: one that comes back sees what it missed.
            seq = run.number(2 if "camera" in sensed else 1) if run.recorded else -1
            recorded = run.recorded and not self._recorder_gone
            due = shown and "camera" in sensed and now_s - run.shown_s >= THUMBNAIL_PERIOD_S
            if not (recorded or due):
                continue
            if due:
                run.shown_s = now_s
            seen = self._look(engine, sensed, slot, commands[slot])
            size = _TICK_BYTES + (0 if seen.image is None else seen.image.nbytes)
            self._channel.offer(Ticked(run, seq if recorded else -1, seen, due), size)

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""
        run = self._runs[finished.slot]
        assert run is not None
        self._runs[finished.slot] = None
        columns = finished.table.columns
        last_row = int(columns["tick"].values[-1]) > run.last_tick
        seq = run.number(2 if last_row else 1) if run.recorded else -1
        time_ns = int(columns["sim_time_ns"].values[-1])
        shown = self._shown()
        if run.recorded or shown:
            # Size 0 always fits: however full the queue is, the verdict gets through.
            self._channel.offer(Ended(run, seq, finished, last_row, time_ns, shown), 0)

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""
        run = self._runs[slot]
        self._runs[slot] = None
        if run is not None and run.recorded:
            self._channel.offer(Ended(run, run.number(), None, False, 0, False), 0)

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""
        for slot in range(len(self._runs)):
            self.abandon(slot)
        self._channel.offer(None, 0)
        self._closed.wait(timeout_s)

    def _look(
        self, engine: Engine, sensed: dict[str, SensorData], slot: int, command: Command | None
    ) -> Seen:
        """Copy a slot's values: the simulator overwrites its arrays at the next tick."""
        image = boxes = None
        if "camera" in sensed:
            source = sensed["camera"].values[slot]
            image = self._spare.pop() if self._spare else np.empty_like(source)
            np.copyto(image, source)
        if "boxes" in sensed and sensed["boxes"].count is not None:
            boxes = sensed["boxes"].values[slot, : sensed["boxes"].count[slot]].copy()
        return Seen(
            tick=int(engine.tick[slot]),
            sim_time_ns=int(engine.sim_time_ns[slot]),
            state=engine.state[slot].copy(),
            command=command,
            image=image,
            boxes=boxes,
        )

    def _shown(self) -> bool:
        """A viewer subscribes to thumbnails."""
        return self._shows and self._bus.wanted(_anyone(topics.VIEW_THUMBNAIL))

    # --- the feed's thread ------------------------------------------------------------------

    def _on_recorder(self, _key: str, alive: bool) -> None:
        """The recorder came (it has subscribed before it says so) or went."""
        self._recorder_gone = not alive
        self._recorder.set()

    def _run(self) -> None:
        if not self._recorder_gone and not self._recorder.wait(RECORDER_WAIT_S):
            self._recorder_gone = True
        item = self._channel.take()
        # Late: the engine that this item comes from has loaded Warp already.
        from twin.worker.view_samples import Encoder

        encoder = Encoder()
        while item is not None:
            case = item.run.lease.case
            for topic, payload, attachment in encoder.messages(item):
                key = topic.key.format(campaign=case.campaign, case=case.id)
                self._bus.publish(key, payload, attachment, block=topic.block)
            if isinstance(item, Ticked) and item.seen.image is not None and not item.thumbnail:
                self._spare.append(item.seen.image)
            item = self._channel.take()
        end = FeedEnd(v=SCHEMA_VERSION, rig=self._rig)
        self._bus.publish(topics.FEED_END.key.format(rig=self._rig), encode(end), block=True)
        self._closed.set()


def _anyone(topic: Topic) -> str:
    """The topic's key for all campaigns and cases."""
    return topic.key.format(campaign="*", case="*")
