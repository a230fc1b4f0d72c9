"""Vehicle files: everything that tells one car from another, with units, as people write it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field
from msgspec.structs import replace

from schemas.files.assets import is_path
from schemas.names import Name
from schemas.sections.lens import CameraMount
from schemas.sections.lidar import LidarMount
from schemas.validation import suggest
from twin.sensors.lidar.profile_file import mounted_profile
from twin.world.scene import load_named, named_path

_MODELS = Path(__file__).parent / "models"

MPH_60_MPS = 26.8224
_INERTIA_MIN = 1e-6
"""Smallest determinant of the inertia about x and y, as a share of the product of both moments."""

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
Point = Annotated[list[Annotated[float, Meta(ge=-20, le=20)]], Meta(min_length=3, max_length=3)]
"""x forward of the rear axle, y left, z above ground [m]."""
Pair = Annotated[list[Positive], Meta(min_length=2, max_length=2)]


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of the parts: frozen, unknown keys are errors."""


class SprungBody(_Spec):
    """Sprung masses on four corners; total mass, centre of mass and inertia follow from them."""

    corner_mass_kg: Annotated[list[Positive], Meta(min_length=4, max_length=4)]
    """Sprung mass that rests on each wheel: front left, front right, rear left, rear right [kg]."""
    com_height_m: Positive
    """Height of the sprung masses' centre above the ground, at rest [m]."""
    gyration_x: Annotated[float, Meta(gt=0, le=1.5)]
    gyration_y: Annotated[float, Meta(gt=0, le=1.5)]
    """Where the corner masses sit, as shares of the way from the centre of mass to the wheel,
    forward and sideways [-]; 1: above the wheels, which gives the largest inertia."""


class Wheels(_Spec):
    """Four equal wheels."""

    mass_kg: Positive
    """Unsprung mass of one wheel with hub and brake [kg]."""
    inertia_kgm2: Positive
    """Spin inertia of one wheel [kg m^2]."""
    radius_m: Annotated[float, Meta(gt=0.1, le=1)]
    """Rolling radius under the static load [m]."""
    stiffness_n_per_m: Positive
    """Vertical stiffness of the tyre [N/m]."""
    damping_ns_per_m: NotNegative
    """Vertical damping of the tyre [N s/m]."""
    rolling_resistance: NotNegative
    """Rolling resistance over load [-]."""


class Suspension(_Spec):
    """One axle's springs, dampers and stabiliser."""

    natural_frequency_radps: Positive
    """w_n of a corner's sprung mass on its spring, K = M w_n^2 [rad/s]."""
    damping_ratio: Annotated[float, Meta(ge=0, le=2)]
    """zeta of the same, B = 2 zeta sqrt(K M) [-]."""
    antiroll_nm_per_rad: NotNegative = 0.0
    """Roll stiffness of the stabiliser [N m/rad]."""
    bump_m: Positive = 0.09
    """Travel from rest to the bump stop [m]."""
    roll_steer: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0
    """Slip angle that roll adds into the turn (camber thrust and roll steer) over the roll angle
    [rad/rad]; positive: the axle turns in, oversteer in front and understeer behind."""


class TyreCurve(_Spec, kw_only=True):
    """Friction over slip on a road of friction 1: a cubic from the origin to the extremum, a cubic
    from there to the asymptote. On other roads forces and slips scale with friction."""

    slip_extremum: Annotated[float, Meta(gt=0, le=1)]
    """Slip at the extremum [-]: longitudinal (R w - v) / v, or tan of the slip angle."""
    force_extremum: Annotated[float, Meta(gt=0, le=2)] = 1.0
    """Force over load there [-]."""
    slip_asymptote: Annotated[float, Meta(gt=0, le=5)]
    force_asymptote: Annotated[float, Meta(gt=0, le=2)]
    shape: Annotated[float, Meta(ge=1, le=3)] = 1.5
    """Slope at the origin, as a multiple of the chord to the extremum [-]; 3 is the steepest
    without an overshoot, 1.5 has no curvature at the origin."""

    def __post_init__(self) -> None:
        if self.slip_asymptote <= self.slip_extremum:
            raise ValueError(
                f"slip_asymptote {self.slip_asymptote:g} must be above slip_extremum "
                f"{self.slip_extremum:g}"
            )
        if self.force_asymptote > self.force_extremum:
            raise ValueError(
                f"force_asymptote {self.force_asymptote:g} must not be above force_extremum "
                f"{self.force_extremum:g}"
            )


class Tyres(_Spec):
    """The tyres of one axle."""

    longitudinal: TyreCurve
    lateral: TyreCurve


class EngineMap(_Spec, kw_only=True):
    """Torque over engine speed, and how the pedal asks for it."""

    torque_nm: Annotated[
        list[Annotated[list[NotNegative], Meta(min_length=2, max_length=2)]],
        Meta(min_length=2, max_length=16),
    ]
    """Full-load torque: rows of engine speed [rpm], rising, and torque [N m]; none beyond."""
    idle_rpm: Positive
    smoothing_s: NotNegative = 0.1
    """Time constant of the engine speed [s]."""
    stall_rpm: Positive
    """Engine speed at full load against the standing torque converter [rpm]."""
    converter_ratio: Annotated[float, Meta(ge=1, le=3)] = 1.0
    """Torque ratio of the standing converter; falls to 1 as the speeds meet [-]."""
    pedal_speed_mps: Positive
    """The pedal's non-linear map: position p asks for the share p - (1 - p) v / pedal_speed of the
    torque, so that every position has a steady speed [m/s]."""

    def __post_init__(self) -> None:
        speeds = [row[0] for row in self.torque_nm]
        if any(b <= a for a, b in pairwise(speeds)):
            raise ValueError("torque_nm: engine speeds must rise from row to row")


class Gearbox(_Spec, kw_only=True):
    """An automatic gearbox that keeps the engine in its band."""

    ratios: Annotated[list[Positive], Meta(min_length=1, max_length=12)]
    """Forward gears, falling [-]."""
    reverse_ratio: Positive
    final_drive: Positive
    efficiency: Annotated[float, Meta(gt=0, le=1)] = 1.0
    shift_up_rpm: Pair
    """Engine speed that asks for the next gear, with no pedal and with full pedal [rpm]."""
    shift_down_rpm: Pair
    """Engine speed that asks for the gear below, with no pedal and with full pedal [rpm]."""
    shift_s: NotNegative
    """A shift interrupts the torque for this long [s]."""

    def __post_init__(self) -> None:
        steps = [a / b for a, b in pairwise(self.ratios)]
        if any(step <= 1.0 for step in steps):
            raise ValueError("ratios: every gear's ratio must be below that of the gear before")
        for up, down in zip(self.shift_up_rpm, self.shift_down_rpm, strict=True):
            if down * max(steps, default=1.0) >= up:
                raise ValueError(
                    f"shift_down_rpm {down:g} hunts with shift_up_rpm {up:g}: after the widest "
                    f"step of {max(steps, default=1.0):.2f} the engine turns at "
                    f"{up / max(steps, default=1.0):.0f} rpm"
                )


class Driveline(_Spec):
    """Which wheels the torque goes to."""

    driven: Literal["front", "rear", "all"]
    differential_drop: Annotated[float, Meta(ge=0, le=2)] = 0.0
    """Share of torque that the wheel inside the turn loses per steering angle [1/rad]; the product
    is clamped to 0..0.9."""
    traction_control: bool = True
    """Engine torque follows the driven wheels' grip."""


class Brakes(_Spec, kw_only=True):
    """Service brake and parking brake."""

    distance_60mph_m: Positive
    """Distance from 60 mph to rest at full pedal on a dry road, pedal lag included [m]."""
    front_share: Share = 0.7
    """Share of the front axle without ABS; with it, the share follows the loads [-]."""
    abs: bool = True
    parking_torque_nm: NotNegative
    """Parking brake on each rear wheel [N m]."""


class SteeringMotor(_Spec, kw_only=True):
    """The steering motor; angles are those of the road wheel in the middle (Ackermann)."""

    max_rad: Annotated[float, Meta(gt=0, le=1.5)]
    rate_radps: Positive
    """kappa_delta: steering rate at standstill [rad/s]."""
    rate_speed_radps: float = 0.0
    """kappa_v: what the rate gains (or loses) up to the largest speed [rad/s]."""
    ackermann: Share = 1.0
    """1: the wheels' axes meet in one point (Ackermann); 0: both wheels turn alike [-]."""


class Lags(_Spec):
    """Time constants of the actuators; 0: they follow at once [s]."""

    throttle_s: NotNegative = 0.0
    brake_s: NotNegative = 0.0
    steering_s: NotNegative = 0.0
    handbrake_s: NotNegative = 0.0


class Aero(_Spec):
    """Air on the body: drag areas in the four states of the drive, side force and yaw moment.

    A drag area is drag coefficient times frontal area [m^2]. Side force and yaw moment are those of
    a cross wind: Y = rho/2 V w side, N = rho/2 V w yaw, with the air's speed V past the body and
    the wind's part w across it. Defaults: a saloon's slopes of 2.2 and 0.45 per radian (Hucho,
    Aerodynamics of Road Vehicles) times 2.5 m^2 and, for the moment, 2.8 m of wheelbase.
    """

    run_m2: NotNegative
    idle_m2: NotNegative
    """Without throttle."""
    reverse_m2: NotNegative
    """Backwards beyond ``reverse_max_mps``."""
    limit_m2: NotNegative
    """Beyond ``speed_max_mps``."""
    speed_max_mps: Positive
    """Largest practical speed [m/s]."""
    reverse_max_mps: Positive
    side_m2: NotNegative = 5.5
    """Slope of the side force [m^2]."""
    yaw_m3: NotNegative = 3.15
    """Slope of the yaw moment about the centre of mass; it turns the nose away from the wind
    [m^3]."""


class Contact(_Spec):
    """The hull as a rigid body."""

    restitution: Share = 0.1
    """Rebound speed over approach speed [-]."""
    friction: NotNegative = 0.4
    """Hull against walls and cars [-]."""


class Reference(_Spec):
    """Published figures that ``twin validate vehicle`` compares with; leave out what is unknown."""

    zero_to_60mph_s: float | None = None
    turning_circle_m: float | None = None
    """Diameter between kerbs [m]."""
    step_steer_yaw_rate_degps: float | None = None
    """Yaw rate 2 s after a step to 2 degrees at 80 km/h [deg/s]."""
    step_steer_rise_s: float | None = None
    """Time from the step to 90 % of that [s]."""


class Vehicle(_Spec, kw_only=True):
    """One vehicle file."""

    schema: Literal[3] = 3
    vehicle: str
    wheelbase_m: Positive
    track_m: Positive
    """Distance between the wheels of an axle [m]."""
    length_m: Positive
    width_m: Positive
    height_m: Positive
    rear_overhang_m: NotNegative
    """Rear axle to rear bumper [m]."""
    mass_max_kg: Positive | None = None
    """Largest mass with a load; not given: loads are not looked at [kg]."""
    body: SprungBody
    wheels: Wheels
    front: Suspension
    rear: Suspension
    front_tyres: Tyres
    rear_tyres: Tyres
    engine: EngineMap
    gearbox: Gearbox
    driveline: Driveline
    brakes: Brakes
    steering: SteeringMotor
    lags: Lags = field(default_factory=Lags)
    aero: Aero
    contact: Contact = field(default_factory=Contact)
    reference: Reference = field(default_factory=Reference)
    cameras: Annotated[dict[Name, CameraMount], Meta(min_length=1)]
    """Cameras by name; campaigns choose among them."""
    lidars: dict[Name, LidarMount] = {}
    """Lidars by name; campaigns choose among them."""
    headlamps_m: Point
    """Middle between the headlamps [m]."""

    def __post_init__(self) -> None:
        if self.rear_overhang_m + self.wheelbase_m > self.length_m:
            raise ValueError(
                f"rear_overhang_m + wheelbase_m {self.rear_overhang_m + self.wheelbase_m:g} is "
                f"longer than length_m {self.length_m:g}"
            )
        if self.wheels.radius_m >= self.body.com_height_m + self.wheels.radius_m / 2:
            raise ValueError(
                f"body.com_height_m {self.body.com_height_m:g} is too low for wheels of radius "
                f"{self.wheels.radius_m:g} m"
            )
        self._check_inertia()
        self._check_brakes()

    def moments(self) -> tuple[float, float, float]:
        """Moments of inertia of the sprung masses in roll and pitch, and their product
        sum(m x y), about the centre of mass [kg m^2]."""
        masses, body = self.body.corner_mass_kg, self.body
        front = (masses[0] + masses[1]) / sum(masses)
        left = (masses[0] + masses[2]) / sum(masses)
        x_m = [self.wheelbase_m * share * body.gyration_x for share in (1.0 - front, -front)]
        y_m = [self.track_m * share * body.gyration_y for share in (1.0 - left, -left)]
        corners = [(x, y) for x in x_m for y in y_m]
        rows = [(mass, x, y) for mass, (x, y) in zip(masses, corners, strict=True)]
        return (
            sum(mass * y * y for mass, _, y in rows),
            sum(mass * x * x for mass, x, _ in rows),
            sum(mass * x * y for mass, x, y in rows),
        )

    def _check_inertia(self) -> None:
        """Refuse masses whose tensor no kernel could invert: all on one line, or on one point."""
        roll, pitch, product = self.moments()
        if not roll * pitch - product**2 > _INERTIA_MIN * roll * pitch > 0.0:
            raise ValueError(
                f"body: its inertia is not positive: roll {roll:g}, pitch {pitch:g}, product "
                f"{product:g} kg m^2; spread corner_mass_kg, and raise gyration_x and gyration_y"
            )

    def _check_brakes(self) -> None:
        """Refuse a braking distance that is over before the brakes act."""
        distance_m, lag_s = self.brakes.distance_60mph_m, self.lags.brake_s
        if distance_m <= MPH_60_MPS * lag_s:
            raise ValueError(
                f"brakes.distance_60mph_m {distance_m:g} is passed while the pedal's lag of "
                f"{lag_s:g} s goes by; give a longer distance or a shorter lag"
            )

    def camera(self, name: str) -> CameraMount:
        """The camera called ``name``.

        Raises:
            ValueError: it has none; one line.
        """
        if name not in self.cameras:
            raise ValueError(
                f"vehicle '{self.vehicle}': no camera '{name}'; {suggest(name, list(self.cameras))}"
            )
        return self.cameras[name]

    def lidar(self, name: str) -> LidarMount:
        """The lidar called ``name``.

        Raises:
            ValueError: it has none; one line.
        """
        if name not in self.lidars:
            known = suggest(name, list(self.lidars)) if self.lidars else "it has no lidars"
            raise ValueError(f"vehicle '{self.vehicle}': no lidar '{name}'; {known}")
        return self.lidars[name]

    @property
    def centre_offset_m(self) -> float:
        """Rear axle to the hull's centre, forward [m]."""
        return self.length_m / 2 - self.rear_overhang_m

    @property
    def front_offset_m(self) -> float:
        """Rear axle to front bumper [m]."""
        return self.length_m - self.rear_overhang_m

    @property
    def mass_kg(self) -> float:
        """Total mass: sprung corners and wheels [kg]."""
        return sum(self.body.corner_mass_kg) + 4 * self.wheels.mass_kg


def load_vehicle(name_or_path: str) -> Vehicle:
    """Load a shipped vehicle by name, or a vehicle file by path.

    Files that it names are relative to it; the result holds paths that can be opened.

    Raises:
        ValueError: no such vehicle, or a mistake in its file or in a LiDAR profile that it names;
            one line.
    """
    vehicle = load_named(name_or_path, Vehicle, _MODELS, "vehicle")
    folder = named_path(name_or_path, _MODELS, "vehicle").parent
    lidars = {
        name: replace(mount, profile=str(folder / mount.profile))
        if is_path(mount.profile)
        else mount
        for name, mount in vehicle.lidars.items()
    }
    if is_path(name_or_path):
        for name, mount in lidars.items():
            try:
                mounted_profile(mount)
            except ValueError as error:
                raise ValueError(f"{name_or_path}: lidars.{name}: {error}") from None
    return replace(vehicle, lidars=lidars)
