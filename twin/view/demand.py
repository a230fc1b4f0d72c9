"""Viewers of a rig's cases, and what they are due: paced by the wall clock, at the source.

Streams are named as their sensor messages (``camera.front_left``, ``lidar.roof``, ``radar_cube``),
beside ``thumbnail`` for the wall, and ``start`` and ``state`` for those who look at a single case.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from schemas.kinds.sensor import pictured_kinds
from schemas.sections.view_mode import ViewMode
from schemas.wire import topics
from twin.fabric.bus import Bus
from twin.view.items import SlotRun

PERIODS_S = {"thumbnail": 0.5, "start": 1.0, "state": 0.1, "camera": 0.1, "lidar": 0.2}
"""Shortest wall time between two samples of a kind of stream of one case [s]."""

GRID_PERIOD_S = 0.5
"""The same of a sensor's grid that is drawn as a picture [s]."""

FOCUS_MAX = 8
"""Cases of a rig that are shown in full at the same time, at most; further ones stay small."""

NOTHING: frozenset[str] = frozenset()


class Demand:
    """Asks the bus who subscribes; used by the simulator's loop alone."""

    def __init__(self, bus: Bus, mode: ViewMode) -> None:
        self._bus = bus
        self._shows = mode.shows
        self._focused: set[int] = set()
        """Tokens of the cases that are shown in full."""
        self._begun_s: float | None = None
        """When the first thumbnail of all was due [s]; None: none was."""

    def wall(self) -> bool:
        """Whether somebody looks at the wall of all cases."""
        everything = topics.VIEW_THUMBNAIL.key.format(campaign="*", case="*")
        return self._shows and self._bus.wanted(everything)

    def small(self, run: SlotRun, now_s: float) -> bool:
        """Whether the wall is due a thumbnail of ``run``: its first one at once, then with those of
        all other cases of the rig. So a camera that nobody else looks at is read twice a second,
        however many cases there are."""
        return "thumbnail" not in run.shown_s or self._beat(now_s) > self._beat(
            run.shown_s["thumbnail"]
        )

    def _beat(self, at_s: float) -> int:
        """Whole periods since the first thumbnail of all."""
        # A hair early rather than a period late: sums of periods are not whole in floating point.
        return math.floor((at_s - (self._begun_s or 0.0)) / PERIODS_S["thumbnail"] + 1e-6)

    def singles(self) -> bool:
        """Whether somebody looks at some single case, not necessarily of this rig."""
        return self._shows and self._bus.wanted(topics.live_keys("*", "*"))

    def focused(self, run: SlotRun) -> bool:
        """Whether somebody looks at this case alone; ask only while :meth:`singles`."""
        token = run.lease.token
        if not self._bus.wanted(_keys(run)):
            self._focused.discard(token)
            return False
        if token not in self._focused and len(self._focused) >= FOCUS_MAX:
            return False
        self._focused.add(token)
        return True

    def due(
        self, run: SlotRun, sensed: Iterable[str], now_s: float, *, wall: bool, singles: bool
    ) -> frozenset[str]:
        """Streams of ``run`` that are due at ``now_s``, which count as sent.

        Args:
            run: the case.
            sensed: names of this tick's sensor messages.
            now_s: wall clock [s].
            wall: :meth:`wall` of this tick.
            singles: :meth:`singles` of this tick.
        """
        if not (wall or singles):
            return NOTHING
        names = set(sensed)
        due = set()
        blind = not run.lease.case.rig.seeing
        if wall and (blind or "camera" in names) and self.small(run, now_s):
            due.add("thumbnail")
            if self._begun_s is None:
                self._begun_s = now_s
        if singles and self.focused(run):
            shown = [n for n in names if n.partition(".")[0] in ("camera", "lidar")]
            shown += (kind.name for kind in pictured_kinds(names))
            due.update(n for n in shown if _elapsed(run, n, now_s) >= 1)
            # With its picture, so that boxes stand where they belong; without one, half as often.
            if "camera" in due or _elapsed(run, "state", now_s) >= (1 if blind else 2):
                due.add("state")
            if _elapsed(run, "start", now_s) >= 1:
                due.add("start")  # again and again: who comes later knows the case from the next
        for name in due:
            run.shown_s[name] = now_s
        return frozenset(due)

    def ended(self, run: SlotRun) -> bool:
        """The case of ``run`` has ended; whether somebody looked at it alone."""
        live = self.singles() and self.focused(run)
        self._focused.discard(run.lease.token)
        self._bus.release(_keys(run))
        return live


def _keys(run: SlotRun) -> str:
    case = run.lease.case
    return topics.live_keys(case.variation.campaign, case.id)


def _elapsed(run: SlotRun, name: str, now_s: float) -> float:
    """Wall time since the stream was last due, in its periods; infinite at first."""
    if name not in run.shown_s:
        return float("inf")
    return (now_s - run.shown_s[name]) / PERIODS_S.get(name.partition(".")[0], GRID_PERIOD_S)
