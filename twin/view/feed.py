"""The view feed of a simulator: shows what happens, and never holds it up.

The simulator's loop copies and enqueues; a thread of the feed's own encodes and publishes. The
queue has a limit: what does not fit is left out, which receivers notice by the running number.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from schemas import SCHEMA_VERSION
from schemas.messages import Command, Lease
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.view import POINTS_MAX, FeedEnd, ViewMode
from twin.base.channel import BoundedChannel
from twin.base.errors import TwinError
from twin.fabric.bus import Bus, Cancel, Respond
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.zenoh_bus import open_bus
from twin.view.batch import SampleBatch
from twin.view.demand import Demand
from twin.view.items import (
    Began,
    Cloud,
    Item,
    Scenery,
    ShownEnd,
    SlotRun,
    SlotSeen,
    Ticked,
    WorldRequest,
)
from twin.view.port import Feed, Harmless, NoFeed

if TYPE_CHECKING:
    from twin.rig.engine import Engine, Finished
    from twin.sensors.data import SensorData
    from twin.view.encoder import Encoder

QUEUE_BYTES_MAX = 128 << 20
"""Most bytes that wait to be encoded; raw pictures, so about 190 of 640x360 [bytes]."""

RECORDER_WAIT_S = 20.0
"""How long samples wait for a recorder that is starting, before it is given up [s]."""

SPARE_MAX = 64
"""Buffers of encoded pictures kept for the next; fresh memory costs more than the copy."""

END: Literal["end"] = "end"
"""Nothing comes any more."""

_TICK_BYTES = 1024
"""What a tick without its picture counts for in the queue [bytes]."""


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Where a simulator shows itself."""

    mode: ViewMode = ViewMode.none
    namespace: str = "twin"
    connect: str = ""
    """The conductor's router, for viewers; need not be reachable."""
    key: MemberKey | None = None
    """The worker's key; with it the recorder's session is TLS too."""


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
    return Harmless(ViewFeed(bus, rig, slots, mode))


class ViewFeed:
    """Publishes on the view plane; see the module."""

    def __init__(self, bus: Bus, rig: str, slots: int, mode: ViewMode) -> None:
        """If ``mode`` records, samples wait for the recorder that is about to connect."""
        self.endpoint = bus.endpoints[0] if bus.endpoints else ""
        self._demand = Demand(bus, mode)
        self._bus = bus
        self._rig = rig
        self._runs: list[SlotRun | None] = [None] * slots
        self._channel: BoundedChannel[Item | Literal["end"]] = BoundedChannel(QUEUE_BYTES_MAX)
        self._recorder = threading.Event()
        self._recorder_gone = not mode.records
        self._closed = threading.Event()
        self._spare: deque[np.ndarray] = deque(maxlen=SPARE_MAX)
        self._engine: Engine | None = None
        self._sensed: dict[str, SensorData] = {}
        """With the latest pictures; those of slots that stand still stay in their buffers."""
        self._ask: Callable[[int, bytes, Respond], None] | None = None
        self._served: dict[int, Cancel] = {}
        """Keys on which viewers ask something of a slot's case."""
        self._shows = mode.shows
        bus.watch(topics.RECORDER_ALIVE.key.format(rig=rig), self._on_recorder)
        if mode.shows:
            bus.serve(topics.FEED_SCENE.key.format(rig=rig), self._on_asked)
        threading.Thread(target=self._run, name="view-feed", daemon=True).start()

    # --- the simulator's loop ---------------------------------------------------------------

    def begin(self, slot: int, lease: Lease, engine: Engine) -> None:
        """See :class:`Feed`."""
        self._engine = engine
        recorded, target = not self._recorder_gone, engine.target(slot)
        run = self._runs[slot] = SlotRun(lease, recorded=recorded, target=target)
        if run.recorded:
            self._channel.offer(Began(run, run.number(), engine.colliders, engine.cars), 0)
        ask = self._ask
        if self._shows and ask is not None:
            key = topics.VIEW_CONTROL.key.format(campaign=lease.case.campaign, case=lease.case.id)
            self._served[slot] = self._bus.serve(key, lambda p, r: ask(slot, p, r))

    def tick(
        self, engine: Engine, sensed: dict[str, SensorData], commands: list[Command | None]
    ) -> None:
        """See :class:`Feed`."""
        if "camera" in sensed:
            self._sensed = sensed
        wall, singles = self._demand.wall(), self._demand.singles()
        now_s = time.monotonic() if wall or singles else 0.0
        for slot, run in enumerate(self._runs):
            if run is None or not engine.active[slot]:
                continue
            run.last_tick = int(engine.tick[slot])
            # Numbers go on while the recorder is away: one that comes back sees what it missed.
            seq = run.number(2 if "camera" in sensed else 1) if run.recorded else -1
            recorded = run.recorded and not self._recorder_gone
            due = self._demand.due(run, sensed, now_s, wall=wall, singles=singles)
            if "start" in due:
                self._show(run, engine)
            if recorded or due:
                seen = self._look(engine, sensed, slot, commands[slot], due, recorded=recorded)
                ticked = Ticked(run, seq if recorded else -1, seen, due)
                self._channel.offer(ticked, _TICK_BYTES + seen.nbytes)

    def end(self, finished: Finished) -> None:
        """See :class:`Feed`."""
        run = self._runs[finished.slot]
        assert run is not None
        self._leave(finished.slot)
        columns = finished.table.columns
        last_row = int(columns["tick"].values[-1]) > run.last_tick
        seq = run.number(2 if last_row else 1) if run.recorded else -1
        time_ns = int(columns["sim_time_ns"].values[-1])
        wall, live = self._demand.wall(), self._demand.ended(run)
        if run.recorded or wall or live:
            # Size 0 always fits: however full the queue is, the verdict gets through.
            self._channel.offer(ShownEnd(run, seq, finished, last_row, time_ns, wall, live), 0)

    def abandon(self, slot: int) -> None:
        """See :class:`Feed`."""
        run = self._runs[slot]
        self._leave(slot)
        if run is None:
            return
        live = self._demand.ended(run)
        if run.recorded or live:
            seq = run.number() if run.recorded else -1
            self._channel.offer(ShownEnd(run, seq, None, False, 0, live=live), 0)

    def close(self, timeout_s: float) -> None:
        """See :class:`Feed`."""
        for slot in range(len(self._runs)):
            self.abandon(slot)
        self._channel.offer(END, 0)
        self._closed.wait(timeout_s)

    def steered_by(self, ask: Callable[[int, bytes, Respond], None]) -> None:
        """See :class:`Feed`."""
        self._ask = ask

    def hand(self, slot: int, label: str) -> None:
        """See :class:`Feed`."""
        run = self._runs[slot]
        if run is None:
            return
        run.hand = label
        engine = self._engine
        if engine is None or engine.active[slot]:
            return  # its next tick says so
        # Nobody steps it: what was last seen once more, for those who came meanwhile as well.
        wall, singles = self._demand.wall(), self._demand.singles()
        sensed = self._sensed
        due = self._demand.due(run, sensed, time.monotonic(), wall=wall, singles=singles)
        if "start" in due:
            self._show(run, engine)
        if due:
            seen = self._look(engine, sensed, slot, None, due, recorded=False)
            self._channel.offer(Ticked(run, -1, seen, due), _TICK_BYTES + seen.nbytes)

    def _show(self, run: SlotRun, engine: Engine) -> None:
        sites = engine.camera_sites, engine.lidar_sites
        self._channel.offer(Scenery(run, self._rig, engine.world, *sites), 0)

    def turn_away(self) -> None:
        """See :class:`Feed`."""
        while self._served:
            _, cancel = self._served.popitem()
            cancel()

    def _leave(self, slot: int) -> None:
        self._runs[slot] = None
        cancel = self._served.pop(slot, None)
        if cancel is not None:
            cancel()

    def _look(
        self,
        engine: Engine,
        sensed: dict[str, SensorData],
        slot: int,
        command: Command | None,
        due: frozenset[str],
        *,
        recorded: bool,
    ) -> SlotSeen:
        """Copy a slot's values: the simulator overwrites its arrays at the next tick."""
        image = boxes = None
        if "camera" in sensed and (recorded or not due.isdisjoint(("camera", "thumbnail"))):
            source = sensed["camera"].values[slot]
            # All of it, also for a thumbnail: making it smaller takes longer than the copy.
            image = self._spare.pop() if self._spare else np.empty_like(source)
            np.copyto(image, source)
        if "boxes" in sensed and sensed["boxes"].count is not None:
            boxes = sensed["boxes"].values[slot, : sensed["boxes"].count[slot]].copy()
        run = self._runs[slot]
        return SlotSeen(
            tick=int(engine.tick[slot]),
            sim_time_ns=int(engine.sim_time_ns[slot]),
            state=engine.state[slot].copy(),
            command=command,
            image=image,
            boxes=boxes,
            pictures={n: sensed[n].values[slot].copy() for n in due if n.startswith("camera.")},
            clouds={n: _thinned(sensed[n], slot) for n in due if n.startswith("lidar.")},
            hand=run.hand if run else "",
            target=run is not None and run.target is not None,
            movers=_movers(engine, slot) if recorded or "state" in due else None,
        )

    # --- the feed's thread ------------------------------------------------------------------

    def _on_recorder(self, _key: str, alive: bool) -> None:
        """The recorder came (it has subscribed before it says so) or went."""
        self._recorder_gone = not alive
        self._recorder.set()

    def _on_asked(self, _request: bytes, respond: Respond) -> None:
        """A viewer wants the standing world; before the first case there is none to tell."""
        if self._engine is not None:
            self._channel.offer(WorldRequest(self._engine.world, respond), 0)

    def _run(self) -> None:
        if not self._recorder_gone and not self._recorder.wait(RECORDER_WAIT_S):
            self._recorder_gone = True
        item = self._channel.take()
        # Late: the engine that this item comes from has loaded Warp already.
        from twin.view.encoder import Encoder

        encoder, batch = Encoder(), SampleBatch()
        while item is not END:
            if isinstance(item, WorldRequest):
                item.respond(encoder.scene(item.world))
            elif item is not None:
                self._publish(item, encoder, batch)
            left_s = batch.left_s(time.monotonic())
            if left_s == 0:
                self._send(batch)
                left_s = None
            item = self._channel.take(left_s)
        if batch.left_s(0.0) is not None:
            self._send(batch)
        end = FeedEnd(v=SCHEMA_VERSION, rig=self._rig)
        self._bus.publish(topics.FEED_END.key.format(rig=self._rig), encode(end), block=True)
        self._closed.set()

    def _publish(
        self, item: Began | Scenery | Ticked | ShownEnd, encoder: Encoder, batch: SampleBatch
    ) -> None:
        """Show ``item`` to viewers at once; the recorder's samples wait for others."""
        case = item.run.lease.case
        recorded, messages = encoder.messages(item)
        for sample in recorded:
            batch.add(sample, time.monotonic())
        for message in messages:
            key = message.topic.key.format(
                campaign=case.campaign, case=case.id, sensor=message.sensor
            )
            block = message.topic.block
            self._bus.publish(key, message.payload, message.attachment, block=block)
        if isinstance(item, Ticked) and item.seen.image is not None:
            self._spare.append(item.seen.image)

    def _send(self, batch: SampleBatch) -> None:
        topic = topics.FEED_RECORDED
        self._bus.publish(topic.key.format(rig=self._rig), batch.take(), block=topic.block)


def _thinned(sensed: SensorData, slot: int) -> Cloud:
    rays = sensed.values.shape[1]
    stride = max(1, -(-rays // POINTS_MAX))
    return Cloud(sensed.values[slot, ::stride].copy(), stride)


def _movers(engine: Engine, slot: int) -> np.ndarray:
    """[M, 7]: x, y, z, yaw, half length, half width, height of the scripted objects in sight."""
    placement, kinds = engine.placement, engine.world.kinds
    there = np.flatnonzero(placement.kind[slot] >= 0)
    rows = np.zeros((len(there), 7))
    for row, index in zip(rows, there, strict=True):
        kind = kinds[placement.kind[slot, index]]
        row[:3] = placement.position_m[slot, index]
        row[3] = placement.yaw_rad[slot, index]
        row[4:] = kind.half_length_m, kind.half_width_m, kind.mesh.points_m[:, 2].max()
    return rows
