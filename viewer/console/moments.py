"""The decisive moment of a case, from its rows; no files and no clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

What = Literal["impact", "closest", "trigger", "end"]

COLUMNS = ("sim_time_ns", "collisions", "dtc_m", "nearest_m", "aeb")
"""Columns of the KPI rows that decide."""


@dataclass(frozen=True, slots=True)
class DecisiveMoment:
    """A time of a case, and what happens then."""

    sim_time_ns: int
    what: What

    def as_json(self) -> dict[str, float | str]:
        """DecisiveMoment for the page; ``t`` in seconds of sim time."""
        return {"t": self.sim_time_ns / 1e9, "what": self.what}


def decisive(
    times_ns: Sequence[int],
    collisions: Sequence[int | None],
    dtc_m: Sequence[float | None],
    nearest_m: Sequence[float | None],
    aeb: Sequence[bool | None],
) -> DecisiveMoment:
    """The first impact, else the closest approach to the target, else to anything, else the trigger
    of emergency braking, else the end.

    Args:
        times_ns: sim time of each row [ns].
        collisions: number of collisions so far.
        dtc_m: distance to collision [m]; None: nothing stands in the way.
        nearest_m: distance to the nearest hull of all [m].
        aeb: whether emergency braking is on.
    """
    for time_ns, count in zip(times_ns, collisions, strict=True):
        if count:
            return DecisiveMoment(time_ns, "impact")
    for distances in (dtc_m, nearest_m):
        near = [
            (distance, time_ns)
            for time_ns, distance in zip(times_ns, distances, strict=True)
            if distance is not None
        ]
        if near:
            return DecisiveMoment(min(near)[1], "closest")
    for time_ns, braking in zip(times_ns, aeb, strict=True):
        if braking:
            return DecisiveMoment(time_ns, "trigger")
    return DecisiveMoment(times_ns[-1] if times_ns else 0, "end")
