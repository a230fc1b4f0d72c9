"""Positions, trajectories and routes of a storyboard program.

What does not depend on a moving entity is resolved when the program is made, so most positions are
fixed ones. Angles are right-handed as in ISO 8855 and :mod:`twin.road.opendrive.road_frame`.
"""

from __future__ import annotations

from enum import IntEnum

from twin.scenario.storyboard.program.record import ProgramRecord


class FixedPosition(ProgramRecord, frozen=True):
    """A pose in the world, and where it lies on the road network."""

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    """Of a body put there; along the road or trajectory it was given on, if no orientation was."""
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    road: int = -1
    """Index of the road in the order of the file; -1: on no road."""
    s_m: float = 0.0
    t_m: float = 0.0
    lane: int = 0
    """OpenDRIVE id; 0: none."""
    lane_offset_m: float = 0.0
    """To the left along s."""


class RelativeFrame(IntEnum):
    """Axes of a relative position."""

    WORLD = 0
    """dx, dy, dz along world axes."""
    OBJECT = 1
    """dx, dy, dz along the axes of the entity."""
    ROAD = 2
    """ds, dt along the road of the entity."""
    LANE = 3
    """ds along the reference line, lanes counted to the left of the entity's, offset."""
    LANE_LENGTH = 4
    """As LANE, ds along the centre of the lane."""


class RelativePosition(ProgramRecord, frozen=True):
    """A position that moves with an entity."""

    frame: RelativeFrame
    entity: int
    a: float = 0.0
    """dx or ds [m]."""
    b: float = 0.0
    """dy or dt or lane offset [m]."""
    c: float = 0.0
    """dz [m], or the number of lanes to the left as seen by the entity (:attr:`lanes`)."""
    lanes: int = 0
    heading_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    relative_orientation: bool = True
    """Angles are relative to the entity or, on roads and lanes, to the road; else to the world."""
    by_road: bool = False
    """On roads and lanes: ds and dt count along the road's axes, lanes by their ids, and angles
    from the road's direction; else all of it as the entity is headed."""


Position = FixedPosition | RelativePosition


class TrajectoryPiece(ProgramRecord, frozen=True):
    """A stretch of a trajectory; polynomials of the distance from its beginning."""

    start_s_m: float
    length_m: float
    x: tuple[float, float, float, float]
    y: tuple[float, float, float, float]
    z: tuple[float, float, float, float]
    heading: tuple[float, float, float, float]
    """Unwrapped; [rad]."""
    start_time_s: float = 0.0
    duration_s: float = 0.0
    """Both 0 where the trajectory has no times."""


class Trajectory(ProgramRecord, frozen=True):
    """A line to follow; its pieces are at most 1e-5 m and 1e-6 rad from the shape in the file."""

    name: str
    closed: bool
    timed: bool
    pieces: tuple[TrajectoryPiece, ...]
    from_actor: bool = False
    """Pieces are given in the axes of the actor where the action begins; else of the world."""


class RouteLeg(ProgramRecord, frozen=True):
    """A stretch of a route on one road."""

    road: int
    from_s_m: float
    to_s_m: float
    """Smaller than ``from_s_m`` where the route goes against s."""
    lane: int
    """Where the route's waypoint or way lies; 0: no matter which."""


class RoadRoute(ProgramRecord, frozen=True):
    """A way through the road network."""

    name: str
    closed: bool
    legs: tuple[RouteLeg, ...]
