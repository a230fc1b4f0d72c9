"""What hears of the slots of a rig: interventions, view, recorder, logs and results."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.sensors.wanted import NOTHING, Wanted, together

if TYPE_CHECKING:
    from twin.rig.engine import Engine


class SlotListener:
    """Events of a rig's slots, in the order in which they happen; who needs one overrides it."""

    def built(self, engine: Engine) -> None:
        """The engine of the rig is ready, and the stack connected."""

    def started(self, slot: Slot) -> None:
        """A case begins."""

    def wanted(self) -> Wanted:
        """Sensor messages of the tick that is about to be sensed that it will look at."""
        return NOTHING

    def sensed(self, tick: RigTick) -> None:
        """The readings of a tick are there, and the stack is about to be asked."""

    def commanded(self, tick: RigTick) -> None:
        """The stack has answered, and the engine is about to step."""

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """A case has ended; listeners add to ``end`` what others need."""

    def withdrawn(self, slot: Slot) -> None:
        """A case is no longer wanted."""


class SlotListeners(SlotListener):
    """Several listeners, told one after the other in the order in which they are given."""

    def __init__(self, listeners: Iterable[SlotListener]) -> None:
        self._listeners = tuple(listeners)

    def built(self, engine: Engine) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.built(engine)

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.started(slot)

    def wanted(self) -> Wanted:
        """What any of them will look at."""
        return together(listener.wanted() for listener in self._listeners)

    def sensed(self, tick: RigTick) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.sensed(tick)

    def commanded(self, tick: RigTick) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.commanded(tick)

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.ended(slot, end)

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        for listener in self._listeners:
            listener.withdrawn(slot)
