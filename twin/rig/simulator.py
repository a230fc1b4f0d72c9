"""The simulator of a rig: steps S slots in lockstep with the stack."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

from schemas.messages import Commands
from schemas.wire import topics
from schemas.wire.control import Result
from twin.base.errors import InfrastructureError, StackFaultError
from twin.base.pauses import settle
from twin.fabric.bus import Bus
from twin.fabric.drive import Outgoing, SimulatorEnd, Transport
from twin.fabric.frames import FrameBuffer, lay_out, offer_frames
from twin.fabric.rig_folder import frames_socket
from twin.rig.drive_recorder import DriveRecorder
from twin.rig.interventions.case import AttemptInterventions
from twin.rig.interventions.listener import RigInterventions
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
    Intervened,
    IntervenedDone,
    Orders,
    Progress,
    Upstream,
)
from twin.rig.profile import LoopLog
from twin.rig.realtime import RealtimeLink
from twin.rig.results import OutputListener, ResultWriter
from twin.rig.running.rig_loop import RigLoop
from twin.rig.slot import Finished, RigTick, Slot, SlotEnd, Slots
from twin.rig.slot_listener import SlotListeners
from twin.rig.stack_output import StackOutput, readable
from twin.rig.tick_messages import TickMessages
from twin.sensors.wanted import SENSORS_VARIABLE, Wanted, together
from twin.view.port import View

if TYPE_CHECKING:
    from twin.rig.inline import InlineStack

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
"""Longest time for the view to hand over what it holds, at the end [s]."""


class Simulator:
    """Slots, engine and lockstep; :meth:`run` never returns while the worker lives."""

    def __init__(
        self, bus: Bus, build: BuildRig, orders: Orders, out: Upstream, view: View
    ) -> None:
        rig, slots, device = build.rig, build.slots, build.device
        self._bus = bus
        self._view = view
        self._case = build.lease.case
        self._rig = rig
        self._device = device
        self._upward = out
        self._slots = Slots(slots)
        self._results = ResultWriter(self._written)
        self._orders = orders
        orders.on_drain(self._drain)
        self._interventions = RigInterventions(rig, slots, device, self._intervened)
        ask = self._interventions.ask
        bus.serve(topics.CONTROL.key.format(rig=rig), lambda p, r: ask(None, p, r))
        view.asks(ask)
        self._recorder = DriveRecorder(slots, device)
        inline = self._case.rig.placement == "inline"  # its words are among ours
        self._output = StackOutput(STDERR if inline else readable(build.output))
        self._waiting: list[Assign] = []
        self._seq = 0
        self._reported_s = 0.0
        self._log = LoopLog(rig, device, slots)
        self._inline: InlineStack | None = None
        self._realtime: RealtimeLink | None = None
        """Link that takes the place of the lockstep; None: lockstep."""
        self._stack_reads: Wanted = None
        """Sensor messages that the stack looks at."""
        self._reads: Wanted = None
        """Sensor messages that are read for it."""
        self._faulty = False
        """The stack cannot go on; the worker says what becomes of the cases."""

    def run(self) -> None:
        """BuildRig, then exchange and step for ever.

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
            idle = self._faulty or not (any(self._slots) or self._waiting)
            self._take_orders(block=idle)
            self._log.watch.lap("idle" if idle else "orders")
            if self._faulty:
                continue
            self._refill()
            self._interventions.turn()
            self._log.watch.lap("refill")
            if self._slots.running:
                try:
                    self._tick()
                except StackFaultError as fault:
                    self._stand_still(str(fault))
            elif self._slots.held:
                self._interventions.nap()

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
        slot = self._slots.of_token(order.token)
        if slot is None or slot.held or (slot.fresh and self._seq > 0):
            raise InfrastructureError(order.reason)
        self._finish(self._engine.fail(slot.index, order.reason))

    def _build(self) -> None:
        # Warp takes its time to load: the drive session is announced before.
        from twin.rig.engine import Engine
        from twin.scenario.case_files import check_files
        from twin.sensors.exteroceptive import frame_channels

        case, slots = self._case, len(self._slots)
        try:
            channels = frame_channels(case, slots)
        except ValueError:
            check_files(case)  # perhaps it is another vehicle than that of the submission
            raise
        offsets, size = lay_out(channels)
        # In real time the stack looks at pictures while the next are drawn: it gets copies.
        near = case.rig.placement == "worker" and case.rig.clock == "lockstep"
        best = os.environ.get(TRANSPORT_VARIABLE, "device") if near else ""
        shared = best in ("device", "memory") and size > 0
        frames = offer_frames(size, frames_socket(self._bus.endpoints[0])) if shared else None
        buffers = {}
        if frames is not None:
            buffers = {c.name: frames.array(c, offsets[c.name]) for c in channels}
        with self._upward.building():
            self._engine = Engine(case, slots, self._device, buffers, self._log.watch)
        if case.rig.placement == "inline":
            from twin.rig.inline import InlineStack

            self._inline = InlineStack(case, slots)
            self._stack_reads = self._inline.reads
            transport: Transport = "inline"
        else:
            transport = self._meet(slots, frames, best)
            self._stack_reads = self._end.reads
            if case.rig.clock == "realtime":
                self._realtime = RealtimeLink(self._end, self._engine.control_period_ns)
        self._reads = None if os.environ.get(SENSORS_VARIABLE) == "all" else self._stack_reads
        self._log.transport = transport
        self._log.unread = [c.name for c in channels if not self._is_shown(c.name)]
        self._cases = RigLoop(self._engine, self._slots)
        self._messages = TickMessages(self._engine, self._slots, self._device, transport, offsets)
        self._listeners = self._listening()
        self._listeners.built(self._engine)
        self._upward.send(Built(transport, list(self._engine.world.notes)))

    def _listening(self) -> SlotListeners:
        """Everything that hears of slots. Interventions and pace first: they say how a case ended,
        and views show that; results last: they write what the others have added."""
        pace = [self._realtime] if self._realtime is not None else []
        output = OutputListener(self._output)
        return SlotListeners(
            [self._interventions, *pace, self._view, self._recorder, output, self._results]
        )

    def _meet(self, slots: int, frames: FrameBuffer | None, best: str) -> Transport:
        """Wait for the stack, and agree on how frames travel."""
        from twin.base.gpu import cuda

        probe = cuda.offer(self._device) if best == "device" else None
        self._end = SimulatorEnd(
            self._bus, self._rig, slots, frames, probe=probe, device=self._device
        )
        self._end.handshake(self._on_wait)
        if frames is not None:
            frames.shut()
        return self._end.transport

    def _take_orders(self, *, block: bool) -> None:
        while (order := self._orders.next(0.2 if block else 0)) is not None:
            if isinstance(order, Assign):
                self._waiting.append(order)
            elif isinstance(order, Abandon):
                self._abandon(order.token)
            elif isinstance(order, Fail):
                self._fail(order)
            elif isinstance(order, Close):
                self._view.close(VIEW_GRACE_S)
                # The recorder is still reading; the worker cuts the lifeline when it has it all.
                self._orders.next(None)
            block = False
        self._results.check()
        self._report()

    def _abandon(self, token: int) -> None:
        self._waiting = [order for order in self._waiting if order.lease.token != token]
        slot = self._slots.of_token(token)
        if slot is not None:
            self._cases.withdraw(slot)
            self._listeners.withdrawn(slot)

    def _refill(self) -> None:
        """Free slots take waiting leases, only when all sensors are due for all."""
        if not self._cases.is_due:
            return
        for index in self._slots.free[: len(self._waiting)]:
            order = self._waiting.pop(0)
            slot = self._cases.begin(index, order.lease, time.monotonic, order.replay)
            self._listeners.started(slot)

    def _tick(self) -> None:
        started_s, watch = time.monotonic(), self._log.watch
        self._log.begin_tick()
        running = self._slots.running
        tick, sensors = self._sense()
        self._listeners.sensed(tick)
        watch.lap("view")
        answer = self._ask(tick, sensors)
        self._log.exchanged(answer)
        self._output.look()
        self._seq += 1
        for slot in running:
            slot.fresh = False
        tick.answered = self._messages.checked(tick, answer.commands)
        watch.lap("messages")
        self._listeners.commanded(tick)
        watch.lap("view")
        ended = self._cases.step(tick.commands)
        self._account(answer, time.monotonic() - started_s)
        for finished in ended:
            self._finish(finished)
        watch.lap("results")
        frames = len(running) * sum(name.partition(".")[0] == "camera" for name in tick.sensed)
        self._log.end_tick(len(running), frames, self._engine.control_period_ns)
        self._log.write(now=not self._slots.running)

    def _sense(self) -> tuple[RigTick, list[Outgoing]]:
        """Readings of the current ticks, and the messages that bring them to a stack elsewhere."""
        sensed, told = self._cases.sense(together([self._reads, self._listeners.wanted()]))
        # Also of what is there: a stack must not see more because somebody watches.
        shown = {name: data for name, data in told.items() if self._is_shown(name)}
        sensors = [] if self._inline else self._messages.frames(self._seq, shown)
        self._log.watch.lap("frames")
        episodes = self._messages.episodes(self._seq)
        message = self._messages.tick(self._seq, list(shown), len(episodes))
        self._log.watch.lap("messages")
        return RigTick(message, sensed, told, episodes, shown), sensors

    def _is_shown(self, name: str) -> bool:
        """Whether the stack looks at a sensor message."""
        return self._stack_reads is None or name in self._stack_reads

    def _ask(self, tick: RigTick, sensors: list[Outgoing]) -> Commands:
        """The stack's answer to a tick."""
        if self._inline:
            self._engine.wait()
            return self._inline.exchange(tick.message, tick.shown, tick.episodes)
        link = self._realtime or self._end
        return link.exchange(self._seq, tick.message, sensors, tick.episodes, self._on_wait)

    def _finish(self, finished: Finished) -> None:
        """A case has ended: its slot is free, and what it left is written."""
        slot = self._cases.leave(finished.slot)
        self._listeners.ended(slot, SlotEnd(finished, time.monotonic() - slot.started_s))

    def _account(self, answer: Commands, wall_s: float) -> None:
        """Account for the time that a tick took: for the report, never for a KPI."""
        running = self._slots.running
        for slot in running:
            slot.rig_wall_s += wall_s / len(running)
        by_index = {slot.index: slot for slot in running}
        for command, cost in zip(answer.commands, answer.costs, strict=False):
            if command.slot in by_index:
                by_index[command.slot].perceived(cost)

    def _intervened(self, slot: Slot, attempt: AttemptInterventions) -> None:
        """Tell view and worker that somebody has intervened in a case."""
        self._view.label(slot, attempt.label())
        if attempt.note is not None and not attempt.replayed:
            self._upward.send(Intervened(attempt.lease.token, attempt.note))

    def _written(self, end: SlotEnd, result: Result) -> None:
        """An attempt folder is complete; on the thread that writes them."""
        self._upward.send(IntervenedDone(result, end.changes) if end.changes else CaseDone(result))

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
        if now - self._reported_s < PROGRESS_PERIOD_S:
            return
        slots, ended = list(self._slots), self._results.tokens
        if not (slots or ended):
            return
        self._reported_s = now
        for slot in self._slots.held:
            self._view.label(slot, self._interventions.label(slot))
        self._upward.send(
            Progress(
                tokens=[slot.lease.token for slot in slots],
                ticks=[int(self._engine.tick[slot.index]) for slot in slots],
                waiting=[slot.lease.token for slot in self._slots.held],
                ended=ended,
            )
        )
