"""Profile of a simulator's loop, written beside it for `twin bench campaign`."""

from __future__ import annotations

import os
import time
from array import array
from pathlib import Path

import numpy as np
from msgspec import Struct, json

from schemas.messages import Commands
from twin.base.files import write_atomic
from twin.base.stopwatch import Stopwatch

FOLDER_VARIABLE = "TWIN_PROFILE"
"""Environment variable: folder in which every simulator keeps a file; not set: none is written."""

WRITE_S = 0.25
"""How often the file is written anew: simulators are ended by SIGKILL [s]."""

ROUND_TRIPS_MAX = 200_000
"""Most round trips remembered; later ones are left out."""


QUARTERS = 4
"""Ticks are told apart by the quarter of the slots that had a case."""


class Quarter(Struct, frozen=True):
    """The ticks of one quarter of use: above 0 to 25 % of the slots, to 50 %, to 75 %, to all."""

    ticks: int
    slot_ticks: int
    """Sum over these ticks of the slots that had a case."""
    seconds: dict[str, float]
    """Seconds of these ticks by name, as in :attr:`LoopProfile.seconds`."""


class LoopProfile(Struct, frozen=True):
    """Profile of a simulator process so far. Times are wall clock on the host's monotonic clock."""

    rig: str
    device: str
    slots: int
    transport: str
    """How pictures reach the stack: ``device``, ``memory``, ``bytes`` or ``inline``."""
    ticks: int
    sim_s: float
    """Sum over the slots [s]."""
    frames: int
    """Pictures rendered."""
    unread: list[str]
    """Messages of cameras, lidars and radars that the stack does not look at."""
    period_s: float
    """Control period [s]."""
    begun_s: float
    """Time at which the process began [s]."""
    first_tick_s: float
    """Time at which the first tick began [s]."""
    last_tick_s: float
    """Time at which the last tick ended [s]."""
    full_s: float
    """Last time at which more than half of the slots had a case [s]."""
    seconds: dict[str, float]
    """Where the loop's time went, by name [s]; sums to that from the first tick to the last."""
    round_trip_p50_ms: float
    round_trip_p99_ms: float
    quarters: list[Quarter]


class LoopLog:
    """Gathers a :class:`LoopProfile`; costs a few microseconds per tick."""

    def __init__(self, rig: str, device: str, slots: int) -> None:
        folder = os.environ.get(FOLDER_VARIABLE, "")
        self.watch = Stopwatch()
        self.transport = ""
        self.unread: list[str] = []
        self._path = Path(folder) / f"{rig}.json" if folder else None
        self._rig, self._device, self._slots = rig, device, slots
        self._begun_s = time.monotonic()
        self._first_s = self._last_s = self._full_s = 0.0
        self._written_s = 0.0
        self._ticks = self._frames = 0
        self._sim_ns = self._period_ns = 0
        self._round_trips = array("d")
        self._counted: dict[str, float] = {}
        """Laps up to the last tick: what comes after it is no part of the loop."""
        self._quarters = [Quarter(0, 0, {})] * QUARTERS

    def begin_tick(self) -> None:
        """A tick begins; what passed before the first is not part of the loop."""
        if not self._ticks:
            self._first_s = time.monotonic()
            self.watch.seconds.clear()

    def exchanged(self, answer: Commands) -> None:
        """The stack has answered: the lap is split into its share and the transport."""
        # Networks of a GPU run side by side: their times may add up to more than passed.
        costs_s = sum(cost.wall_s for cost in answer.costs if cost is not None)
        inference_s = min(costs_s, answer.wall_s)
        shares = {"inference": inference_s, "stack": answer.wall_s - inference_s}
        whole_s = self.watch.lap_with("transport", shares)
        if len(self._round_trips) < ROUND_TRIPS_MAX:
            self._round_trips.append(whole_s)

    def end_tick(self, active: int, frames: int, period_ns: int) -> None:
        """A tick of ``active`` slots has ended, ``frames`` pictures were rendered in it."""
        self._last_s = time.monotonic()
        laps = dict(self.watch.seconds)
        index = max(0, -(-QUARTERS * active // self._slots) - 1)
        had = self._quarters[index]
        seconds = {
            name: had.seconds.get(name, 0.0) + spent_s - self._counted.get(name, 0.0)
            for name, spent_s in laps.items()
        }
        self._quarters[index] = Quarter(had.ticks + 1, had.slot_ticks + active, seconds)
        self._counted = laps
        self._ticks += 1
        self._frames += frames
        self._sim_ns += active * period_ns
        self._period_ns = period_ns
        if 2 * active > self._slots:
            self._full_s = self._last_s

    def write(self, *, now: bool = False) -> None:
        """Write the file, at most every :data:`WRITE_S` unless it must be ``now``."""
        now_s = time.monotonic()
        if self._path is None or not self._ticks or (now_s - self._written_s < WRITE_S and not now):
            return
        self._written_s = now_s
        write_atomic(self._path, json.encode(self.profile()), sync=False)

    def profile(self) -> LoopProfile:
        """All of it so far."""
        trips_ms = 1e3 * np.array(self._round_trips or [0.0])
        return LoopProfile(
            rig=self._rig,
            device=self._device,
            slots=self._slots,
            transport=self.transport,
            ticks=self._ticks,
            sim_s=self._sim_ns / 1e9,
            frames=self._frames,
            unread=self.unread,
            period_s=self._period_ns / 1e9,
            begun_s=self._begun_s,
            first_tick_s=self._first_s,
            last_tick_s=self._last_s,
            full_s=self._full_s,
            seconds=self._counted,
            round_trip_p50_ms=float(np.percentile(trips_ms, 50)),
            round_trip_p99_ms=float(np.percentile(trips_ms, 99)),
            quarters=list(self._quarters),
        )
