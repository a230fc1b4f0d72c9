"""The loop over the slots of a rig, whoever drives them: a stack on the bus, or a learner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from schemas.messages import Command
from schemas.wire.control import Lease
from schemas.wire.interventions import RecordedAction
from twin.rig.need_to_know import as_told
from twin.rig.slot import Finished, Slot, Slots
from twin.sensors.data import SensorData
from twin.sensors.wanted import Wanted

if TYPE_CHECKING:
    from twin.rig.engine import Engine


class RigLoop:
    """Engine and slots in step: cases begin, are sensed, are commanded and end in both at once.

    A turn is :meth:`begin` for every free slot that has a case, where :attr:`is_due` allows it,
    then :meth:`sense`, then :meth:`step`.
    """

    def __init__(self, engine: Engine, slots: Slots) -> None:
        """Begin without cases.

        Args:
            engine: of the rig.
            slots: of the rig, as many as the engine has.
        """
        self.engine = engine
        self.slots = slots

    @property
    def is_due(self) -> bool:
        """Whether cases may begin now: all sensors are due for all that run."""
        running = self.slots.running
        tick = self.engine.tick
        return not running or tick[running[0].index] % self.engine.refill_every == 0

    def begin(
        self,
        index: int,
        lease: Lease,
        clock: Callable[[], float],
        replay: Sequence[RecordedAction] = (),
    ) -> Slot:
        """A case begins in a free slot, where :attr:`is_due` allows it.

        Args:
            index: of the slot.
            lease: of the attempt.
            clock: the time [s] at which the slot has taken the attempt, asked when it has.
            replay: actions from the journal of an earlier attempt, to be repeated.

        Raises:
            ValueError: the case cannot be simulated here; one line.
        """
        self.engine.reset(index, lease.case)
        slot = Slot(index, lease, clock(), list(replay))
        self.slots.take(slot)
        return slot

    def sense(self, wanted: Wanted) -> tuple[dict[str, SensorData], dict[str, SensorData]]:
        """Readings of the current ticks that are due and wanted, by sensor message: as they are,
        and as far as whoever drives may know them."""
        sensed = self.engine.sense(wanted)
        cases = [None if slot is None else slot.lease.case for slot in self.slots.by_index]
        return sensed, as_told(sensed, cases)

    def step(self, commands: list[Command | None]) -> list[Finished]:
        """One control period with these commands, by slot; the cases that have ended. Their slots
        are free when :meth:`leave` was called."""
        return self.engine.step(commands)

    def leave(self, index: int) -> Slot:
        """The case of a slot has ended: the slot is free."""
        slot = self.slots[index]
        assert slot is not None, f"slot {index} is free already"
        self.slots.leave(slot)
        return slot

    def withdraw(self, slot: Slot) -> None:
        """The case of a slot is no longer wanted: the slot is free."""
        self.engine.clear(slot.index)
        self.slots.leave(slot)
