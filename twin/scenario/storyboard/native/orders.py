"""Sections of a scenario file: what actors do in an event."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from twin.scenario.storyboard.native.watches import ScenarioSpot

POINTS_MAX = 200
"""Most points of a path."""

Lamp = Literal["off", "on", "flash"]
Acceleration = Annotated[float, Meta(gt=0, le=100)]
Point = Annotated[list[Annotated[float, Meta(ge=-1e5, le=1e5)]], Meta(min_length=2, max_length=2)]


class _Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class ArriveOrder(_Section, frozen=True, kw_only=True):
    """Arrive somewhere at the moment when somebody else arrives: where both ways cross.

    Its acceleration follows from what is left of both ways, anew in each step. It is constant as
    long as the other one keeps its speed; with a `speed_mps` of arrival it changes once.
    """

    meet: str = "ego"
    """The other one: the ego or an actor."""
    at: ScenarioSpot | None = None
    """Where the actor arrives; not given: where its way first crosses the other's."""
    meet_at: ScenarioSpot | None = None
    """Where the other one arrives then; given together with `at`."""
    meet_after_m: Annotated[float, Meta(gt=0, le=1e5)] | None = None
    """In place of `meet_at`: so far along its `curve` the origin of the other one is then [m]."""
    speed_mps: Annotated[float, Meta(ge=0, le=100)] | None = None
    """Own speed on arrival [m/s]; not given: whatever it takes."""
    steady_m: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """So far before it arrives it has that speed already, and keeps it [m]."""

    def __post_init__(self) -> None:
        if self.meet_at is not None and self.meet_after_m is not None:
            raise ValueError("given meet_at and meet_after_m: give one")
        others = self.meet_at is None and self.meet_after_m is None
        if (self.at is None) != others:
            key = "meet_at" if self.meet_after_m is None else "meet_after_m"
            raise ValueError(f"at and {key} belong together: give both or none")
        if self.steady_m and self.speed_mps is None:
            raise ValueError("steady_m needs a speed_mps of arrival")


class KeepOrder(_Section, frozen=True, kw_only=True):
    """Keep a gap to another one, for ever."""

    to: str = "ego"
    """The other one: the ego or an actor."""
    gap_m: Annotated[float, Meta(ge=0, le=1000)] | None = None
    """Gap along the road [m]."""
    gap_s: Annotated[float, Meta(gt=0, le=60)] | None = None
    """The same as a time, at the other one's speed [s]."""
    side: Literal["ahead", "behind"] = "behind"
    """On which side of the other one."""
    acceleration_mps2: Acceleration = 3.0
    """Highest acceleration [m/s2]."""
    deceleration_mps2: Acceleration = 6.0
    """Highest deceleration [m/s2]."""

    def __post_init__(self) -> None:
        if (self.gap_m is None) == (self.gap_s is None):
            raise ValueError("give either gap_m or gap_s")


class LampOrders(_Section, frozen=True, kw_only=True):
    """Lamps of a vehicle; what is not given stays as it is. As long as nothing is said of them, the
    brake lamps follow the deceleration, reversing lamps are on backwards, and the low beam by
    night."""

    brake: Lamp | None = None
    indicator_left: Lamp | None = None
    indicator_right: Lamp | None = None
    warning: Lamp | None = None
    """Both indicators."""
    low_beam: Lamp | None = None
    high_beam: Lamp | None = None
    reversing: Lamp | None = None
    fog_front: Lamp | None = None
    fog_rear: Lamp | None = None
    daytime: Lamp | None = None
    """Daytime running lamps."""


class ActorOrders(_Section, frozen=True, kw_only=True):
    """What one actor does; `in_s`, `over_m` and `shape` say how it changes speed or lane."""

    speed_mps: Annotated[float, Meta(ge=0, le=100)] | None = None
    """Change to this speed [m/s]; by 3 m/s2 if nothing else is said. With `arrive`: the speed with
    which it sets off, at once."""
    stop: bool = False
    """Change to speed 0."""
    at_mps2: Acceleration | None = None
    """Acceleration or deceleration of a change of speed; the peak one of a curved shape [m/s2]."""
    in_s: Annotated[float, Meta(gt=0, le=600)] | None = None
    """How long the change takes [s]; a change of lane or offset: 4 if nothing else is said."""
    over_m: Annotated[float, Meta(gt=0, le=1e4)] | None = None
    """The way during which it takes place [m]."""
    shape: Literal["linear", "cubic", "sinusoidal", "step"] | None = None
    """Curve of the change; not given: linear for speeds, sinusoidal for lanes and offsets."""
    change_lane: Annotated[int, Meta(ge=1, le=20)] | Literal["left", "right"] | None = None
    """Change to this lane, counted from the right, or to the next on a side, seen by the actor."""
    offset_m: Annotated[float, Meta(ge=-20, le=20)] | None = None
    """Move to so far left of the lane's middle, as the actor sees it [m]."""
    cross_to: Literal["left", "right"] | None = None
    """Go straight across the road to the footway on that side, or 1 m beyond its outermost lane."""
    path: Annotated[list[Point], Meta(max_length=POINTS_MAX)] = field(default_factory=list)
    """Go along a line of points, each [place along the road, left of its middle], from where the
    actor is [m]."""
    at_end: Literal["stop", "go_on"] = "stop"
    """After `cross_to` or `path`: stop, or go on along the road."""
    turns: list[Literal["left", "straight", "right"]] = field(default_factory=list)
    """What it does at one junction after the other from now on."""
    arrive: ArriveOrder | None = None
    keep: KeepOrder | None = None
    behaviour: Literal["idm", "none"] | None = None
    """Hand over to the driver model (set up by the actor's `idm`), or take it back."""
    lamps: LampOrders | None = None
    visible: bool | None = None
    """Appear or vanish."""

    def __post_init__(self) -> None:
        speeds = [
            name
            for name, there in (
                ("speed_mps", self.speed_mps is not None),
                ("stop", self.stop),
                ("arrive", self.arrive is not None),
                ("keep", self.keep is not None),
            )
            if there
        ]
        if len(speeds) > 1 and speeds != ["speed_mps", "arrive"]:
            raise ValueError(f"given {' and '.join(speeds)}, which all change the speed: give one")
        sideways = [
            name
            for name in ("change_lane", "offset_m", "cross_to")
            if getattr(self, name) is not None
        ]
        sideways += ["path"] if self.path else []
        if len(sideways) > 1:
            raise ValueError(f"given {' and '.join(sideways)}, which all steer: give one")
        hows = [n for n in ("at_mps2", "in_s", "over_m") if getattr(self, n) is not None]
        changes_speed = self.speed_mps is not None or self.stop
        if changes_speed and len(hows) > 1:
            raise ValueError(f"given {' and '.join(hows)}: give one")
        if self.at_mps2 is not None and not changes_speed:
            raise ValueError("at_mps2 is of a change of speed: give speed_mps or stop")
        steers = self.change_lane is not None or self.offset_m is not None
        if (self.in_s is not None or self.over_m is not None) and not (changes_speed or steers):
            raise ValueError("in_s and over_m are of a change of speed, lane or offset: give one")
