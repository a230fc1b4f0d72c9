"""What shows the slots of a rig: the view, no view, and a view that may fail."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING

from twin.fabric.bus import Respond
from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.rig.slot_listener import SlotListener
from twin.sensors.wanted import Wanted, together

if TYPE_CHECKING:
    from twin.rig.engine import Engine

Ask = Callable[[int, bytes, Respond], None]
"""Takes a viewer's request on the case of a slot, ``ask(slot, payload, respond)``, from any
thread."""


class View(SlotListener):
    """Listener that shows slots; every call returns at once."""

    endpoint = ""
    """Endpoint at which a recorder connects; empty: there is none to come."""

    def asks(self, ask: Ask) -> None:
        """Take the function that requests of viewers go to."""

    def label(self, slot: Slot, label: str) -> None:
        """What views say of a case in which somebody has intervened: ``paused``, ``by hand`` ...;
        again and again of one that stands still."""

    def turn_away(self) -> None:
        """Take no more requests of viewers."""

    def close(self, timeout_s: float) -> None:
        """Publish what waits and say that nothing follows; gives up after ``timeout_s`` [s]."""


class NoView(View):
    """A view that shows nothing."""


class GuardedView(View):
    """Passes on to a view until that fails, once: what shows a rig must not break it."""

    def __init__(self, view: View) -> None:
        self.endpoint = view.endpoint
        self._view = view

    def built(self, engine: Engine) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.built(engine))

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.started(slot))

    def wanted(self) -> Wanted:
        """See :class:`SlotListener`."""
        wanted: list[Wanted] = []
        self._try(lambda: wanted.append(self._view.wanted()))
        return together(wanted)

    def sensed(self, tick: RigTick) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.sensed(tick))

    def commanded(self, tick: RigTick) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.commanded(tick))

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.ended(slot, end))

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        self._try(lambda: self._view.withdrawn(slot))

    def asks(self, ask: Ask) -> None:
        """See :class:`View`."""
        self._try(lambda: self._view.asks(ask))

    def label(self, slot: Slot, label: str) -> None:
        """See :class:`View`."""
        self._try(lambda: self._view.label(slot, label))

    def turn_away(self) -> None:
        """See :class:`View`."""
        self._try(self._view.turn_away)

    def close(self, timeout_s: float) -> None:
        """See :class:`View`."""
        self._try(lambda: self._view.close(timeout_s))

    def _try(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception:
            traceback.print_exc()
            failed, self._view = self._view, NoView()
            # Nobody would cancel the keys of cases when these end, and the slots go to others.
            with contextlib.suppress(Exception):
                failed.turn_away()
