"""Near field of a LiDAR: which share of the light scattered nearby reaches the detector.

Spinning sensors send through one lens and receive through another beside it. The receiver is
focused far away, so it sees a nearby point as a disc of the angle aperture / R that is displaced by
the angle distance of the axes / R. The detector catches the part of the disc that falls on it. This
is the overlap of a biaxial lidar with defocus (Measures, Laser Remote Sensing, 1984, chapter 7.2;
Stelmaszczyk et al., Appl. Opt. 44, 2005), integrated over a Gaussian beam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lidar import LidarProfile

BEAM_M = 0.010
"""Width of the beam where it leaves the sensor [m]: data sheets of the class say 9 to 13 mm."""
APERTURE_M = 0.025
"""Diameter of the receiver's lens [m], the one that ``focus_m`` of a profile is reckoned with."""
BASELINE_M = 0.5 * (BEAM_M + APERTURE_M)
"""Between the axes of beam and receiver [m]: as near as two lenses can be."""

_RINGS, _SPOKES = 8, 6
_REACH = 1.6
"""Radius of the beam that is looked at, over its radius at 1 / e^2 [-]: all but 0.6 % of the
pulse."""


@dataclass(frozen=True, slots=True)
class NearField:
    """A beam at some ranges, cut into pieces of equal area."""

    piece_m2: np.ndarray
    """Area of one piece [R]."""
    irradiance: np.ndarray
    """Of the pieces, over that of a beam which fills its ellipse evenly [R, P]."""
    caught: np.ndarray
    """Share of a piece's light that reaches the detector, over that of the whole beam far away
    [R, P]."""

    @property
    def mean(self) -> np.ndarray:
        """Share that is caught of all the beam's light, 1 far away [R]."""
        weight = self.irradiance / self.irradiance.sum(axis=1, keepdims=True)
        return np.asarray((weight * self.caught).sum(axis=1))


def near_field(profile: LidarProfile, range_m: np.ndarray) -> NearField:
    """The beam of ``profile`` at ``range_m`` [R]; shares are relative to ``range_10_percent_m``,
    from which the detection threshold is reckoned."""
    at = np.append(range_m, profile.range_10_percent_m)
    radius = _REACH * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
    angle = np.pi * (np.arange(_SPOKES) + 0.5) / _SPOKES  # the other half mirrors this one
    wide, high = (0.5 * size for size in beam_size(profile, at))
    across = BASELINE_M + np.outer(wide, np.outer(radius, np.cos(angle)))
    up = np.outer(high, np.outer(radius, np.sin(angle)))
    caught = on_detector(profile, at[:, None], np.hypot(across, up))
    gauss = np.repeat(2.0 * np.exp(-2.0 * radius**2), _SPOKES)
    far = (gauss * caught[-1]).sum() / gauss.sum()
    pieces = _RINGS * _SPOKES
    return NearField(
        piece_m2=(np.pi * _REACH**2 * wide * high / pieces)[:-1],
        irradiance=np.broadcast_to(gauss, (len(range_m), pieces)),
        caught=caught[:-1] / far,
    )


def beam_size(profile: LidarProfile, range_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Width and height of the beam [m]."""
    wide, high = (BEAM_M + 1e-3 * angle * range_m for angle in profile.divergence_mrad)
    return wide, high


def on_detector(profile: LidarProfile, range_m: np.ndarray, off_m: np.ndarray) -> np.ndarray:
    """Share of the blur disc of a point that lies on the detector, both round [-].

    Args:
        profile: of the sensor.
        range_m: of the point, broadcastable to ``off_m``.
        off_m: of the point from the receiver's axis.
    """
    if profile.focus_m <= 0.0:
        return np.ones(off_m.shape)
    disc = np.broadcast_to(0.5 * APERTURE_M / range_m, off_m.shape)
    # A detector that is smaller than the image of the beam would be of no use.
    field = 0.5 * max(APERTURE_M / profile.focus_m, 1e-3 * max(profile.divergence_mrad))
    apart = np.maximum(off_m / range_m, 1e-9)
    inside = np.pi * np.minimum(disc, field) ** 2
    a = np.clip((apart**2 + disc**2 - field**2) / (2.0 * apart * disc), -1.0, 1.0)
    b = np.clip((apart**2 + field**2 - disc**2) / (2.0 * apart * field), -1.0, 1.0)
    root = (disc + field - apart) * (apart + disc - field) * (apart - disc + field)
    root = np.sqrt(np.maximum(root * (apart + disc + field), 0.0))
    common = disc**2 * np.arccos(a) + field**2 * np.arccos(b) - 0.5 * root
    common = np.where(apart >= disc + field, 0.0, common)
    common = np.where(apart <= np.abs(disc - field), inside, common)
    return np.asarray(common / (np.pi * disc**2))
