"""The simulator of a rig: steps S slots in lockstep with the stack."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from schemas import SCHEMA_VERSION
from schemas.identity import stack_name
from schemas.messages import (
    Command,
    Commands,
    Episode,
    Frame,
    Lease,
    PerceptionCost,
    Result,
    Tick,
)
from schemas.wire import topics
from schemas.wire.interventions import JOURNAL_FILE
from twin.base.errors import InfrastructureError, StackFaultError
from twin.base.pauses import settle
from twin.fabric.bus import Bus
from twin.fabric.drive import Outgoing, SimulatorEnd
from twin.fabric.frames import FrameBuffer, lay_out, offer_frames
from twin.fabric.rig_folder import frames_socket
from twin.rig.drive_recorder import DriveRecorder
from twin.rig.interventions.case import Hand
from twin.rig.interventions.listener import RigInterventions
from twin.rig.need_to_know import as_told
from twin.rig.orders import Orders
from twin.rig.pipe import (
    Abandon,
    Assign,
    BuildRig,
    Built,
    CaseDone,
    Close,
    Drained,
    Fail,
    Faulted,
    Progress,
    SteeredDone,
    Touched,
    Upstream,
)
from twin.rig.profile import LoopLog
from twin.rig.realtime import RealtimeLink
from twin.rig.results import EndedCase, ResultWriter
from twin.rig.stack_output import StackOutput, readable
from twin.view.port import Feed

if TYPE_CHECKING:
    from twin.rig.engine import Finished
    from twin.rig.inline import InlineStack
    from twin.sensors.data import SensorData

PROGRESS_PERIOD_S = 0.25
"""How often progress is reported to the worker [s]."""

TRANSPORT_VARIABLE = "TWIN_TRANSPORT"
"""Environment variable: the best way for frames to reach the stack that may be tried, ``device``
(the default), ``memory`` or ``bytes``; for comparisons."""

RESULT_GRACE_S = 10.0
"""Longest time for the results of cases that are over to reach the disk, at the end [s]."""

STDERR = 2
"""Where what is printed in this process goes: a file that can be read as well."""

VIEW_GRACE_S = 2.0
"""Longest time for the view feed to hand over what it holds, at the end [s]."""


@dataclass(slots=True)
class _Slot:
    lease: Lease
    started_s: float
    name: str
    """By which the stack knows the case."""
    fresh: bool = True
    """The episode has not been published yet."""
    perception: PerceptionCost | None = None
    """Sum so far; None: the stack reported none."""
    rig_wall_s: float = 0.0
    """This slot's share of the rig's wall time so far [s]."""


class Simulator:
    """Slots, engine and lockstep; :meth:`run` never returns while the worker lives."""

    def __init__(
        self, bus: Bus, build: BuildRig, orders: Orders, out: Upstream, feed: Feed
    ) -> None:
        rig, slots, device = build.rig, build.slots, build.device
        self._bus = bus
        self._feed = feed
        self._case = build.lease.case
        self._rig = rig
        self._device = device
        self._upward = out
        self._results = ResultWriter(self._written)
        self._orders = orders
        orders.on_drain(self._drain)
        self._slots: list[_Slot | None] = [None] * slots
        self._steering = RigInterventions(rig, self._slots, device, self._touched)
        bus.serve(topics.CONTROL.key.format(rig=rig), lambda p, r: self._steering.ask(None, p, r))
        feed.steered_by(self._steering.ask)
        self._recorder = DriveRecorder(slots, device)
        inline = self._case.placement == "inline"  # its words are among ours
        self._output = StackOutput(STDERR if inline else readable(build.output))
        self._waiting: list[Assign] = []
        self._seq = 0
        self._reported_s = 0.0
        self._log = LoopLog(rig, device, slots)
        self._inline: InlineStack | None = None
        self._realtime: RealtimeLink | None = None
        """In place of the lockstep."""
        self._handles: dict[str, bytes] = {}
        self._faulty = False
        """The stack cannot go on; the worker says what becomes of the cases."""

    def run(self) -> None:
        """Build, then exchange and step for ever.

        Whatever ends that is raised only when the results of cases that are over are told: they
        must not be taken for victims of the rig.
        """
        try:
            self._loop()
        finally:
            self._recorder.drain(RESULT_GRACE_S)
            self._results.drain(RESULT_GRACE_S)
            # What could not be written is no case that is over.
            self._upward.send(Progress([], [], ended=self._results.tokens))
            if self._inline is not None:
                self._inline.close()

    def _loop(self) -> None:
        self._build()
        settle()
        while True:
            parked = self._steering.parked
            idle = self._faulty or not (self._busy() or self._waiting or parked)
            self._take_orders(block=idle)
            self._log.watch.lap("idle" if idle else "orders")
            if self._faulty:
                continue
            self._refill()
            self._steering.turn(self._engine)
            self._log.watch.lap("refill")
            if self._busy():
                try:
                    self._tick()
                except StackFaultError as fault:
                    self._stand_still(str(fault))
            elif parked:
                self._steering.nap(self._engine)

    def _stand_still(self, reason: str) -> None:
        """The stack cannot go on. Cases that are over are no victims of it: they are told first."""
        self._faulty = True
        self._results.drain(RESULT_GRACE_S)
        self._upward.send(Progress([], [], ended=self._results.tokens))
        self._upward.send(Faulted(reason))

    def _fail(self, order: Fail) -> None:
        """End a case whose stack cannot go on.

        Raises:
            InfrastructureError: the stack has not seen it, and may have left because of another.
        """
        self._faulty = True
        for index, slot in enumerate(self._slots):
            if slot is None or slot.lease.token != order.token:
                continue
            if not slot.fresh or self._seq == 0:
                self._finish(self._engine.fail(index, order.reason))
                return
        raise InfrastructureError(order.reason)

    def _busy(self) -> bool:
        return any(slot is not None for slot in self._slots)

    def _build(self) -> None:
        # Warp takes its time to load: the drive session is announced before.
        from twin.rig.engine import Engine, check_files, frame_channels

        case, slots = self._case, len(self._slots)
        try:
            channels = frame_channels(case, slots)
        except ValueError:
            check_files(case)  # perhaps it is another vehicle than that of the submission
            raise
        self._offsets, size = lay_out(channels)
        # In real time the stack looks at pictures while the next are drawn: it gets copies.
        near = case.placement == "worker" and case.clock == "lockstep"
        best = os.environ.get(TRANSPORT_VARIABLE, "device") if near else ""
        shared = best in ("device", "memory") and size > 0
        frames = offer_frames(size, frames_socket(self._bus.endpoints[0])) if shared else None
        buffers = {}
        if frames is not None:
            buffers = {c.name: frames.array(c, self._offsets[c.name]) for c in channels}
        self._engine = Engine(case, slots, self._device, buffers, self._log.watch)
        if case.placement == "inline":
            from twin.rig.inline import InlineStack

            self._inline = InlineStack(case, slots)
            self._log.transport = "inline"
        else:
            self._meet(slots, frames, best)
            if case.clock == "realtime":
                self._realtime = RealtimeLink(self._end, self._engine.control_period_ns)
        self._upward.send(Built(self._log.transport))

    def _meet(self, slots: int, frames: FrameBuffer | None, best: str) -> None:
        """Wait for the stack, and agree on how frames travel."""
        from twin.base.gpu import cuda

        probe = cuda.offer(self._device) if best == "device" else None
        self._end = SimulatorEnd(
            self._bus, self._rig, slots, frames, probe=probe, device=self._device
        )
        self._end.handshake(self._on_wait)
        if frames is not None:
            frames.shut()
        self._log.transport = self._end.transport

    def _take_orders(self, *, block: bool) -> None:
        while (order := self._orders.next(0.2 if block else 0)) is not None:
            if isinstance(order, Assign):
                self._waiting.append(order)
            elif isinstance(order, Abandon):
                self._abandon(order.token)
            elif isinstance(order, Fail):
                self._fail(order)
            elif isinstance(order, Close):
                self._feed.close(VIEW_GRACE_S)
                # The recorder is still reading; the worker cuts the lifeline when it has it all.
                self._orders.next(None)
            block = False
        self._results.check()
        self._report()

    def _abandon(self, token: int) -> None:
        self._waiting = [order for order in self._waiting if order.lease.token != token]
        for index, slot in self._occupied():
            if slot.lease.token == token:
                self._engine.clear(index)
                self._steering.end(index)
                self._feed.abandon(index)
                self._recorder.abandon(index)
                self._output.forget(token)
                self._slots[index] = None

    def _refill(self) -> None:
        """Free slots take waiting leases, only when all sensors are due for all."""
        every = self._engine.refill_every
        running = [i for i, slot in enumerate(self._slots) if slot is not None]
        if running and self._engine.tick[running[0]] % every:
            return
        for index, slot in enumerate(self._slots):
            if slot is None and index not in self._steering.parked and self._waiting:
                order = self._waiting.pop(0)
                lease = order.lease
                self._engine.reset(index, lease.case)
                self._slots[index] = _Slot(lease, time.monotonic(), stack_name(lease.case))
                self._steering.begin(index, lease, order.replay)
                self._feed.begin(index, lease, self._engine)
                self._recorder.begin(index, lease)
                self._output.begin(lease.token, lease.case.id)

    def _tick(self) -> None:
        started_s = time.monotonic()
        watch = self._log.watch
        self._log.begin_tick()
        active = int(self._engine.active.sum())
        sensed = self._engine.sense()
        told = as_told(sensed, [slot and slot.lease.case for slot in self._slots])
        frames = active * sum(name.partition(".")[0] == "camera" for name in sensed)
        sensors = [] if self._inline else self._outgoing(told)
        watch.lap("frames")
        episodes = self._episodes()
        tick = Tick(
            v=SCHEMA_VERSION,
            seq=self._seq,
            active=[slot is not None for slot in self._slots],
            token=self._tokens(),
            tick=self._engine.tick.tolist(),
            sim_time_ns=self._engine.sim_time_ns.tolist(),
            sensors=list(sensed),
            episodes=len(episodes),
        )
        watch.lap("messages")
        self._recorder.seen(tick, told, episodes)
        watch.lap("view")
        if self._inline:
            self._engine.wait()
            answer = self._inline.exchange(tick, told, episodes)
        else:
            link = self._realtime or self._end
            answer = link.exchange(self._seq, tick, sensors, episodes, self._on_wait)
        self._log.exchanged(answer)
        self._output.look()
        self._seq += 1
        for slot in self._slots:
            if slot is not None:
                slot.fresh = False
        given = self._checked(answer.commands)
        self._recorder.answered(given)
        commands = self._steering.commanded(given)
        watch.lap("messages")
        self._feed.tick(self._engine, sensed, commands)
        watch.lap("view")
        ended = self._engine.step(commands)
        self._account(answer, time.monotonic() - started_s)
        for finished in ended:
            self._finish(finished)
        watch.lap("results")
        self._log.end_tick(active, frames, self._engine.control_period_ns)
        self._log.write(now=not self._busy())

    def _finish(self, finished: Finished) -> None:
        """A case has ended: its slot is free, and what it left is written."""
        slot = self._slots[finished.slot]
        assert slot is not None
        changes, journal = self._steering.finish(finished.slot)
        if changes:
            finished = steered(finished, changes)
        paced = self._realtime.finish() if self._realtime else None
        if paced is not None:
            finished = replace(finished, reasons=[*finished.reasons, paced.summary.told()])
        shown = replace(finished, outcome="intervened", verdict="") if changes else finished
        self._feed.end(shown)
        self._slots[finished.slot] = None
        self._results.put(
            EndedCase(
                slot.lease,
                finished,
                time.monotonic() - slot.started_s,
                slot.perception,
                slot.rig_wall_s,
                changes,
                journal,
                paced,
                self._recorder.end(finished.slot),
                self._output.end(slot.lease.token),
            )
        )

    def _account(self, answer: Commands, wall_s: float) -> None:
        """What the tick took: for the report, never for a KPI."""
        running = [slot for slot in self._slots if slot is not None]
        for slot in running:
            slot.rig_wall_s += wall_s / len(running)
        for command, cost in zip(answer.commands, answer.costs, strict=False):
            slot = self._slots[command.slot] if 0 <= command.slot < len(self._slots) else None
            if slot is not None:
                slot.perception = summed(slot.perception, cost)

    def _tokens(self) -> list[int]:
        return [slot.lease.token if slot else 0 for slot in self._slots]

    def _outgoing(self, sensed: dict[str, SensorData]) -> list[Outgoing]:
        common = Frame(
            v=SCHEMA_VERSION,
            type="",
            seq=self._seq,
            active=[slot is not None for slot in self._slots],
            case=[slot.name if slot else "" for slot in self._slots],
            token=self._tokens(),
            tick=self._engine.tick.tolist(),
            sim_time_ns=self._engine.sim_time_ns.tolist(),
            dtype="",
            shape=[],
            encoding="",
        )
        on_gpu = self._end.transport == "device"
        if on_gpu:
            self._engine.wait()
        return [self._frame(name, data, common, on_gpu=on_gpu) for name, data in sensed.items()]

    def _frame(self, name: str, data: SensorData, common: Frame, *, on_gpu: bool) -> Outgoing:
        """One message; an array in shared memory has no payload."""
        handle, offset, payload = b"", -1, b""
        if on_gpu and data.device is not None:
            handle = self._handle(name, data.device)
            dtype, shape = np.dtype(data.device.__cuda_array_interface__["typestr"]), data.shape
        else:
            values = np.ascontiguousarray(data.values)
            dtype, shape = values.dtype, values.shape
            if name in self._offsets and self._end.transport != "bytes":
                offset = self._offsets[name]
            else:
                payload = values.tobytes()
        frame = structs.replace(
            common,
            type=name,
            dtype=dtype.newbyteorder("<").str,
            shape=list(shape),
            encoding=topics.sensor_topic(name).type,
            count=[] if data.count is None else data.count.tolist(),
            offset=offset,
            handle=handle,
        )
        return Outgoing(name, frame, payload)

    def _handle(self, name: str, array: Any) -> bytes:
        """The handle of an array that stays where it is."""
        if name not in self._handles:
            from twin.base.gpu.cuda import handle_of

            self._handles[name] = handle_of(array)
        return self._handles[name]

    def _episodes(self) -> list[Episode]:
        return [
            Episode.of(
                slot.lease.case,
                seq=self._seq,
                slot=index,
                token=slot.lease.token,
                cameras=self._engine.camera_sites,
                lidars=self._engine.lidar_sites,
                device=self._device,
            )
            for index, slot in enumerate(self._slots)
            if slot is not None and slot.fresh
        ]

    def _checked(self, commands: list[Command]) -> list[Command | None]:
        """Commands by slot.

        Raises:
            StackFaultError: a slot has no valid one; it names the slot's case.
        """
        by_slot: list[Command | None] = [None] * len(self._slots)
        for command in commands:
            if 0 <= command.slot < len(by_slot):
                by_slot[command.slot] = command
        ticks = self._engine.tick.tolist()
        for index, slot in enumerate(self._slots):
            if slot is None:
                by_slot[index] = None
                continue
            given = by_slot[index]
            if given is None:
                raise StackFaultError(f"stack: no command for case {slot.lease.case.id}")
            if given.token != slot.lease.token or given.tick != ticks[index]:
                raise StackFaultError(
                    f"stack: command of case {slot.lease.case.id} is for "
                    + _not_echoed(given, slot.lease.token, ticks[index])
                )
        return by_slot

    def _occupied(self) -> list[tuple[int, _Slot]]:
        """Slots with a case, those that stand still as well."""
        running = [(i, slot) for i, slot in enumerate(self._slots) if slot is not None]
        return sorted([*running, *self._steering.parked.items()], key=lambda each: each[0])

    def _touched(self, index: int, hand: Hand) -> None:
        """A hand has done something to the case of a slot."""
        self._feed.hand(index, hand.label())
        if hand.note is not None and not hand.replayed:
            self._upward.send(Touched(hand.lease.token, hand.note))

    def _written(self, ended: EndedCase, result: Result) -> None:
        """An attempt folder is complete; on the thread that writes them."""
        self._upward.send(SteeredDone(result, ended.changes) if ended.changes else CaseDone(result))

    def _drain(self) -> None:
        """The stack is gone and the worker wants what is there; on the thread of the orders."""
        self._recorder.drain(RESULT_GRACE_S)
        self._results.drain(RESULT_GRACE_S)
        self._upward.send(Drained())

    def _on_wait(self) -> None:
        """While waiting for the stack.

        Raises:
            StackFaultError: it has ended by itself.
        """
        if self._orders.failing and not self._faulty:
            raise StackFaultError(self._orders.failing)
        self._output.look()
        self._report()

    def _report(self) -> None:
        self._log.write()
        now = time.monotonic()
        parked = self._steering.parked
        if now - self._reported_s < PROGRESS_PERIOD_S:
            return
        ended = self._results.tokens
        if not (self._busy() or parked or ended):
            return
        self._reported_s = now
        for index in parked:
            self._feed.hand(index, self._steering.label(index))
        running = self._occupied()
        self._upward.send(
            Progress(
                tokens=[slot.lease.token for _, slot in running],
                ticks=[int(self._engine.tick[i]) for i, _ in running],
                waiting=[slot.lease.token for slot in parked.values()],
                ended=ended,
            )
        )


def _not_echoed(given: Command, token: int, tick: int) -> str:
    """Which of token and tick a command does not echo."""
    echoes = (("token", given.token, token), ("tick", given.tick, tick))
    wrong = [f"{name} {said}, expected {asked}" for name, said, asked in echoes if said != asked]
    return f"{' and '.join(wrong)}; echo those of the observation"


def steered(finished: Finished, changes: int) -> Finished:
    """How a case ends that a hand has steered: what came out says nothing about the stack."""
    line = f"steered by hand ({changes} changes in {JOURNAL_FILE}): no verdict of the case"
    return replace(finished, reasons=[line, *finished.reasons])


def summed(total: PerceptionCost | None, cost: PerceptionCost | None) -> PerceptionCost | None:
    """Both together; what a foreign stack says and can be no time or number is left out."""
    if cost is None or not (0 <= cost.frames < 1e6 and 0.0 <= cost.wall_s < 1e6):
        return total
    if total is None:
        return cost
    return structs.replace(
        total, frames=total.frames + cost.frames, wall_s=total.wall_s + cost.wall_s
    )
