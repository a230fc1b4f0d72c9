"""What a file says about a camera's lens: projection, distortion, focus, shutter, imperfections.

A lens keeps to shares of the image, so one lens serves every resolution. Distances are in the
camera frame: x right, y down, z forward; image coordinates have their origin in the upper left
corner, pixel centres lie at half numbers.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

Effect = Literal[
    "depth_of_field", "motion_blur", "bloom", "chromatic_aberration", "vignette", "grain"
]
"""A step of the post-processing."""
EFFECTS: tuple[str, ...] = Effect.__args__  # type: ignore[attr-defined]
"""All effects, in the order in which light meets them."""

Focal = Annotated[float, Meta(ge=0, le=20)]
Centre = Annotated[float, Meta(ge=-1, le=2)]
Coefficient = Annotated[float, Meta(ge=-1000, le=1000)]
Tangential = Annotated[float, Meta(ge=-0.1, le=0.1)]
"""Coefficient of tangential distortion; real lenses stay below 0.01."""
Offset = Annotated[float, Meta(ge=-100, le=100)]
Position = Annotated[list[Annotated[float, Meta(ge=-20, le=20)]], Meta(min_length=3, max_length=3)]
Rotation = Annotated[
    list[Annotated[float, Meta(ge=-360, le=360)]], Meta(min_length=3, max_length=3)
]

_RADIAL = ("k1", "k2", "k3", "k4")
_BROWN_ONLY = ("k5", "k6", "p1", "p2")
_OFFSETS = ("left_m", "right_m", "top_m", "bottom_m")


class Lens(Struct, frozen=True, forbid_unknown_fields=True):
    """Projection and optics of a camera.

    ``fx = 0`` takes the focal length from the camera's ``hfov_deg``: the angle that the image's
    width covers, distortion included, were the principal point in its middle.
    """

    model: Literal["frustum", "pinhole", "brown_conrady", "fisheye"] = "pinhole"
    """``frustum``: planes and offsets; ``pinhole``: no distortion; ``brown_conrady``: OpenCV's
    ``projectPoints`` (Brown 1971, rational with k4 to k6); ``fisheye``: OpenCV's ``fisheye``
    (Kannala and Brandt 2006)."""

    fx: Focal = 0.0
    """Focal length as a share of the image width; 0: from the field of view [-]."""
    fy: Focal = 0.0
    """Focal length as a share of the image height; 0: square pixels [-]."""
    cx: Centre = 0.5
    """Principal point from the left, as a share of the image width [-]."""
    cy: Centre = 0.5
    """Principal point from the top, as a share of the image height [-]."""

    k1: Coefficient = 0.0
    """Radial distortion, of r^2 (brown_conrady) or theta^2 (fisheye) [-]."""
    k2: Coefficient = 0.0
    """Radial distortion, of the fourth power [-]."""
    p1: Tangential = 0.0
    """Tangential distortion, vertical; brown_conrady only [-]."""
    p2: Tangential = 0.0
    """Tangential distortion, horizontal; brown_conrady only [-]."""
    k3: Coefficient = 0.0
    """Radial distortion, of the sixth power [-]."""
    k4: Coefficient = 0.0
    """Radial distortion, of r^2 in the denominator (brown_conrady), of theta^8 (fisheye) [-]."""
    k5: Coefficient = 0.0
    """Radial distortion, of r^4 in the denominator; brown_conrady only [-]."""
    k6: Coefficient = 0.0
    """Radial distortion, of r^6 in the denominator; brown_conrady only [-]."""
    circle_deg: Annotated[float, Meta(gt=0, le=360)] = 360.0
    """Angle across the image circle of a fisheye lens; black outside it [deg]."""

    near_m: Annotated[float, Meta(gt=0, le=100)] = 0.1
    """Near plane: nothing before it is in the picture [m]."""
    far_m: Annotated[float, Meta(gt=0, le=10_000)] = 1200.0
    """Far plane: nothing behind it but the sky is in the picture [m]."""
    left_m: Offset = 0.0
    """Left edge of the image on the near plane, right of the axis is positive; frustum only. All
    four offsets 0: from the field of view [m]."""
    right_m: Offset = 0.0
    """Right edge of the image on the near plane; frustum only [m]."""
    top_m: Offset = 0.0
    """Upper edge of the image on the near plane, above the axis is positive; frustum only [m]."""
    bottom_m: Offset = 0.0
    """Lower edge of the image on the near plane; frustum only [m]."""

    sensor_width_mm: Annotated[float, Meta(ge=0.5, le=100)] = 5.76
    """Width of the image on the sensor (1920 pixels of 3 um, as on onsemi's AR0233AT for cars);
    the focal length in millimetres is ``fx`` times this [mm]."""
    f_number: Annotated[float, Meta(ge=0.5, le=64)] = 2.0
    """Focal length over the diameter of the aperture (1.6 to 2.0 is usual on cars) [-]."""
    focus_m: Annotated[float, Meta(ge=0.05, le=10_000)] = 20.0
    """Distance at which objects are sharp (chosen: the middle of what matters to a car) [m]."""
    shutter_s: Annotated[float, Meta(ge=0, le=1)] = 0.011
    """Exposure time; the time stamp is its middle (11 ms outlasts a period of the 90 Hz at which
    LED lamps on cars are pulsed) [s]."""

    bloom: Annotated[float, Meta(ge=0, le=1)] = 0.04
    """Share of the light that the lens scatters around its image (chosen: the veiling glare index
    of good lenses is a few per cent) [-]."""
    chromatic_aberration: Annotated[float, Meta(ge=0, le=0.05)] = 0.0015
    """Share by which the red image is larger and the blue one smaller than the green one (chosen:
    half a pixel in the corner of 640x360) [-]."""
    vignette: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """Share of the natural fall-off with the fourth power of the cosine that is left in [-]."""
    grain: Annotated[float, Meta(ge=0, le=1)] = 0.04
    """Standard deviation of the grain, relative to a dark signal; it fades in highlights
    (chosen by eye: ISO 400 film) [-]."""

    def __post_init__(self) -> None:
        if self.far_m <= self.near_m:
            raise ValueError(
                f"near_m {self.near_m:g}, far_m {self.far_m:g}: far_m must be larger than near_m"
            )
        models = {
            **dict.fromkeys(_RADIAL, ("brown_conrady", "fisheye")),
            **dict.fromkeys(_BROWN_ONLY, ("brown_conrady",)),
            **dict.fromkeys(_OFFSETS, ("frustum",)),
            **dict.fromkeys(("fx", "fy"), ("pinhole", "brown_conrady", "fisheye")),
        }
        for name, allowed in models.items():
            if getattr(self, name) != 0.0 and self.model not in allowed:
                raise ValueError(
                    f"{name} {getattr(self, name):g} with model {self.model}: "
                    f"{name} belongs to {' or '.join(allowed)}; remove it or change the model"
                )
        if any(getattr(self, name) != 0.0 for name in _OFFSETS) and (
            self.right_m <= self.left_m or self.top_m <= self.bottom_m
        ):
            raise ValueError(
                f"left_m {self.left_m:g}, right_m {self.right_m:g}, bottom_m {self.bottom_m:g}, "
                f"top_m {self.top_m:g}: right_m must be larger than left_m and top_m than bottom_m"
            )


class CameraMount(Struct, frozen=True, forbid_unknown_fields=True):
    """Where a camera sits on the vehicle, and its lens."""

    position_m: Position
    """x forward of the vehicle's reference point, y left, z up [m]."""
    rotation_deg: Rotation = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll about x (forward), pitch about y (left; positive looks down), yaw about z (up; positive
    looks left), applied in this order about the vehicle's axes [deg]."""
    lens: Lens = Lens()
