"""Vehicle files: hull, mass, drive, brakes, and where the camera sits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from twin.world.scene import load_named

_MODELS = Path(__file__).parent / "models"

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Point = Annotated[list[Annotated[float, Meta(ge=-20, le=20)]], Meta(min_length=3, max_length=3)]
"""x forward of the rear axle, y left, z above ground [m]."""


class Vehicle(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One vehicle file."""

    schema: Literal[1] = 1
    vehicle: str
    wheelbase_m: Positive
    track_m: Positive
    """Distance between the wheels of an axle [m]; for display, the planar model has no roll."""
    length_m: Positive
    width_m: Positive
    height_m: Positive
    rear_overhang_m: NotNegative
    """Rear axle to rear bumper [m]."""
    mass_kg: Positive
    drag_area_m2: NotNegative
    """Drag coefficient times frontal area [m^2]."""
    rolling_resistance: NotNegative
    """Rolling resistance over weight [-]."""
    drive_force_max_n: Positive
    """Tractive force at full throttle from standstill [N]."""
    drive_power_max_w: Positive
    """Tractive power limit [W]."""
    pedal_slope_ns_per_m: NotNegative
    """Tractive force that the pedal map takes back per speed [N s/m]."""
    brake_force_max_n: Positive
    """Braking force at full brake, before the tyres' limit [N]."""
    throttle_lag_s: NotNegative
    brake_lag_s: NotNegative
    steering_lag_s: NotNegative
    """Time constants of the actuators; 0: they follow at once [s]."""
    steering_max_rad: Annotated[float, Meta(gt=0, le=1.5)]
    camera_m: Point
    headlamps_m: Point

    def __post_init__(self) -> None:
        if self.rear_overhang_m + self.wheelbase_m > self.length_m:
            raise ValueError(
                f"rear_overhang_m + wheelbase_m {self.rear_overhang_m + self.wheelbase_m:g} is "
                f"longer than length_m {self.length_m:g}"
            )

    @property
    def centre_offset_m(self) -> float:
        """Rear axle to the hull's centre, forward [m]."""
        return self.length_m / 2 - self.rear_overhang_m

    @property
    def front_offset_m(self) -> float:
        """Rear axle to front bumper [m]."""
        return self.length_m - self.rear_overhang_m


def load_vehicle(name_or_path: str) -> Vehicle:
    """Load a shipped vehicle by name, or a vehicle file by path.

    Raises:
        ValueError: no such vehicle, or a mistake in its file; one line.
    """
    return load_named(name_or_path, Vehicle, _MODELS, "vehicle")
