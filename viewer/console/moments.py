"""The decisive moment of a case, from its rows; no files and no clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

What = Literal["impact", "closest", "trigger", "end"]

COLUMNS = ("sim_time_ns", "collisions", "dtc_m", "nearest_m", "aeb")
"""Columns of the KPI rows that decide."""
BRAKED_FALSELY = frozenset({"false_braking", "false_reaction"})
"""Verdicts that the braking itself decided."""


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
    verdict: str = "",
) -> DecisiveMoment:
    """The first impact, else the closest approach to the target, else to anything, else the trigger
    of emergency braking, else the end. A trigger comes before any approach where the verdict is of
    :data:`BRAKED_FALSELY`: the ego is nearest when it has come to rest, and the cause is past.

    Args:
        times_ns: sim time of each row [ns].
        collisions: number of collisions so far.
        dtc_m: distance to collision [m]; None: nothing stands in the way.
        nearest_m: distance to the nearest hull of all [m].
        aeb: whether emergency braking is on.
        verdict: of the case; empty: none yet.
    """
    for time_ns, count in zip(times_ns, collisions, strict=True):
        if count:
            return DecisiveMoment(time_ns, "impact")
    braked_ns = (time_ns for time_ns, on in zip(times_ns, aeb, strict=True) if on)
    trigger_ns = next(braked_ns, None)
    if trigger_ns is not None and verdict in BRAKED_FALSELY:
        return DecisiveMoment(trigger_ns, "trigger")
    for distances in (dtc_m, nearest_m):
        near = [
            (distance, time_ns)
            for time_ns, distance in zip(times_ns, distances, strict=True)
            if distance is not None
        ]
        if near:
            return DecisiveMoment(min(near)[1], "closest")
    if trigger_ns is not None:
        return DecisiveMoment(trigger_ns, "trigger")
    return DecisiveMoment(times_ns[-1] if times_ns else 0, "end")
