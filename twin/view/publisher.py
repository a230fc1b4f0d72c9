"""The view of a simulator: shows what happens, and never holds it up.

The simulator's loop copies and enqueues; a thread of its own encodes and publishes. The
queue has a limit: what does not fit is left out, which receivers notice by the running number.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from schemas import SCHEMA_VERSION
from schemas.kinds.sensor import pictured_kinds, sensor_kinds
from schemas.messages import Command
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.view import POINTS_MAX, ClockReading, FeedEnd, ViewMode
from twin.base.channel import BoundedChannel
from twin.base.errors import TwinError
from twin.fabric.bus import Bus, Cancel, Respond
from twin.fabric.endpoint import LOOPBACK, to_listen
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.zenoh_bus import open_bus
from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.sensors.wanted import NOTHING, Wanted
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
from twin.view.port import Ask, GuardedView, NoView, View

if TYPE_CHECKING:
    from twin.rig.engine import Engine
    from twin.sensors.data import SensorData
    from twin.view.encoder import Encoder

QUEUE_BYTES_MAX = 128 << 20
"""Most bytes that wait to be encoded; raw pictures, so about 190 of 640x360 [bytes]."""

RECORDER_WAIT_S = 20.0
"""How long samples wait for a recorder that is starting, before it is given up [s]."""

SPARE_MAX = 64
"""Buffers of encoded pictures kept for the next; fresh memory costs more than the copy."""

END: Literal["end"] = "end"
"""Mark in the queue: no further item comes."""

_TICK_BYTES = 1024
"""What a tick without its picture counts for in the queue [bytes]."""


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Session and mode by which a simulator shows itself."""

    mode: ViewMode = ViewMode.none
    namespace: str = "twin"
    connect: str = ""
    """The conductor's router, for viewers; need not be reachable."""
    key: MemberKey | None = None
    """The worker's key; with it the recorder's session is TLS too."""


def open_view(rig: str, options: ViewOptions) -> View:
    """The view of a rig; one that cannot be opened is none, and says so."""
    mode = options.mode
    if mode is ViewMode.none:
        return NoView()
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
        return NoView()
    return GuardedView(ViewPublisher(bus, rig, mode))


class ViewPublisher(View):
    """Publishes on the view plane; see the module."""

    def __init__(self, bus: Bus, rig: str, mode: ViewMode) -> None:
        """Start the view; if ``mode`` records, samples wait for the recorder that will connect."""
        self.endpoint = bus.endpoints[0] if bus.endpoints else ""
        self._demand = Demand(bus, mode)
        self._bus = bus
        self._rig = rig
        self._runs: dict[int, SlotRun] = {}
        """Attempts that are shown, by slot."""
        self._channel: BoundedChannel[Item | Literal["end"]] = BoundedChannel(QUEUE_BYTES_MAX)
        self._recorder = threading.Event()
        self._recorder_gone = not mode.records
        self._closed = threading.Event()
        self._spare: deque[np.ndarray] = deque(maxlen=SPARE_MAX)
        self._engine: Engine | None = None
        self._sensed: dict[str, SensorData] = {}
        """Readings with the latest pictures; slots that stand still keep theirs in the buffers."""
        self._ask: Ask | None = None
        self._served: dict[int, Cancel] = {}
        """Keys on which viewers ask something of a slot's case."""
        self._shows = mode.shows
        bus.watch(topics.RECORDER_ALIVE.key.format(rig=rig), self._on_recorder)
        if mode.shows:
            bus.serve(topics.FEED_SCENE.key.format(rig=rig), self._on_asked)
            bus.serve(topics.FEED_CLOCK.key.format(rig=rig), self._on_clock_asked)
        threading.Thread(target=self._run, name="view-feed", daemon=True).start()

    # --- the simulator's loop ---------------------------------------------------------------

    def built(self, engine: Engine) -> None:
        """See :class:`SlotListener`."""
        self._engine = engine

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        lease, engine = slot.lease, self._engine
        assert engine is not None
        recorded, target = not self._recorder_gone, engine.target(slot.index)
        run = self._runs[slot.index] = SlotRun(lease, recorded=recorded, target=target)
        if run.recorded:
            self._channel.offer(Began(run, run.number(), engine.colliders, engine.cars), 0)
        ask = self._ask
        if self._shows and ask is not None:
            key = topics.VIEW_CONTROL.key.format(
                campaign=lease.case.variation.campaign, case=lease.case.id
            )
            self._served[slot.index] = self._bus.serve(key, lambda p, r: ask(slot.index, p, r))

    def wanted(self) -> Wanted:
        """See :class:`SlotListener`: a recording has everything, and so has a case that somebody
        looks at alone; the wall of all cases has their first camera, when a thumbnail is due."""
        if any(run.recorded for run in self._runs.values()) and not self._recorder_gone:
            return None
        if self._demand.singles() and any(map(self._demand.focused, self._runs.values())):
            return None
        engine = self._engine
        if engine is None or not self._demand.wall():
            return NOTHING
        now_s = time.monotonic()
        active = (run for slot, run in self._runs.items() if engine.active[slot])
        due = any(self._demand.small(run, now_s) for run in active)
        return frozenset(["camera"]) if due else NOTHING

    def commanded(self, tick: RigTick) -> None:
        """See :class:`SlotListener`: shows the cases that take part in a tick."""
        engine, sensed = self._engine, tick.sensed
        assert engine is not None
        if "camera" in sensed:
            self._sensed = sensed
        wall, singles = self._demand.wall(), self._demand.singles()
        now_s = time.monotonic() if wall or singles else 0.0
        for slot, run in sorted(self._runs.items()):
            if not engine.active[slot]:
                continue
            run.last_tick = int(engine.tick[slot])
            # Numbers go on while the recorder is away: one that comes back sees what it missed.
            seq = run.number(2 if "camera" in sensed else 1) if run.recorded else -1
            recorded = run.recorded and not self._recorder_gone
            due = self._demand.due(run, sensed, now_s, wall=wall, singles=singles)
            if "start" in due:
                self._show(run, engine)
            if recorded or due:
                snapshot = self._copied(engine, sensed, slot, tick.commands[slot], due, recorded)
                ticked = Ticked(run, seq if recorded else -1, snapshot, due)
                self._channel.offer(ticked, _TICK_BYTES + snapshot.nbytes)

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`."""
        finished = end.finished
        if end.changes:
            finished = replace(finished, outcome="intervened", verdict="")
        run = self._leave(slot.index)
        assert run is not None
        columns = finished.table.columns
        last_row = int(columns["tick"].values[-1]) > run.last_tick
        seq = run.number(2 if last_row else 1) if run.recorded else -1
        time_ns = int(columns["sim_time_ns"].values[-1])
        wall, live = self._demand.wall(), self._demand.ended(run)
        if run.recorded or wall or live:
            # Size 0 always fits: however full the queue is, the verdict gets through.
            at_s = time.monotonic() if wall else None
            shown = ShownEnd(run, seq, finished, last_row, time_ns, at_s, wall, live)
            self._channel.offer(shown, 0)

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        self._withdraw(slot.index)

    def _withdraw(self, slot: int) -> None:
        run = self._leave(slot)
        if run is None:
            return
        live = self._demand.ended(run)
        if run.recorded or live:
            seq = run.number() if run.recorded else -1
            self._channel.offer(ShownEnd(run, seq, None, False, 0, live=live), 0)

    def close(self, timeout_s: float) -> None:
        """See :class:`View`."""
        for slot in sorted(self._runs):
            self._withdraw(slot)
        self._channel.offer(END, 0)
        self._closed.wait(timeout_s)

    def asks(self, ask: Ask) -> None:
        """See :class:`View`."""
        self._ask = ask

    def label(self, slot: Slot, label: str) -> None:
        """See :class:`View`."""
        run = self._runs.get(slot.index)
        if run is None:
            return
        run.label = label
        engine = self._engine
        if engine is None or engine.active[slot.index]:
            return  # its next tick says so
        # Nobody steps it: its last picture once more, for those who came meanwhile as well.
        wall, singles = self._demand.wall(), self._demand.singles()
        sensed = self._sensed
        due = self._demand.due(run, sensed, time.monotonic(), wall=wall, singles=singles)
        if "start" in due:
            self._show(run, engine)
        if due:
            snapshot = self._copied(engine, sensed, slot.index, None, due, recorded=False)
            self._channel.offer(Ticked(run, -1, snapshot, due), _TICK_BYTES + snapshot.nbytes)

    def _show(self, run: SlotRun, engine: Engine) -> None:
        sites = engine.camera_sites, engine.lidar_sites
        self._channel.offer(Scenery(run, self._rig, engine.world, *sites), 0)

    def turn_away(self) -> None:
        """See :class:`View`."""
        while self._served:
            _, cancel = self._served.popitem()
            cancel()

    def _leave(self, slot: int) -> SlotRun | None:
        """Show nothing more of a slot; returns the attempt that was shown."""
        cancel = self._served.pop(slot, None)
        if cancel is not None:
            cancel()
        return self._runs.pop(slot, None)

    def _copied(
        self,
        engine: Engine,
        sensed: dict[str, SensorData],
        slot: int,
        command: Command | None,
        due: frozenset[str],
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
        run = self._runs.get(slot)
        return SlotSeen(
            tick=int(engine.tick[slot]),
            sim_time_ns=int(engine.sim_time_ns[slot]),
            state=engine.state[slot].copy(),
            command=command,
            image=image,
            boxes=boxes,
            pictures={n: sensed[n].values[slot].copy() for n in due if n.startswith("camera.")},
            clouds={n: _thinned(sensed[n], slot) for n in due if n.startswith("lidar.")},
            grids={kind.name: sensed[kind.name].of(slot) for kind in pictured_kinds(due)},
            label=run.label if run else "",
            at_s=time.monotonic() if "thumbnail" in due else None,
            target=run is not None and run.target is not None,
            nearest=engine.closest(slot),
            movers=_movers(engine, slot) if recorded or "state" in due else None,
            readings=_readings(sensed, slot) if recorded or "state" in due else {},
            rows=_rows(sensed, slot) if recorded or "state" in due else {},
        )

    # --- the view's own thread ------------------------------------------------------------------

    def _on_recorder(self, _key: str, alive: bool) -> None:
        """The recorder came (it has subscribed before it says so) or went."""
        self._recorder_gone = not alive
        self._recorder.set()

    def _on_asked(self, _request: bytes, respond: Respond) -> None:
        """A viewer wants the standing world; before the first case there is none to tell."""
        if self._engine is not None:
            self._channel.offer(WorldRequest(self._engine.world, respond), 0)

    def _on_clock_asked(self, _request: bytes, respond: Respond) -> None:
        """A viewer wants to know how old our pictures are."""
        respond(encode(ClockReading(v=SCHEMA_VERSION, rig=self._rig, clock_s=time.monotonic())))

    def _run(self) -> None:
        if not self._recorder_gone and not self._recorder.wait(RECORDER_WAIT_S):
            self._recorder_gone = True
        item = self._channel.take()
        # Late: the engine that this item comes from has loaded Warp already.
        from twin.view.encoder import Encoder

        encoder, batch = Encoder(self._rig), SampleBatch()
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
                campaign=case.variation.campaign, case=case.id, sensor=message.sensor
            )
            block = message.topic.block
            self._bus.publish(key, message.payload, message.attachment, block=block)
        if isinstance(item, Ticked) and item.snapshot.image is not None:
            self._spare.append(item.snapshot.image)

    def _send(self, batch: SampleBatch) -> None:
        topic = topics.FEED_RECORDED
        self._bus.publish(topic.key.format(rig=self._rig), batch.take(), block=topic.block)


def _readings(sensed: dict[str, SensorData], slot: int) -> dict[str, np.ndarray]:
    """Rows of numbers that were due, by message [K]."""
    names = (kind.name for kind in sensor_kinds().declared if not kind.looks)
    return {name: sensed[name].values[slot].copy() for name in names if name in sensed}


def _rows(sensed: dict[str, SensorData], slot: int) -> dict[str, np.ndarray]:
    """Valid rows of sensors that are drawn as points and were due, by message [N, K]."""
    rows = {}
    for kind in sensor_kinds().declared:
        data = sensed.get(kind.name) if kind.points is not None else None
        if data is not None and data.count is not None:
            rows[kind.name] = data.values[slot, : data.count[slot]].copy()
    return rows


def _thinned(sensed: SensorData, slot: int) -> Cloud:
    rays = sensed.values.shape[1]
    stride = max(1, -(-rays // POINTS_MAX))
    return Cloud(sensed.values[slot, ::stride].copy(), stride)


def _movers(engine: Engine, slot: int) -> np.ndarray:
    """Scripted objects in sight [M, 9]: x, y, z, yaw, half length, half width, height, pitch,
    roll."""
    placement, kinds = engine.placement, engine.world.kinds
    there = np.flatnonzero(placement.kind[slot] >= 0)
    rows = np.zeros((len(there), 9))
    for row, index in zip(rows, there, strict=True):
        kind = kinds[placement.kind[slot, index]]
        row[:3] = placement.position_m[slot, index]
        row[3] = placement.yaw_rad[slot, index]
        row[4:7] = kind.half_length_m, kind.half_width_m, kind.mesh.points_m[:, 2].max()
        if placement.half_m is not None:
            row[4:6] = placement.half_m[slot, index]
        if placement.pitch_rad is not None and placement.roll_rad is not None:
            row[7:] = placement.pitch_rad[slot, index], placement.roll_rad[slot, index]
    return rows
