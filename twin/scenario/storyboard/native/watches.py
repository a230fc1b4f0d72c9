"""Sections of a scenario file: what events wait for."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct


class _Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class ValueRange(_Section, frozen=True, kw_only=True):
    """What a value must be: below a bound, above one, or between both."""

    below: Annotated[float, Meta(ge=-1e6, le=1e6)] | None = None
    """Upper bound, itself left out."""
    above: Annotated[float, Meta(ge=-1e6, le=1e6)] | None = None
    """Lower bound, itself left out."""

    def __post_init__(self) -> None:
        if self.below is None and self.above is None:
            raise ValueError("given neither below nor above")
        if self.below is not None and self.above is not None and self.above >= self.below:
            raise ValueError(f"above {self.above:g} must be less than below {self.below:g}")


class ScenarioSpot(_Section, frozen=True, kw_only=True):
    """A place on the road: along it by `s_m`, across it by one of the others."""

    s_m: Annotated[float, Meta(ge=0, le=1e5)]
    """Place along the road [m]."""
    lane: Annotated[int, Meta(ge=1, le=20)] | None = None
    """A lane, counted from the right; without any other place across the road: 1."""
    oncoming: bool = False
    """In the lanes of those who drive against s."""
    lateral_m: Annotated[float, Meta(ge=-100, le=100)] | None = None
    """So far to the left of the middle of the road [m]."""
    road: str = ""
    """Id or name of the road; not given: where the actor starts."""
    within_m: Annotated[float, Meta(gt=0, le=100)] = 2.0
    """How near counts as there [m]."""

    def __post_init__(self) -> None:
        if self.lane is not None and self.lateral_m is not None:
            raise ValueError("given lane and lateral_m, only one may be")


class ActorWatch(_Section, frozen=True, kw_only=True):
    """Conditions on the ego or an actor; all of those given must hold."""

    to: str = ""
    """Whom gaps, times and relative speeds are to; not given: the ego."""
    gap_m: ValueRange | None = None
    """Gap to `to` along the road, no matter who is ahead [m]."""
    lateral_gap_m: ValueRange | None = None
    """Gap to `to` across the road [m]."""
    distance_m: ValueRange | None = None
    """Shortest distance between both boxes [m]."""
    headway_s: ValueRange | None = None
    """The gap along the road divided by the own speed [s]."""
    ttc_s: ValueRange | None = None
    """Time to collision: the gap along the road divided by the closing speed [s]."""
    relative_speed_mps: ValueRange | None = None
    """Own speed less that of `to` [m/s]."""
    speed_mps: ValueRange | None = None
    """Own speed [m/s]."""
    acceleration_mps2: ValueRange | None = None
    """Own acceleration forwards [m/s2]."""
    travelled_m: Annotated[float, Meta(ge=0, le=1e6)] | None = None
    """Has moved so far since the start [m]."""
    stands_s: Annotated[float, Meta(ge=0, le=3600)] | None = None
    """Has been standing for so long [s]."""
    touches: str = ""
    """Touches this actor, the ego, or `any`."""
    reaches: ScenarioSpot | None = None
    """Is there."""

    def __post_init__(self) -> None:
        rest = [
            n for n in self.__struct_fields__ if n != "to" and getattr(self, n) not in (None, "")
        ]
        if not rest:
            names = ", ".join(n for n in self.__struct_fields__ if n != "to")
            raise ValueError(f"nothing to wait for; give one of {names}")


RELATIVE = (
    "gap_m",
    "lateral_gap_m",
    "distance_m",
    "headway_s",
    "ttc_s",
    "relative_speed_mps",
)
"""Fields of :class:`ActorWatch` that are about two."""
RangeName = Literal[
    "gap_m",
    "lateral_gap_m",
    "distance_m",
    "headway_s",
    "ttc_s",
    "relative_speed_mps",
    "speed_mps",
    "acceleration_mps2",
]
