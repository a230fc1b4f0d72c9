"""What files say about 3D LiDARs: profiles of sensors, where they sit, and what a campaign asks.

A *profile* describes a sensor, as a data sheet does; a *mount* in the vehicle file says where one
sits; a campaign names the mounts it wants. Angles follow the ray direction
``[cos(theta) cos(phi), sin(theta) cos(phi), -sin(phi)]`` in sensor axes (x forward, y left, z up):
theta turns left, phi points down.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

POINT_COLUMNS = ("x_m", "y_m", "z_m", "range_m", "intensity", "time_s", "kind")
"""Columns of a point cloud, float32 [S, channels x columns, 7], in range-image order: row
``channel * columns + column``, channels from the top, columns as the sensor turns.

x, y, z in sensor axes: with ``deskew`` those of the sensor at the tick (the end of the sweep), else
those it had when the point was measured. ``range_m`` is what the sensor measured. Intensity is
reflectivity 0 to 255: a matt surface that faces the sensor gives its reflectance in percent, above
100 are retro-reflectors (logarithmic). ``time_s`` is relative to the tick, <= 0. ``kind`` is an
index into :data:`RETURN_KINDS`. Rays without a return: x, y, z and range NaN, intensity and kind 0.
The message's count is the number of returns. Inactive slots hold zeros."""

TRUTH_COLUMNS = ("instance", "semantic")
"""Further columns with ``truth``: object (-1: none) and index into
:data:`schemas.messages.SEMANTIC_CLASSES`; both -1 without a surface (nothing, or fog or drops)."""

RETURN_KINDS = ("none", "surface", "fog", "drop")
"""What a ray came back from; drop: rain or snow."""

CHANNELS_MAX, COLUMNS_MAX, POINTS_MAX = 256, 8192, 524_288
"""Largest numbers of channels, columns and points of one sweep."""

Angle = Annotated[float, Meta(ge=-360, le=360)]
Elevation = Annotated[float, Meta(ge=-90, le=90)]
Resolution = Annotated[float, Meta(gt=0, le=90)]
Point = Annotated[list[Annotated[float, Meta(ge=-20, le=20)]], Meta(min_length=3, max_length=3)]
Rotation = Annotated[list[Angle], Meta(min_length=3, max_length=3)]
Pair = Annotated[list[Annotated[float, Meta(ge=0, le=50)]], Meta(min_length=2, max_length=2)]


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of LiDAR types: frozen, unknown keys are errors."""


class LidarProfile(_Spec, kw_only=True, frozen=True):
    """One kind of scanning LiDAR.

    Where no source is named, a value is what data sheets of the sensor's class state.
    """

    schema: Literal[1] = 1
    lidar: str
    """Name of the profile."""
    theta_min_deg: Angle = 0.0
    """First azimuth of a sweep, left of forward [deg], -360..360."""
    theta_max_deg: Angle = 360.0
    """Last azimuth; a full circle leaves it out, because it is the first of the next [deg]."""
    theta_res_deg: Resolution
    """Step between columns [deg], 0..90."""
    phi_min_deg: Elevation = 0.0
    """Uppermost channel, below the horizon [deg]: -15 looks 15 degrees up."""
    phi_max_deg: Elevation = 0.0
    """Lowest channel, below the horizon [deg]."""
    phi_res_deg: Resolution = 1.0
    """Step between channels [deg], 0..90."""
    elevations_deg: Annotated[list[Elevation], Meta(max_length=CHANNELS_MAX)] = []
    """Channels one by one, ABOVE the horizon, falling [deg]; takes the place of phi. Empty: phi."""
    range_min_m: Annotated[float, Meta(ge=0.05, le=50)]
    """Nearest return [m], 0.05..50."""
    range_max_m: Annotated[float, Meta(gt=0, le=1000)]
    """Farthest return [m], up to 1000."""
    range_10_percent_m: Annotated[float, Meta(gt=0, le=1000)]
    """Where a matt target of 10 % reflectance that faces the sensor is seen in half of the pulses,
    in clear air [m]; sets the detection threshold."""
    threshold_to_noise: Annotated[float, Meta(ge=1, le=100)] = 5.0
    """Detection threshold over the noise's standard deviation [-]; 5: textbook value for a false
    alarm in about three million samples (Gaussian tail)."""
    focus_m: Annotated[float, Meta(ge=0, le=100)] = 8.0
    """Nearer than this the receiver, focused far away, catches only (R / focus)^2 of the light [m]:
    where the blur of its aperture (about 25 mm / R) outgrows the detector's field of view (about
    3 mrad). Keeps haze and near targets from outshining everything. What fog, drops and flakes send
    back is also displaced, by the lens beside the beam: docs/precipitation.md."""
    hz: Annotated[int, Meta(ge=1, le=100)]
    """Sweeps per second [Hz], 1..100."""
    wavelength_nm: Annotated[float, Meta(ge=800, le=1600)]
    """Laser wavelength [nm]; reflectances below and above 1200 nm differ (water, snow, leaves)."""
    divergence_mrad: Pair = field(default_factory=lambda: [0.0, 0.0])
    """Full angle of the beam, horizontal and vertical [mrad], 0..50."""
    sub_rays: Literal[1, 5] = 1
    """Rays per beam: 1, or 5 (axis and four around it) for mixed pixels at edges."""
    noise_m: Annotated[float, Meta(ge=0, le=1)]
    """Standard deviation of a strong return's range [m]; grows as the signal falls."""
    step_m: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """Ranges are multiples of it [m]; 0: not rounded."""
    pulse_m: Annotated[float, Meta(gt=0, le=10)] = 0.9
    """Length of the pulse in range, c times half-power width / 2 [m]; nearer targets of one beam
    melt into one return (6 ns: 0.9 m)."""
    dropout: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Share of pulses lost for other reasons than signal (crosstalk, internal timing) [-]."""
    returns: Literal["strongest", "first", "last"] = "strongest"
    """Which return of a pulse is kept."""
    extinction: Literal["returns", "signal"] = "returns"
    """What fog, rain and snow take away. ``returns``: a pulse's photons come back from the target
    with probability e^(-2 a R), else they were scattered: the share of returns follows e^(-2 a R)
    at unchanged intensity. ``signal``: every pulse is weakened by e^(-2 a R) and compared with the
    noise. The mean signal is the same."""
    retro_max: Annotated[float, Meta(gt=1, le=100_000)] = 300.0
    """Reflectance of a retro-reflector, relative to a white matt surface, that gives 255 [-]."""

    def __post_init__(self) -> None:
        if self.theta_max_deg <= self.theta_min_deg:
            raise ValueError(
                f"theta_max_deg {self.theta_max_deg:g} must be above theta_min_deg "
                f"{self.theta_min_deg:g}"
            )
        if self.theta_max_deg - self.theta_min_deg > 360.0:
            raise ValueError(
                f"theta_min_deg {self.theta_min_deg:g} to theta_max_deg {self.theta_max_deg:g} is "
                "more than one turn of 360"
            )
        if self.phi_max_deg < self.phi_min_deg:
            raise ValueError(
                f"phi_max_deg {self.phi_max_deg:g} must not be below phi_min_deg "
                f"{self.phi_min_deg:g} (phi points down)"
            )
        if self.range_max_m <= self.range_min_m:
            raise ValueError(
                f"range_max_m {self.range_max_m:g} must be above range_min_m {self.range_min_m:g}"
            )
        elevations = self.elevations_deg
        if any(b >= a for a, b in pairwise(elevations)):
            raise ValueError("elevations_deg must fall from channel to channel")
        for name, count, most in (
            ("channels", self.channels, CHANNELS_MAX),
            ("columns", self.columns, COLUMNS_MAX),
            ("points", self.channels * self.columns, POINTS_MAX),
        ):
            if count > most:
                raise ValueError(f"{count} {name} are too many, at most {most}")

    @property
    def phis_deg(self) -> list[float]:
        """phi of every channel, from the top [deg]."""
        if self.elevations_deg:
            return [-angle for angle in self.elevations_deg]
        steps = _steps(self.phi_min_deg, self.phi_max_deg, self.phi_res_deg)
        return [self.phi_min_deg + i * self.phi_res_deg for i in range(steps + 1)]

    @property
    def thetas_deg(self) -> list[float]:
        """theta of every column, as the sensor turns [deg]."""
        return [self.theta_min_deg + i * self.theta_res_deg for i in range(self.columns)]

    @property
    def channels(self) -> int:
        """Number of channels."""
        if self.elevations_deg:
            return len(self.elevations_deg)
        return _steps(self.phi_min_deg, self.phi_max_deg, self.phi_res_deg) + 1

    @property
    def columns(self) -> int:
        """Number of columns."""
        steps = _steps(self.theta_min_deg, self.theta_max_deg, self.theta_res_deg)
        circle = steps * self.theta_res_deg > 360.0 - 1e-6 * self.theta_res_deg
        return steps if circle else steps + 1


def _steps(low: float, high: float, step: float) -> int:
    return math.floor((high - low) / step + 1e-6)


class LidarMount(_Spec, frozen=True):
    """A LiDAR on a vehicle: its profile and where it sits. Part of the vehicle file."""

    position_m: Point
    """x forward of the vehicle's reference point, y left, z up [m]."""
    rotation_deg: Rotation = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll, pitch and yaw of the sensor, turned about z, then y, then x [deg]: yaw to the left,
    pitch down, roll to the right."""
    profile: str = ""
    """A shipped profile's name, or the path of a profile file."""
    inline: LidarProfile | None = None
    """The profile itself, in place of a name."""

    def __post_init__(self) -> None:
        if bool(self.profile) == (self.inline is not None):
            raise ValueError("give either profile (a name or a path) or inline (the profile)")


class Lidar(_Spec, frozen=True):
    """A LiDAR that a campaign switches on."""

    name: Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,31}$")] = "roof"
    """Name of a mount in the vehicle file; its messages come as sensor ``lidar.<name>``."""
    hz: Annotated[int, Meta(ge=0, le=100)] = 0
    """Sweeps per second, a divisor of the control rate; 0: the profile's [Hz]."""
    noise: bool = True
    """Errors of the sensor: range noise, detection near the threshold, dropouts."""
    motion: bool = True
    """The vehicle and the objects move during the sweep; false: every ray at the tick's poses."""
    weather: bool = True
    """Fog, rain, snow and wet or white surfaces act on it; false: always clear and dry."""
    deskew: bool = False
    """Points in the sensor's axes at the tick; false: as measured, distorted by the motion."""
    truth: bool = False
    """Adds the columns :data:`TRUTH_COLUMNS`."""


def lidar_columns(lidar: Lidar) -> tuple[str, ...]:
    """Columns of the point cloud of ``lidar``."""
    return POINT_COLUMNS + TRUTH_COLUMNS if lidar.truth else POINT_COLUMNS
