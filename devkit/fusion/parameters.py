"""Parameters of the fusion stack beside those it shares with the reference stack.

A field is a key of ``autonomy.parameters``; unit and range stand with each. Cruise control, lane
keeping and lights have those of the reference stack (:mod:`devkit.reference`, :mod:`devkit.lane`).
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

SensorSet = Literal["camera", "camera+radar", "camera+lidar", "all"]
"""Sensors that the stack looks at, of those that the campaign gives it."""


class FusionSensors(Struct, frozen=True, forbid_unknown_fields=True):
    """What the stack looks at, and what it knows of its sensors."""

    sensors_used: SensorSet = "all"
    """``all``: whatever the campaign has. A set that names a sensor needs it in the campaign."""
    confidence_min: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """Least confidence of a camera box that counts [-], 0 to 1."""
    height_min_px: Annotated[float, Meta(ge=1, le=500)] = 6.0
    """Least height of a camera box that counts [px], 1 to 500."""
    wheel_radius_m: Annotated[float, Meta(gt=0.1, le=1)] = 0.36
    """Rolling radius of the wheels that the encoders count [m], above 0.1 to 1."""
    lidar_deskewed: bool = True
    """Whether LiDAR points are those of the tick (``deskew: true``); else they are moved here, as
    if all they meet stands."""
    lidar_range_m: Annotated[float, Meta(ge=10, le=150)] = 80.0
    """LiDAR points further ahead are left out [m], 10 to 150."""
    cluster_points_min: Annotated[int, Meta(ge=1, le=100)] = 4
    """Fewest LiDAR points of an obstacle, 1 to 100: lone ones are drops and flakes."""
    radar_x_m: Annotated[float, Meta(ge=-10, le=20)] = 4.1
    """Radar before the rear axle [m], -10 to 20; a campaign that places it elsewhere says so here
    too."""
    radar_z_m: Annotated[float, Meta(ge=0, le=5)] = 0.5
    """Radar above the road [m], 0 to 5."""
    dive_rad_per_mps2: Annotated[float, Meta(ge=0, le=0.02)] = 0.005
    """How far the nose dives when the accelerometer feels the car slow down [rad/(m/s^2)], 0 to
    0.02; by it heights of echoes are corrected."""


class TrackingParameters(Struct, frozen=True, forbid_unknown_fields=True):
    """How sightings become tracks."""

    acceleration_mps2: Annotated[float, Meta(gt=0, le=20)] = 1.5
    """Deviation of an object's acceleration, the process noise [m/s^2], above 0 to 20."""
    start_speed_mps: Annotated[float, Meta(gt=0, le=50)] = 10.0
    """Deviation of a new track's speed around standstill [m/s], above 0 to 50."""
    gate: Annotated[float, Meta(gt=0, le=50)] = 9.21
    """Largest squared Mahalanobis distance of a sighting from its track [-], above 0 to 50; the
    default holds 99 % of two dimensions (chi-square)."""
    lidar_sigma_m: Annotated[float, Meta(gt=0, le=5)] = 0.25
    """Deviation of an obstacle's near end, seen by LiDAR [m], above 0 to 5."""
    born: Annotated[float, Meta(gt=0, lt=1)] = 0.3
    """Probability that a first sighting is of something there [-], above 0 to below 1."""
    detection: Annotated[float, Meta(gt=0, lt=1)] = 0.8
    """Probability that a sensor sees what is there [-], above 0 to below 1."""
    clutter: Annotated[float, Meta(gt=0, lt=1)] = 0.2
    """Probability that it sees something where nothing is [-], above 0 to below 1."""
    dead: Annotated[float, Meta(gt=0, lt=1)] = 0.05
    """A track less probable than this is forgotten [-], above 0 to below 1."""
    memory_s: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """A track that no sensor has seen for so long is forgotten [s], above 0 to 10."""

    def __post_init__(self) -> None:
        """Refuse a sensor that sees more often where nothing is."""
        if self.clutter >= self.detection:
            raise ValueError(
                f"clutter: given {self.clutter:g}, allowed: below detection {self.detection:g}"
            )


class StagingParameters(Struct, frozen=True, forbid_unknown_fields=True):
    """When the driver is warned, and when the car brakes how hard and lets go."""

    cruise_speed_mps: Annotated[float, Meta(ge=0, le=60)] = 8.0
    """Speed on a free road [m/s], 0 to 60."""
    front_m: Annotated[float, Meta(ge=0, le=10)] = 4.1
    """Front bumper before the rear axle [m], 0 to 10."""
    corridor_half_m: Annotated[float, Meta(gt=0, le=5)] = 1.1
    """Half width of the ego's path [m], above 0 to 5."""
    warning_ttc_s: Annotated[float, Meta(ge=0, le=20)] = 4.0
    """Time to collision from which on the driver is warned [s], 0 to 20."""
    partial_ttc_s: Annotated[float, Meta(ge=0, le=20)] = 3.2
    """Time to collision from which on the car brakes for what two sensors agree on [s]."""
    single_ttc_s: Annotated[float, Meta(ge=0, le=20)] = 2.6
    """The same for what one sensor alone sees [s], not above ``partial_ttc_s``. A stop from 8 m/s
    on packed snow takes 2.0 s of it."""
    partial_brake: Annotated[float, Meta(gt=0, le=1)] = 0.4
    """Brake of the partial stage [-], above 0 to 1."""
    partial_deceleration_mps2: Annotated[float, Meta(ge=0, le=10)] = 1.2
    """The car does not brake before more than this would be needed [m/s^2], 0 to 10: a slow one has
    time yet, and any road but ice gives as much."""
    following_deceleration_mps2: Annotated[float, Meta(ge=0, le=10)] = 2.0
    """The same for what drives on ahead and does not brake [m/s^2], 0 to 10: it may turn off."""
    full_deceleration_mps2: Annotated[float, Meta(gt=0, le=10)] = 3.0
    """Deceleration that would still stop the car in time, from which on it brakes fully
    [m/s^2], above 0 to 10: the partial brake gives 3.3, and all that there is on snow."""
    standing_deceleration_mps2: Annotated[float, Meta(gt=0, le=10)] = 4.5
    """The same for what stands [m/s^2], above 0 to 10. The partial brake alone stops for what was
    seen early, and a car that was mistaken sees that meanwhile. A wet road gives 6."""
    stop_gap_m: Annotated[float, Meta(ge=0, le=10)] = 2.0
    """Gap to the obstacle at which the car wants to stand [m], 0 to 10."""
    agree_probability: Annotated[float, Meta(gt=0, lt=1)] = 0.9
    """Existence from which on a track that two sensors see counts [-]."""
    single_probability: Annotated[float, Meta(gt=0, lt=1)] = 0.97
    """The same of one that a single sensor sees [-]."""
    release_s: Annotated[float, Meta(ge=0, le=10)] = 0.5
    """The brake is let go of when there was no threat for so long [s], 0 to 10."""
    restart_s: Annotated[float, Meta(ge=0, le=60)] = 2.5
    """A car that has stopped drives on when its path was free for so long [s], 0 to 60."""
    crossing_s: Annotated[float, Meta(ge=0, le=10)] = 3.0
    """How far ahead the way of those who cross is foreseen [s], 0 to 10."""
    crossing_deceleration_mps2: Annotated[float, Meta(gt=0, le=10)] = 5.0
    """Deceleration that would still stop the car in time, from which on it brakes for who is beside
    the path and will cross it [m/s^2], above 0 to 10."""

    def __post_init__(self) -> None:
        """Refuse stages in a wrong order."""
        if not self.single_ttc_s <= self.partial_ttc_s <= self.warning_ttc_s:
            raise ValueError(
                f"single_ttc_s {self.single_ttc_s:g}, partial_ttc_s {self.partial_ttc_s:g} and "
                f"warning_ttc_s {self.warning_ttc_s:g} must rise in this order"
            )
