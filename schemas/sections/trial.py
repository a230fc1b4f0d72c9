"""The key ``trial`` of a scenario: what one run must fulfil, and what makes it count at all.

A rulebook gives each of its rows one (:mod:`schemas.sections.rulebook`); a campaign without a
rulebook may give one to all of its cases.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]
"""Two numbers: a range, or a row of a table."""
_Kmh = Annotated[float, Meta(ge=0, le=400)]


class Trial(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Criterion of a run, and preconditions without which the run is inconclusive."""

    row: Annotated[str, Meta(max_length=64)] = ""
    """Row of the rulebook that gave it; filled in where cases are made."""
    written: dict[str, float] = {}
    """Axes of which this repetition has other values than its row, with those of the row; filled in
    where cases are made."""
    rule: Literal["avoid", "limit", "no_reaction", "warn"]
    """``avoid``: a run is avoided, mitigated or not mitigated. ``limit``: it passes up to a
    relative impact speed. ``no_reaction``: it passes if the stack lets the ego go on. ``warn``: it
    passes if the stack warns in time."""
    target: Annotated[str, Meta(max_length=128)] = ""
    """Actor of the scenario file that the test is about; empty: its first."""
    impact_kmh_max: _Kmh = 0.0
    """``limit`` without a table: largest relative impact speed that passes [km/h]."""
    impact_kmh: list[Pair] = []
    """``limit`` by a table: speeds in rising order, each with its largest relative impact speed;
    between two of them the next higher one holds [km/h]."""
    table_speed: Literal["subject", "relative"] = "subject"
    """Speed that the table is read at: the ego's, or that relative to the target; as planned."""
    speed_number: str = "ego.speed_kmh"
    """Number of the scenario file that is the planned speed of the ego, where `speed_kmh` is not
    given; in m/s if its name ends in `_mps`, else in km/h."""
    speed_kmh: _Kmh | None = None
    """Planned speed of the ego; not given: what the row sets `speed_number` to [km/h]."""
    target_speed_number: str = ""
    """Number that is the planned speed of the target in the ego's direction, like
    `speed_number`."""
    target_speed_kmh: float | None = None
    """Planned speed of the target in the ego's direction; not given: that of
    `target_speed_number`, or 0 [km/h]."""
    speed_tolerance_kmh: Pair = field(default_factory=lambda: [-1.0, 1.0])
    """Most by which the ego may be slower (below 0) and faster than planned when the test begins
    [km/h]."""
    lateral_m: float = 0.0
    """Planned offset of the target's middle to the left of the ego's when they would meet [m]."""
    lateral_tolerance_m: Annotated[float, Meta(gt=0)] | None = None
    """Most by which that offset may be another when the stack acts, or just before a contact, as
    both move then; for targets that move steadily from the begin of the test on. Not given: not
    looked at [m]."""
    yaw_rate_tolerance_degps: Annotated[float, Meta(gt=0)] | None = None
    """Most by which the ego may turn, to either side, from `straight_s` before the test on until
    the stack acts; not given: not looked at [deg/s]."""
    straight_s: Annotated[float, Meta(ge=0, le=60)] = 0.0
    """The ego must have been driven for so long before the test begins [s]."""
    light_lux_min: Annotated[float, Meta(ge=0)] | None = None
    """Least light at the ground; not given: not looked at [lx]."""
    friction_min: Annotated[float, Meta(gt=0, le=2)] | None = None
    """Least peak braking coefficient of the road; not given: not looked at [-]."""
    begins_ttc_s: Annotated[float, Meta(gt=0, le=60)] = 4.0
    """Time to collision at which the test begins, longitudinal distance over longitudinal relative
    speed. If a case begins nearer than this, the test begins with the case [s]."""
    reaction_mps2: Annotated[float, Meta(gt=0, le=20)] = 1.0
    """``no_reaction``: deceleration from which on the stack has reacted [m/s2]."""
    reduced_kmh: Annotated[float, Meta(ge=0, le=400)] = 5.0
    """``avoid``: a contact that is slower than the test began by at least this is mitigated. Our
    own number [km/h]."""
    warn_before_braking_s: Annotated[float, Meta(ge=0, le=60)] | None = None
    """``warn``: least time from the warning to the stack's braking; not given: not looked at
    [s]."""
    warn_ttc_s: Annotated[float, Meta(ge=0, le=60)] | None = None
    """``warn``: least time to collision at the warning; not given: not looked at [s]."""

    def __post_init__(self) -> None:
        low, high = self.speed_tolerance_kmh
        if not low <= 0.0 <= high:
            raise ValueError("speed_tolerance_kmh: give [least, most] with 0 between them")
        speeds = [pair[0] for pair in self.impact_kmh]
        if speeds != sorted(set(speeds)):
            raise ValueError("impact_kmh: its speeds must rise, each listed once")
        if any(value < 0.0 for pair in self.impact_kmh for value in pair):
            raise ValueError("impact_kmh: no speed is below 0")
        if self.rule != "limit" and (self.impact_kmh or self.impact_kmh_max):
            raise ValueError(
                f"impact_kmh and impact_kmh_max belong to rule limit, and this is {self.rule}"
            )

    @property
    def closing_kmh(self) -> float | None:
        """Planned speed relative to the target [km/h]; None: the ego's is not planned."""
        return None if self.speed_kmh is None else self.speed_kmh - (self.target_speed_kmh or 0.0)

    def limit_kmh(self) -> float:
        """Largest relative impact speed that passes [km/h]: of the first speed of the table that is
        at least the planned one, of its last where none is."""
        if not self.impact_kmh:
            return self.impact_kmh_max
        speed = self.speed_kmh if self.table_speed == "subject" else self.closing_kmh
        listed = (limit for at, limit in self.impact_kmh if speed is not None and at >= speed)
        return next(listed, self.impact_kmh[-1][1])


def in_kmh(name: str, value: float) -> float:
    """A number of a scenario file as a speed [km/h]; by its name it is in m/s or in km/h."""
    return value * 3.6 if name.endswith("_mps") else value
