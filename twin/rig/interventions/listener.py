"""Interventions in running cases: requests from any thread, applied between two ticks.

The simulator calls :meth:`RigInterventions.turn` before every tick; while nobody has asked for
anything that is one look at an empty queue. Slots that stand still are held by the engine, and the
loop leaves them out of its ticks.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from schemas import SCHEMA_VERSION
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Touch
from schemas.wire.interventions import (
    JOURNAL_FILE,
    Action,
    ControlReply,
    ControlRequest,
    GiveBack,
    Pause,
    Query,
    SetPace,
    SpawnObject,
    Step,
    Takeover,
    changes_simulation,
    parts_of,
)
from twin.base.errors import TwinError
from twin.fabric.bus import Respond
from twin.rig.interventions.case import AttemptInterventions, told
from twin.rig.interventions.journal import InterventionJournal
from twin.rig.interventions.slot_changes import SlotChanges
from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.rig.slot_listener import SlotListener

if TYPE_CHECKING:
    from twin.rig.engine import Engine

REQUEST_BYTES_MAX = 4096
"""Largest request [bytes]."""
WAITING_MAX = 1000
"""Requests that wait for the next tick, at most; further ones are refused."""
NAP_S = 0.02
"""Longest wait while no slot may run, so that the worker's orders are taken meanwhile [s]."""


@dataclass(frozen=True, slots=True)
class _Asked:
    request: ControlRequest
    slot: int | None
    """Slot that the key names; None: the request names the case."""
    respond: Respond


@dataclass(slots=True)
class _Open:
    """An attempt in which somebody may intervene."""

    slot: Slot
    attempt: AttemptInterventions
    journal: InterventionJournal | None = None


class RigInterventions(SlotListener):
    """Interventions in the slots of a rig; see the module."""

    def __init__(
        self, rig: str, slots: int, device: str, tell: Callable[[Slot, AttemptInterventions], None]
    ) -> None:
        """Begin without interventions.

        Args:
            rig: name of the rig, for answers.
            slots: of the rig.
            device: where the rig computes.
            tell: hears of every attempt in which somebody has newly intervened.
        """
        self._rig = rig
        self._slots = slots
        self._device = device
        self._tell = tell
        self._changes: SlotChanges | None = None
        self._inbox: queue.Queue[_Asked] = queue.Queue(WAITING_MAX)
        self._open: dict[int, _Open] = {}
        """Attempts by slot."""
        self._timed: set[int] = set()
        """Slots that the wall clock or a journal has a say in."""
        self._commanding: set[int] = set()
        """Slots whose commands are changed."""

    # --- any thread -------------------------------------------------------------------------

    def ask(self, slot: int | None, payload: bytes, respond: Respond) -> None:
        """A request came, on the key of ``slot`` or on that of the rig."""
        try:
            if len(payload) > REQUEST_BYTES_MAX:
                raise WireError(
                    f"a request of {len(payload)} bytes, at most {REQUEST_BYTES_MAX} are read"
                )
            request: ControlRequest = decode(payload, ControlRequest)
            self._inbox.put_nowait(_Asked(request, slot, respond))
        except WireError as error:
            respond(_refusal(str(error)))
        except queue.Full:
            respond(_refusal(f"{WAITING_MAX} requests wait already; ask again later"))

    # --- the simulator's loop ---------------------------------------------------------------

    def built(self, engine: Engine) -> None:
        """See :class:`SlotListener`."""
        self._changes = SlotChanges(engine, self._rig)

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`; what is replayed is done by nobody but its journal."""
        replay = slot.replay
        attempt = AttemptInterventions(
            slot.lease,
            replay=list(replay),
            replayed=bool(replay),
            clocked=slot.lease.case.rig.clock == "realtime",
        )
        self._open[slot.index] = _Open(slot, attempt)
        if replay:
            self._timed.add(slot.index)

    def commanded(self, tick: RigTick) -> None:
        """See :class:`SlotListener`: what interventions have put in the place of the stack's
        commands."""
        tick.commands = list(tick.answered)
        for index in list(self._commanding):
            command = tick.answered[index]
            if command is not None:
                opened = self._open[index]
                tick.commands[index] = opened.attempt.changed(command)
                self._sort(opened)

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`: the journal is to be ended with the result."""
        opened = self._forget(slot)
        attempt = opened.attempt
        end.changes = 0 if attempt.replayed else attempt.changes
        end.journal = opened.journal
        if end.changes:
            line = (
                f"steered by hand ({end.changes} changes in {JOURNAL_FILE}): no verdict of the case"
            )
            end.finished = replace(end.finished, reasons=[line, *end.finished.reasons])

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        journal = self._forget(slot).journal
        if journal is not None:
            journal.close()

    def label(self, slot: Slot) -> str:
        """What views say of a case."""
        return self._open[slot.index].attempt.label()

    def turn(self) -> None:
        """Apply what was asked for, and let slots stand still or go on; before every tick."""
        if not self._timed and not self._inbox.queue:  # its lock is not worth a look
            return
        while True:
            try:
                asked = self._inbox.get_nowait()
            except queue.Empty:
                break
            asked.respond(self._answer(asked))
        for index in sorted(self._timed):
            self._replay(self._open[index])
            self._overdue(self._open[index])
        self._move_on()

    def nap(self) -> None:
        """Wait, because nothing may run, for a request or the first slot whose pace allows it."""
        engine, now_s = self._engine, time.monotonic()
        period_s = engine.control_period_ns / 1e9
        waits = [
            opened.attempt.wait_s(int(engine.tick[index]), period_s, now_s)
            for index, opened in self._open.items()
            if opened.slot.held
        ]
        try:
            asked = self._inbox.get(timeout=max(0.0, min([NAP_S, *waits])))
        except queue.Empty:
            return
        asked.respond(self._answer(asked))

    @property
    def _engine(self) -> Engine:
        return self._built.engine

    @property
    def _built(self) -> SlotChanges:
        assert self._changes is not None, "no case begins before the engine is built"
        return self._changes

    def _forget(self, slot: Slot) -> _Open:
        self._timed.discard(slot.index)
        self._commanding.discard(slot.index)
        return self._open.pop(slot.index)

    # --- requests ---------------------------------------------------------------------------

    def _answer(self, asked: _Asked) -> bytes:
        request = asked.request
        opened = self._find(asked)
        if opened is None:
            return _refusal(self._nobody(request))
        attempt, lease = opened.attempt, opened.slot.lease
        if request.token not in (0, lease.token):
            return _refusal(
                f"case {lease.case.id}: that attempt has ended, attempt "
                f"{lease.attempt} runs now; look again"
            )
        if request.id and request.id in attempt.answers:
            return attempt.answers[request.id]
        index = opened.slot.index
        tick, changed = int(self._engine.tick[index]), -1
        try:
            if attempt.replayed and not isinstance(request.action, Query):
                raise ValueError("it runs from a journal; nobody else may change it")
            changed = self._act(opened, request.action)
        except ValueError as error:
            return _refusal(str(error))
        reply = ControlReply(
            v=SCHEMA_VERSION,
            token=lease.token,
            tick=tick,
            object=changed if isinstance(request.action, SpawnObject) else -1,
            state=self._built.state(index, attempt, whole=isinstance(request.action, Query)),
        )
        answer = encode(reply)
        if request.id:
            attempt.remember(request.id, answer)
        return answer

    def _find(self, asked: _Asked) -> _Open | None:
        request = asked.request
        if asked.slot is not None:
            return self._open.get(asked.slot)
        for index, opened in sorted(self._open.items()):
            case = opened.slot.lease.case.id
            if request.case == case or (not request.case and index == request.slot):
                return opened
        return None

    def _nobody(self, request: ControlRequest) -> str:
        running = sorted(opened.slot.lease.case.id for opened in self._open.values())
        target = f"case '{request.case}'" if request.case else f"slot {request.slot}"
        return f"{target} does not run in this rig; running: {', '.join(running) or 'nothing'}"

    def _act(self, opened: _Open, action: Action) -> int:
        """Check, journal and apply an action; the object that it was done to, or -1.

        Raises:
            ValueError: it cannot be done; one line, and nothing has changed.
        """
        slot, attempt = opened.slot.index, opened.attempt
        now_s, tick = time.monotonic(), int(self._engine.tick[slot])
        parts = parts_of(action)
        for part in parts:
            if isinstance(part, Pause | Step | SetPace) and attempt.clocked:
                raise ValueError("clock realtime: the case goes with the wall clock, nobody else's")
            self._built.check(slot, part)
        if isinstance(action, GiveBack) and attempt.drive is None:
            attempt.heard_s = now_s
            return -1
        again = isinstance(action, Takeover) and attempt.drive is not None
        if action == attempt.drive:
            attempt.heard_s = attempt.drive_s = now_s  # the same pedals again: it is still there
            return -1
        if changes_simulation(action) and not attempt.replayed:
            changed = self._journalled(opened, [part for part in parts if changes_simulation(part)])
        else:
            changed = max(self._built.apply(slot, part) for part in parts)
        for part in parts:
            attempt.take(part, tick, now_s)
        self._sort(opened)
        if not isinstance(action, Query) and not again:
            attempt.note = Touch(tick, told(action), attempt.changes)
            self._tell(opened.slot, attempt)
        return changed

    def _journalled(self, opened: _Open, actions: Sequence[Action]) -> int:
        """Apply actions that have a place in the journal, or neither do nor write anything.

        Several are settings that were checked, so that none of them can be refused any more.
        """
        slot, engine = opened.slot, self._engine
        journal = opened.journal
        try:
            journal = journal or InterventionJournal(slot.lease, self._slots, self._device)
            tick, time_ns = engine.tick[slot.index], engine.sim_time_ns[slot.index]
            journal.add(int(tick), int(time_ns), actions)
            changed = max(self._built.apply(slot.index, action) for action in actions)
        except TwinError as error:
            if opened.journal is None and journal is not None:
                journal.discard()
            raise ValueError(f"it cannot be journalled: {error}") from None
        except ValueError:
            assert journal is not None, "an engine refuses what is in it already"
            if opened.journal is None:
                journal.discard()
            else:
                journal.take_back()
            raise
        opened.journal = journal
        return changed

    def _sort(self, opened: _Open) -> None:
        index, attempt = opened.slot.index, opened.attempt
        timed = attempt.timed or opened.slot.held
        (self._timed.add if timed else self._timed.discard)(index)
        (self._commanding.add if attempt.commands else self._commanding.discard)(index)

    # --- time -------------------------------------------------------------------------------

    def _replay(self, opened: _Open) -> None:
        replay = opened.attempt.replay
        while replay and replay[0].tick <= self._engine.tick[opened.slot.index]:
            self._act(opened, replay.pop(0).action)

    def _overdue(self, opened: _Open) -> None:
        action = opened.attempt.overdue(time.monotonic())
        if action is not None:
            # What cannot be journalled is not done; it is tried again before the next tick.
            with contextlib.suppress(ValueError):
                self._act(opened, action)

    def _move_on(self) -> None:
        """Hold slots that may not run; those that may go on once all sensors are due together."""
        engine, now_s = self._engine, time.monotonic()
        period_s = engine.control_period_ns / 1e9
        for index in sorted(self._timed):
            opened = self._open[index]
            slot = opened.slot
            runs = opened.attempt.wait_s(int(engine.tick[index]), period_s, now_s) <= 0.0
            if not runs and not slot.held:
                engine.hold(index)
                slot.held = True
            elif runs and slot.held and self._built.is_in_phase(index):
                engine.go_on(index)
                slot.held = False
                self._sort(opened)


def _refusal(error: str) -> bytes:
    return encode(ControlReply(v=SCHEMA_VERSION, error=error))
