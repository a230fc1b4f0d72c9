"""The file of a played scenario (``.play``): what `twin play --save` leaves for the viewer.

One MessagePack map, a :class:`PlayFile`. Arrays are little-endian float64 in C order. Coordinates
are those of the road file: x, y, z in metres, z up, headings right-handed from the x axis in
radians. Times are sim time since the storyboard began [s].

Version 1. A reader skips keys that it does not know, so a field may be added with a default; what
changes the meaning of one raises the version.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

PLAY_VERSION = 1
"""Version of the format."""

PLAY_SUFFIX = ".play"

FILE_BYTES_MAX = 256 << 20
"""Largest file [bytes]."""

ENTITIES_MAX = 256
"""Entities of a scenario."""

POSES_MAX = 2_000_000
"""Poses of all entities together."""

LANES_MAX = 20_000
"""Stretches of lanes that are drawn."""

MARKS_MAX = 40_000
"""Lines of road marks that are drawn."""

PATHS_MAX = 2_000
"""Trajectories and routes that are drawn."""

POINTS_MAX = 1_000_000
"""Points of all lanes, marks and paths together."""

ELEMENTS_MAX = 20_000
"""Elements of a storyboard."""

TRANSITIONS_MAX = 100_000
"""Transitions of elements."""

NOTES_MAX = 1_000
"""Notes for people."""

TEXT_CHARS_MAX = 2_000
"""Longest name, path of an element or note [characters]."""

TIME_S_MAX = 1e6
"""Latest time [s]."""

STEP_S_MIN = 1e-6
"""Shortest step, and shortest time between two poses [s]."""

LENGTH_M_MAX = 1e9
"""Largest coordinate [m]."""

POSE_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "heading_rad", "speed_mps")
"""Columns of :attr:`PlayEntity.poses`."""

Text = Annotated[str, Meta(max_length=TEXT_CHARS_MAX)]

BodyCategory = Literal[
    "car",
    "van",
    "truck",
    "trailer",
    "semitrailer",
    "bus",
    "motorcycle",
    "bicycle",
    "train",
    "tram",
    "pedestrian",
    "child",
    "wheelchair",
    "animal",
    "obstacle",
]
"""What a body is."""

StoryLevel = Literal["storyboard", "story", "act", "group", "maneuver", "event", "action"]
"""Level of a storyboard element."""

StoryTransition = Literal["start", "end", "stop", "skip"]
"""What became of an element: ``stop`` ends it before its own end, ``skip`` leaves it out."""


class PlayEntity(Struct, frozen=True, kw_only=True):
    """An entity, its box and where it was."""

    name: Text
    category: BodyCategory
    ego: bool
    """Driven by what is tested, or by what stands in its place."""
    length_m: float
    width_m: float
    height_m: float
    centre_m: tuple[float, float, float]
    """Centre of the box in the axes of the entity: x forwards, y to the left, z up [m]."""
    poses: bytes
    """[N, 6] by :data:`POSE_COLUMNS`, times rising; only while the entity is there."""


class PlayLane(Struct, frozen=True, kw_only=True):
    """A stretch of a lane between two borders."""

    type: Text
    """As in the road file, e.g. ``driving``."""
    left: bytes
    """Left border as seen along the reference line [N, 3] [m]."""
    right: bytes
    """Right border at the same stations [N, 3] [m]."""


class PlayMark(Struct, frozen=True, kw_only=True):
    """A line of a road mark."""

    color: Text
    """As in the road file, e.g. ``white`` or ``standard``."""
    width_m: float
    stroke_m: float
    """Length of a stroke; 0: it has no gaps [m]."""
    gap_m: float
    from_m: float
    """Where the first stroke begins, from the first point [m]."""
    points: bytes
    """Its middle [N, 3] [m]."""


class PlayPath(Struct, frozen=True, kw_only=True):
    """A line that an entity was told to follow."""

    kind: Literal["trajectory", "route"]
    name: Text
    points: bytes
    """[N, 3] [m]."""


class PlayElement(Struct, frozen=True, kw_only=True):
    """An element of the storyboard."""

    level: StoryLevel
    name: Text
    path: Text
    """Names from the story down, joined by ``::``; of the storyboard ``storyboard``."""
    line: int = 0
    """Where it stands in its file; 0: unknown."""
    action: Text = ""
    """What an action does, in words, e.g. ``lane change``."""
    trigger: Text = ""
    """Conditions that start it, by name."""
    actors: list[int] = []
    """Entities that it is about."""


class PlayTransition(Struct, frozen=True, kw_only=True):
    """A transition of an element."""

    time_s: float
    element: int
    transition: StoryTransition


class PlayFile(Struct, frozen=True, kw_only=True):
    """A played scenario."""

    version: int
    name: Text
    step_s: float
    """Step of the player [s]."""
    period_s: float
    """Time between two poses that were kept [s]."""
    end_s: float
    """Time at which playing ended [s]."""
    finished: bool
    """Whether the storyboard stopped by itself."""
    entities: Annotated[list[PlayEntity], Meta(max_length=ENTITIES_MAX)]
    lanes: Annotated[list[PlayLane], Meta(max_length=LANES_MAX)]
    marks: Annotated[list[PlayMark], Meta(max_length=MARKS_MAX)]
    paths: Annotated[list[PlayPath], Meta(max_length=PATHS_MAX)]
    elements: Annotated[list[PlayElement], Meta(max_length=ELEMENTS_MAX)]
    transitions: Annotated[list[PlayTransition], Meta(max_length=TRANSITIONS_MAX)]
    """In the order of their times."""
    notes: Annotated[list[Text], Meta(max_length=NOTES_MAX)] = []
    """What is left out of the file or was not played, a line each."""
