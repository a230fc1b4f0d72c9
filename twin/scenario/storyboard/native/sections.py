"""The YAML format of scenarios written by hand: who is where, what happens when, when it ends.

Lengths are in metres, times in seconds, angles in degrees. A lane is counted from the right, as its
driver sees it: 1 is the rightmost lane of the direction of travel that is driven on. Left and right
of a road are as seen along it (along s). Where an actor is means the middle of its box, and
distances between actors are gaps between their boxes.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from schemas.names import TimeOfDay, Weather
from twin.scenario.storyboard.native.orders import ActorOrders
from twin.scenario.storyboard.native.watches import ActorWatch, ScenarioSpot

ACTORS_MAX = 63
"""Most actors of a scenario, beside the ego."""
EVENTS_MAX = 256
"""Most events of a scenario."""
POSES_MAX = 20_000
"""Most poses of a recorded actor."""

ActorName = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,31}$")]
Station = Annotated[float, Meta(ge=0, le=1e5)]
Speed = Annotated[float, Meta(ge=0, le=100)]
Offset = Annotated[float, Meta(ge=-100, le=100)]
LaneNumber = Annotated[int, Meta(ge=1, le=20)]
SignalStateName = Literal["off", "red", "red_amber", "amber", "green"]
Side = Literal["left", "right"]
Turn = Literal["left", "straight", "right"]
Poses = Annotated[list[list[float]], Meta(max_length=POSES_MAX)]
"""Rows of time [s], x, y [m] and heading [deg] in the world of the road file; see
:mod:`twin.scenario.storyboard.native.recorded`."""
KindName = Literal[
    "car",
    "van",
    "truck",
    "trailer",
    "bus",
    "motorcycle",
    "bicycle",
    "pedestrian",
    "child",
    "animal",
    "obstacle",
]


class _Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class IdmSettings(_Section, frozen=True, kw_only=True):
    """The driver model ``behaviour: idm``: following by IDM, changing lanes by MOBIL.

    Treiber, Hennecke, Helbing 2000, Phys. Rev. E 62; Kesting, Treiber, Helbing 2007, TRR 1999.
    """

    desired_speed_mps: Annotated[float, Meta(gt=0, le=100)] | None = None
    """Speed on a free road [m/s]; not given: the speed at the start."""
    time_gap_s: Annotated[float, Meta(ge=0.1, le=10)] = 1.5
    """Time gap to the one ahead [s]."""
    gap_min_m: Annotated[float, Meta(ge=0, le=50)] = 2.0
    """Gap when both stand [m]."""
    acceleration_mps2: Annotated[float, Meta(gt=0, le=10)] = 1.4
    """Highest acceleration [m/s2]."""
    deceleration_mps2: Annotated[float, Meta(gt=0, le=10)] = 2.0
    """Comfortable deceleration [m/s2]."""
    changes_lanes: bool = True
    """False: it stays in its lane."""
    politeness: Annotated[float, Meta(ge=0, le=2)] = 0.3
    """Weight of what a lane change does to others [-]."""


class EgoStart(_Section, frozen=True, kw_only=True):
    """Where the ego begins."""

    lane: LaneNumber | None = None
    """Lane, counted from the right."""
    s_m: Station | None = None
    """Place along the road [m]."""
    poses: Poses | None = None
    """In place of both: where its origin (of vehicles with four wheels: the middle of the rear
    axle) was in a recorded drive, rows of time [s], x, y [m] and heading [deg]. A stack starts at
    the first; a robot (`scenario.driver`) drives all of them."""
    road: str = ""
    """Id or name of the road; not given: the first of the file."""
    oncoming: bool = False
    """In the lanes of those who drive against s."""
    offset_m: Offset = 0.0
    """To the left of the lane's middle, as its driver sees it [m]."""
    speed_mps: Speed = 0.0
    """Speed at the start [m/s]."""
    turns: list[Turn] = field(default_factory=list)
    """What it does at one junction after the other; not given: the straightest way."""
    curve: list[list[float]] | None = None
    """Line that its origin follows from the start, in pieces that each have a length and the
    curvature at their beginning and end, to the left positive [m, 1/m, 1/m]; then it goes on
    along the road."""
    behaviour: Literal["idm"] | None = None
    """Driver model that drives it as long as the scenario does, which is for a robot
    (`scenario.driver`); not given: it keeps its speed and lane."""
    idm: IdmSettings | None = None

    def __post_init__(self) -> None:
        if self.poses is not None:
            _poses_alone(self, ("lane", "s_m"))
        elif self.lane is None or self.s_m is None:
            raise ValueError("needed: lane and s_m, or the poses of a recorded drive")
        _curve_alone(self, ("turns", "behaviour"))
        _check_idm(self)


class ActorStart(_Section, frozen=True, kw_only=True):
    """An actor and where it begins: along the road, and across it."""

    kind: KindName
    """What it is: its size, weight and look."""
    lane: LaneNumber | None = None
    """Across: a lane, counted from the right."""
    footway: Side | None = None
    """Across: the middle of the footway on that side."""
    parked: Side | None = None
    """Across: the middle of the parking lane on that side."""
    shoulder: Side | None = None
    """Across: the middle of the shoulder on that side."""
    lateral_m: Offset | None = None
    """Across: so far to the left of the middle of the road, which is lane 0 [m]."""
    s_m: Station | None = None
    """Along: place along the road [m]."""
    ahead_m: Annotated[float, Meta(ge=0, le=5000)] | None = None
    """Along: gap ahead of `of`, in the direction in which that travels [m]."""
    ahead_s: Annotated[float, Meta(ge=0, le=600)] | None = None
    """Along: the same gap, so long that `of` needs this time for it, as both move at the start
    [s]."""
    behind_m: Annotated[float, Meta(ge=0, le=5000)] | None = None
    """Along: gap behind `of` [m]."""
    of: str = "ego"
    """Whom `ahead_m`, `ahead_s` and `behind_m` count from: the ego or an actor."""
    poses: Poses | None = None
    """In place of both parts: where the middle of its box was in a recorded drive, rows of time
    [s], x, y [m] and heading [deg]. It is there with the first and stays at the last; an event
    makes it `visible`."""
    towed_by: str = ""
    """Of a trailer: who tows it, the ego or an actor; it begins straight behind."""
    road: str = ""
    """Id or name of the road; not given: that of `of`, the first of the file with `s_m`."""
    oncoming: bool = False
    """In the lanes of those who drive against s; without a lane: faces against s."""
    offset_m: Offset = 0.0
    """To the left of that place, as the actor sees it [m]."""
    heading_deg: Annotated[float, Meta(ge=-180, le=180)] | None = None
    """Turned to the left of its direction of travel [deg]; not given: along it, or along its path
    if an event gives it one."""
    speed_mps: Speed = 0.0
    """Speed at the start [m/s]."""
    turns: list[Turn] = field(default_factory=list)
    """What it does at one junction after the other; not given: the straightest way."""
    curve: list[list[float]] | None = None
    """Line that its origin follows from the start, in pieces that each have a length and the
    curvature at their beginning and end, to the left positive [m, 1/m, 1/m]; then it goes on
    along the road."""
    behaviour: Literal["idm"] | None = None
    """Driver model that drives it from the start; not given: it keeps its speed and lane."""
    idm: IdmSettings | None = None
    visible: bool = True
    """False: it is not there until an event makes it `visible`."""
    length_m: Annotated[float, Meta(gt=0, le=40)] | None = None
    """Length [m]; not given: that of its kind."""
    width_m: Annotated[float, Meta(gt=0, le=10)] | None = None
    """Width [m]; not given: that of its kind."""
    height_m: Annotated[float, Meta(gt=0, le=10)] | None = None
    """Height [m]; not given: that of its kind."""

    def __post_init__(self) -> None:
        if self.towed_by:
            _only_behind(self)
            return
        if self.poses is not None:
            places = ("lane", "footway", "parked", "shoulder", "lateral_m")
            _poses_alone(self, (*places, "s_m", "ahead_m", "ahead_s", "behind_m", "heading_deg"))
            return
        _exactly_one(self, ("lane", "footway", "parked", "shoulder", "lateral_m"))
        _exactly_one(self, ("s_m", "ahead_m", "ahead_s", "behind_m"))
        _curve_alone(self, ("turns", "behaviour", "heading_deg", "parked"))
        _check_idm(self)
        if self.parked is not None and self.speed_mps > 0.0:
            raise ValueError("what is parked stands: leave speed_mps out, or give a lane")


class StoryEvent(_Section, frozen=True, kw_only=True):
    """An event: it starts when everything that it waits for holds, once."""

    at_s: Annotated[float, Meta(ge=0, le=86400)] | None = None
    """Not before this time [s]."""
    when: dict[str, ActorWatch] = field(default_factory=dict)
    """What must hold, by the ego or actor of which it must."""
    after: list[str] | str = ""
    """An event, or several, that must have ended."""
    after_start: list[str] | str = ""
    """An event, or several, that must have started."""
    delay_s: Annotated[float, Meta(ge=0, le=3600)] = 0.0
    """It starts so much later than that [s]."""
    do: dict[str, ActorOrders] = field(default_factory=dict)
    """What who does; the ego only where the scenario drives it."""
    weather: Weather | None = None
    """The weather from then on, whatever the campaign says."""
    time_of_day: TimeOfDay | None = None
    """The local time from then on, `HH:MM`."""
    friction_factor: Annotated[float, Meta(ge=0, le=2)] | None = None
    """Friction of the road from then on, over what it has in its weather [-]."""
    signals: dict[str, SignalStateName] = field(default_factory=dict)
    """States of traffic lights from then on, by their ids in the road file."""

    def __post_init__(self) -> None:
        if not (self.do or self.changes_sky or self.signals):
            words = "do, weather, time_of_day, friction_factor or signals"
            raise ValueError(f"nothing happens: give {words}")

    @property
    def changes_sky(self) -> bool:
        """Whether weather, hour or road change."""
        return (self.weather, self.time_of_day, self.friction_factor) != (None, None, None)


class ScenarioEnd(_Section, frozen=True, kw_only=True):
    """When the scenario ends; whatever comes first."""

    after_s: Annotated[float, Meta(gt=0, le=3600)] = 60.0
    """At this time [s]."""
    ego_reaches: ScenarioSpot | None = None
    """Where the ego arrives."""
    ego_stands_s: Annotated[float, Meta(ge=0, le=3600)] | None = None
    """The ego has been standing for so long [s]."""
    collision_s: Annotated[float, Meta(ge=0, le=60)] | None = None
    """So long after the ego has touched something [s]."""
    all_done_s: Annotated[float, Meta(ge=0, le=3600)] | None = None
    """So long after all events have ended [s]."""


class NativeScenario(_Section, frozen=True, kw_only=True):
    """A scenario file."""

    scenario: Annotated[str, Meta(pattern="^[a-z0-9][a-z0-9-]{0,63}$")]
    """Its name."""
    about: str = ""
    """What it is for, and where its numbers come from."""
    road: Annotated[str, Meta(min_length=1)]
    """A shipped road, or the path of an OpenDRIVE file, relative to this one."""
    ego: EgoStart
    actors: Annotated[dict[ActorName, ActorStart], Meta(max_length=ACTORS_MAX)] = field(
        default_factory=dict
    )
    """Everybody else, by name."""
    events: Annotated[dict[ActorName, StoryEvent], Meta(max_length=EVENTS_MAX)] = field(
        default_factory=dict
    )
    """What happens, by name."""
    end: ScenarioEnd = field(default_factory=ScenarioEnd)
    """When the scenario ends."""

    def __post_init__(self) -> None:
        if "ego" in self.actors:
            raise ValueError("actors: 'ego' has a section of its own; use another name")


def _curve_alone(start: EgoStart | ActorStart, names: tuple[str, ...]) -> None:
    """A curve begins along the direction of travel, and nothing else leads the way."""
    for name in names:
        if start.curve is not None and getattr(start, name):
            raise ValueError(f"given curve and {name}: give one")


def _poses_alone(start: EgoStart | ActorStart, names: tuple[str, ...]) -> None:
    """Poses say where it is, and how it goes."""
    for name in (*names, "curve", "turns", "behaviour", "idm", "offset_m", "road", "oncoming"):
        if getattr(start, name) not in (None, "", [], 0.0, False):
            raise ValueError(f"{name} has no effect beside poses: leave it out")


def _check_idm(start: EgoStart | ActorStart) -> None:
    if start.idm is not None and start.behaviour != "idm":
        raise ValueError("idm sets up `behaviour: idm`, which is not given")


def _exactly_one(start: ActorStart, names: tuple[str, ...]) -> None:
    chosen = [name for name in names if getattr(start, name) is not None]
    if len(chosen) != 1:
        words = " and ".join(chosen) if chosen else "none of them"
        raise ValueError(f"given {words}, exactly one needed of {', '.join(names)}")


def _only_behind(start: ActorStart) -> None:
    """A towed trailer begins, and goes, where its tractor does."""
    if start.kind != "trailer":
        raise ValueError(f"towed_by is for `kind: trailer`, not for {start.kind}")
    names = ("lane", "footway", "parked", "shoulder", "lateral_m", "s_m", "ahead_m", "behind_m")
    more = ("heading_deg", "speed_mps", "turns", "behaviour", "idm", "offset_m", "road", "oncoming")
    for name in (*names, *more, "curve"):
        if getattr(start, name):
            raise ValueError(f"{name} has no effect beside towed_by: leave it out")
