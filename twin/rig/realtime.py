"""The drive plane by the wall clock: nothing waits for the stack.

One message is with the stack at a time: while it is busy with one, later readings take the place of
earlier ones, and the newest of each sensor goes out at the first tick at which it is free. So any
stack of the lockstep works here, and its frames never queue up. The last command is held.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from msgspec import structs

from schemas.messages import Commands, Episode, Tick
from twin.fabric.drive import LOOK_S, RESEND_S, Outgoing, SimulatorEnd
from twin.rig.pacing import Paced, Pacer, TickLog
from twin.rig.slot import Slot, SlotEnd
from twin.rig.slot_listener import SlotListener


@dataclass(slots=True)
class _Sent:
    """The message that the stack is busy with."""

    tick: Tick
    sensors: list[Outgoing]
    oldest: int
    """Tick of the oldest reading in it."""
    at_s: float


class RealtimeLink(SlotListener):
    """Stands where :class:`SimulatorEnd` stands in lockstep, for a rig of one slot."""

    def __init__(
        self, end: SimulatorEnd, period_ns: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin without a case.

        Args:
            end: the simulator's end of the drive plane.
            period_ns: of control [ns].
            clock: the wall clock [s].
        """
        self._end = end
        self._period_ns = period_ns
        self._clock = clock
        self._pacer = Pacer(period_ns / 1e9, clock())
        self._log = TickLog(period_ns)
        self._begun_s = 0.0
        """Time at which the last tick began [s]."""
        self._mail: dict[str, tuple[int, Outgoing]] = {}
        """Readings that the stack has not got, with their ticks."""
        self._sent: _Sent | None = None
        self._held: Commands | None = None
        self._held_tick = 0
        """Case tick that the held command names."""
        self._answers = 0
        """Tick of the oldest reading that it answers."""

    def exchange(
        self,
        seq: int,
        tick: Tick,
        sensors: list[Outgoing],
        episodes: list[Episode],
        on_wait: Callable[[], None],
    ) -> Commands:
        """Wait until the tick is due, and return the command in force.

        The first tick of a case waits for the stack, which may have to load; then its clock starts.
        """
        if episodes:
            return self._begin(seq, tick, sensors, episodes, on_wait)
        now = tick.tick[0]
        for sensor in sensors:
            self._mail[sensor.name] = now, sensor
        now_s = self._clock()
        wait_s = self._pacer.reach(now, now_s)
        answer = self._collect(now_s + wait_s, on_wait)
        is_free = self._sent is None
        if is_free:
            self._give(seq, tick)
        elif self._sent is not None and self._clock() - self._sent.at_s >= RESEND_S:
            self._end.publish(self._sent.tick, self._sent.sensors, [])
            self._sent.at_s = self._clock()
        late_s = max(0.0, -wait_s)
        self._begun_s = self._clock()
        self._log.add(now, late_s, self._answers, new=answer is not None, given=is_free)
        return self._command(seq, now, answer)

    def finish(self) -> Paced:
        """How the case went by the wall clock, which has come to its end."""
        return Paced(self._log.summary(self._pacer, self._begun_s), self._log.csv())

    def ended(self, slot: Slot, end: SlotEnd) -> None:  # noqa: ARG002
        """See :class:`SlotListener`: how the case went by the wall clock."""
        paced = end.paced = self.finish()
        reasons = [*end.finished.reasons, paced.summary.told()]
        end.finished = replace(end.finished, reasons=reasons)

    def _begin(
        self,
        seq: int,
        tick: Tick,
        sensors: list[Outgoing],
        episodes: list[Episode],
        on_wait: Callable[[], None],
    ) -> Commands:
        self._mail, self._sent = {}, None
        answer = self._end.exchange(seq, tick, sensors, episodes, on_wait)
        self._held, self._held_tick, self._answers = answer, tick.tick[0], tick.tick[0]
        self._begun_s = self._clock()
        self._pacer = Pacer(self._period_ns / 1e9, self._begun_s)
        self._log = TickLog(self._period_ns)
        return answer

    def _collect(self, due_s: float, on_wait: Callable[[], None]) -> Commands | None:
        """Wait until then; the answer that came meanwhile."""
        answer = None
        while True:
            left_s = due_s - self._clock()
            seq = None if self._sent is None else self._sent.tick.seq
            commands = self._end.answered(seq, min(LOOK_S, max(0.0, left_s)))
            if commands is not None:
                assert self._sent is not None, "nothing else was asked for"
                answer = self._held = commands
                self._held_tick, self._answers = self._sent.tick.tick[0], self._sent.oldest
                self._sent = None
            on_wait()
            if self._clock() >= due_s:
                return answer

    def _give(self, seq: int, tick: Tick) -> None:
        """Everything that the stack has not got yet."""
        sensors = [
            Outgoing(name, structs.replace(sensor.frame, seq=seq), sensor.payload)
            for name, (_, sensor) in self._mail.items()
        ]
        oldest = min((sensed for sensed, _ in self._mail.values()), default=tick.tick[0])
        message = structs.replace(tick, sensors=list(self._mail))
        self._mail = {}
        self._end.publish(message, sensors, [])
        self._sent = _Sent(message, sensors, oldest, self._clock())

    def _command(self, seq: int, now: int, answer: Commands | None) -> Commands:
        """The command in force, as if it were given for this tick; a wrong tick stays wrong."""
        assert self._held is not None, "the first tick of a case names it"
        later = now - self._held_tick
        commands = [structs.replace(c, tick=c.tick + later) for c in self._held.commands]
        costs = [] if answer is None else self._held.costs
        return structs.replace(self._held, seq=seq, commands=commands, costs=costs, wall_s=0.0)
