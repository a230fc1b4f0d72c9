"""Steering cases by hand: takes requests from any thread, applies them between two ticks.

The simulator's loop calls :meth:`RigInterventions.turn` before every tick; while nobody has asked
for anything that is one look at an empty queue. Slots that stand still are held by the engine and
parked here, so that the loop sees a rig without them.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from schemas import SCHEMA_VERSION
from schemas.messages import Command, Lease, Touch
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.interventions import (
    OBJECTS_SHOWN_MAX,
    Action,
    ControlReply,
    ControlRequest,
    FreeObject,
    GiveBack,
    HandState,
    MoveObject,
    Pause,
    PlaceEgo,
    Query,
    RecordedAction,
    RemoveObject,
    SetEnvironment,
    SetPace,
    SetSensors,
    SpawnObject,
    Step,
    Takeover,
    parts_of,
    steers,
)
from twin.base.errors import TwinError
from twin.fabric.bus import Respond
from twin.rig.interventions.case import Hand, told
from twin.rig.interventions.journal import SteeringJournal
from twin.vehicle.state import COLUMN

if TYPE_CHECKING:
    from twin.rig.engine import Engine

REQUEST_BYTES_MAX = 4096
"""Largest request [bytes]."""
WAITING_MAX = 1000
"""Requests that wait for the next tick, at most; further ones are refused."""
NAP_S = 0.02
"""Longest wait while no slot may run, so that the worker's orders are taken meanwhile [s]."""

_Slot = TypeVar("_Slot")


@dataclass(frozen=True, slots=True)
class _Asked:
    request: ControlRequest
    slot: int | None
    """As the key says; None: as the request says."""
    respond: Respond


class RigInterventions(Generic[_Slot]):
    """The hands on a rig's slots; see the module."""

    def __init__(
        self, rig: str, slots: list[_Slot | None], device: str, tell: Callable[[int, Hand], None]
    ) -> None:
        """
        Args:
            rig: name of the rig, for answers.
            slots: the simulator's slots; those that stand still are taken out of it.
            device: where the rig computes.
            tell: hears of every slot whose hand has done something new.
        """
        self.parked: dict[int, _Slot] = {}
        """Slots that stand still."""
        self._rig = rig
        self._slots = slots
        self._device = device
        self._tell = tell
        self._inbox: queue.Queue[_Asked] = queue.Queue(WAITING_MAX)
        self._hands: list[Hand | None] = [None] * len(slots)
        self._journals: dict[int, SteeringJournal] = {}
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

    def begin(self, slot: int, lease: Lease, replay: list[RecordedAction]) -> None:
        """A case begins in ``slot``; ``replay``: done to it by nobody but this journal."""
        self._hands[slot] = Hand(
            lease,
            replay=list(replay),
            replayed=bool(replay),
            clocked=lease.case.clock == "realtime",
        )
        if replay:
            self._timed.add(slot)

    def end(self, slot: int) -> None:
        """The case of ``slot`` has ended, or is not wanted any more."""
        self._hands[slot] = None
        self._timed.discard(slot)
        self._commanding.discard(slot)
        self.parked.pop(slot, None)
        journal = self._journals.pop(slot, None)
        if journal is not None:
            journal.close()

    def finish(self, slot: int) -> tuple[int, SteeringJournal | None]:
        """The attempt of ``slot`` came to its end: how many changes a hand has made, and their
        journal, to be ended with the result."""
        hand = self._hands[slot]
        assert hand is not None
        journal = self._journals.pop(slot, None)
        self.end(slot)
        return (0 if hand.replayed else hand.changes), journal

    def label(self, slot: int) -> str:
        """What views say of the case in ``slot``."""
        hand = self._hands[slot]
        return "" if hand is None else hand.label()

    def turn(self, engine: Engine) -> None:
        """Apply what was asked for, and let slots stand still or go on."""
        if not self._timed and not self._inbox.queue:  # its lock is not worth a look
            return
        while True:
            try:
                asked = self._inbox.get_nowait()
            except queue.Empty:
                break
            asked.respond(self._answer(engine, asked))
        for slot in sorted(self._timed):
            self._replay(engine, slot)
            self._overdue(engine, slot)
        self._move_on(engine)

    def nap(self, engine: Engine) -> None:
        """Nothing may run: wait for a request, or for the first slot whose pace allows it."""
        now_s, period_s = time.monotonic(), engine.control_period_ns / 1e9
        waits = [
            hand.wait_s(int(engine.tick[slot]), period_s, now_s)
            for slot in self.parked
            if (hand := self._hands[slot]) is not None
        ]
        try:
            asked = self._inbox.get(timeout=max(0.0, min([NAP_S, *waits])))
        except queue.Empty:
            return
        asked.respond(self._answer(engine, asked))

    def commanded(self, commands: list[Command | None]) -> list[Command | None]:
        """The stack's commands with what hands have put in their place; one per slot."""
        if not self._commanding:
            return commands
        changed = list(commands)
        for slot in list(self._commanding):
            hand, command = self._hands[slot], commands[slot]
            if hand is not None and command is not None:
                changed[slot] = hand.changed(command)
                self._sort(slot, hand)
        return changed

    # --- requests ---------------------------------------------------------------------------

    def _answer(self, engine: Engine, asked: _Asked) -> bytes:
        request = asked.request
        slot = self._find(asked)
        if slot is None:
            return _refusal(self._nobody(request))
        hand = self._hands[slot]
        assert hand is not None
        if request.token not in (0, hand.lease.token):
            return _refusal(
                f"case {hand.lease.case.id}: that attempt has ended, attempt "
                f"{hand.lease.attempt} runs now; look again"
            )
        if request.id and request.id in hand.answers:
            return hand.answers[request.id]
        tick, changed = int(engine.tick[slot]), -1
        try:
            if hand.replayed and not isinstance(request.action, Query):
                raise ValueError("it runs from a journal; nobody else may change it")
            changed = self._act(engine, slot, hand, request.action)
        except ValueError as error:
            return _refusal(str(error))
        reply = ControlReply(
            v=SCHEMA_VERSION,
            token=hand.lease.token,
            tick=tick,
            object=changed if isinstance(request.action, SpawnObject) else -1,
            state=self._state(engine, slot, hand, whole=isinstance(request.action, Query)),
        )
        answer = encode(reply)
        if request.id:
            hand.remember(request.id, answer)
        return answer

    def _find(self, asked: _Asked) -> int | None:
        request = asked.request
        if asked.slot is not None:
            return asked.slot if self._hands[asked.slot] is not None else None
        for slot, hand in enumerate(self._hands):
            if hand is None:
                continue
            if request.case == hand.lease.case.id or (not request.case and slot == request.slot):
                return slot
        return None

    def _nobody(self, request: ControlRequest) -> str:
        running = sorted(hand.lease.case.id for hand in self._hands if hand is not None)
        given = f"case '{request.case}'" if request.case else f"slot {request.slot}"
        return f"{given} does not run in this rig; running: {', '.join(running) or 'nothing'}"

    def _act(self, engine: Engine, slot: int, hand: Hand, action: Action) -> int:
        """Check, journal and apply an action; the object that it was done to, or -1.

        Raises:
            ValueError: it cannot be done; one line, and nothing has changed.
        """
        now_s, tick = time.monotonic(), int(engine.tick[slot])
        parts = parts_of(action)
        for part in parts:
            self._check(engine, slot, hand, part)
        if isinstance(action, GiveBack) and hand.drive is None:
            hand.heard_s = now_s
            return -1
        again = isinstance(action, Takeover) and hand.drive is not None
        if action == hand.drive:
            hand.heard_s = hand.drive_s = now_s  # the same pedals again: it is still there
            return -1
        if steers(action) and not hand.replayed:
            found = self._journalled(engine, slot, hand, [part for part in parts if steers(part)])
        else:
            found = max(self._apply(engine, slot, part) for part in parts)
        for part in parts:
            hand.take(part, tick, now_s)
        self._sort(slot, hand)
        if not isinstance(action, Query) and not again:
            hand.note = Touch(tick, told(action), hand.changes)
            self._tell(slot, hand)
        return found

    def _check(self, engine: Engine, slot: int, hand: Hand, action: Action) -> None:
        """Refuse what cannot be done before any of it is.

        Raises:
            ValueError: one line.
        """
        match action:
            case Pause() | Step() | SetPace() if hand.clocked:
                raise ValueError("clock realtime: the case goes with the wall clock, nobody else's")
            case SetEnvironment():
                engine.check_environment(slot, action)
            case SetSensors(errors):
                if mistake := engine.sensors_mistake(errors):
                    raise ValueError(mistake)

    def _apply(self, engine: Engine, slot: int, action: Action) -> int:
        match action:
            case SetEnvironment():
                engine.set_environment(slot, action)
            case PlaceEgo():
                engine.place_ego(slot, action)
            case MoveObject() | SpawnObject() | RemoveObject() | FreeObject():
                return engine.move_object(slot, action)
        return -1

    def _journalled(self, engine: Engine, slot: int, hand: Hand, actions: Sequence[Action]) -> int:
        """Apply actions that have a place in the journal, or neither do nor write anything.

        Several are settings that were checked, so that none of them can be refused any more.
        """
        journal = open_ = self._journals.get(slot)
        try:
            if open_ is None:
                open_ = SteeringJournal(hand.lease, len(self._slots), self._device)
            open_.add(int(engine.tick[slot]), int(engine.sim_time_ns[slot]), actions)
            found = max(self._apply(engine, slot, action) for action in actions)
        except TwinError as error:
            if journal is None and open_ is not None:
                open_.discard()
            raise ValueError(f"it cannot be journalled: {error}") from None
        except ValueError:
            if journal is None:
                open_.discard()
            else:
                open_.take_back()
            raise
        self._journals[slot] = open_
        return found

    def _sort(self, slot: int, hand: Hand) -> None:
        (self._timed.add if hand.timed or slot in self.parked else self._timed.discard)(slot)
        (self._commanding.add if hand.commands else self._commanding.discard)(slot)

    # --- time -------------------------------------------------------------------------------

    def _replay(self, engine: Engine, slot: int) -> None:
        hand = self._hands[slot]
        while hand is not None and hand.replay and hand.replay[0].tick <= engine.tick[slot]:
            self._act(engine, slot, hand, hand.replay.pop(0).action)

    def _overdue(self, engine: Engine, slot: int) -> None:
        hand = self._hands[slot]
        if hand is not None and (action := hand.overdue(time.monotonic())) is not None:
            # What cannot be journalled is not done; it is tried again before the next tick.
            with contextlib.suppress(ValueError):
                self._act(engine, slot, hand, action)

    def _move_on(self, engine: Engine) -> None:
        """Hold slots that may not run; those that may go on once all sensors are due together."""
        now_s, period_s = time.monotonic(), engine.control_period_ns / 1e9
        for slot in sorted(self._timed):
            hand, occupant = self._hands[slot], self._slots[slot]
            if hand is None:
                continue
            runs = hand.wait_s(int(engine.tick[slot]), period_s, now_s) <= 0.0
            if not runs and occupant is not None:
                engine.hold(slot)
                self.parked[slot] = occupant
                self._slots[slot] = None
            elif runs and slot in self.parked and _in_phase(engine, slot):
                engine.go_on(slot)
                self._slots[slot] = self.parked.pop(slot)
                self._sort(slot, hand)

    def _state(self, engine: Engine, slot: int, hand: Hand, *, whole: bool) -> HandState:
        row, case = engine.state[slot], hand.lease.case

        def value(name: str) -> float:
            return float(row[COLUMN[name]])

        return HandState(
            campaign=case.campaign,
            case=case.id,
            attempt=hand.lease.attempt,
            token=hand.lease.token,
            rig=self._rig,
            slot=slot,
            tick=int(engine.tick[slot]),
            sim_time_ns=int(engine.sim_time_ns[slot]),
            paused=hand.paused,
            taken_over=hand.drive is not None,
            pace=hand.pace,
            changes=hand.changes,
            weather=engine.weather(slot),
            time_of_day_min=engine.clock_min(slot),
            x_m=value("x_m"),
            y_m=value("y_m"),
            yaw_rad=value("yaw_rad"),
            speed_mps=value("speed_mps"),
            throttle=value("throttle"),
            brake=value("brake"),
            steering_rad=value("steering_rad"),
            objects=engine.objects(slot)[:OBJECTS_SHOWN_MAX] if whole else [],
        )


def _in_phase(engine: Engine, slot: int) -> bool:
    """Active slots are always due for their sensors together."""
    active = engine.tick[engine.active]
    every = engine.refill_every
    return not len(active) or bool((active[0] - engine.tick[slot]) % every == 0)


def _refusal(error: str) -> bytes:
    return encode(ControlReply(v=SCHEMA_VERSION, error=error))
