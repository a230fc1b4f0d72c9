"""What one sensor sees of the objects around S cars at one instant, in arrays [S, M].

Axes of the vehicle: x forward from the middle of the rear axle, y left [m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LABELS = ("", "car", "truck", "bus", "pedestrian", "bicycle")
"""What an object is, by index; 0: nobody has said."""


PERSONS = (LABELS.index("pedestrian"), LABELS.index("bicycle"))
"""Labels of who is no vehicle."""
SIDEWAYS_SHARE = 0.04
"""Variance of a new track's speed across, relative to that along [-]."""
CROSSES_MPS = 2.0
"""What moves so fast along a ray that leads aside may as well cross [m/s]."""


def is_person(label: np.ndarray) -> np.ndarray:
    """Whether labels are of pedestrians and cyclists."""
    person: np.ndarray = (label == PERSONS[0]) | (label == PERSONS[1])
    return person


@dataclass(slots=True, eq=False)
class Sightings:
    """M places per slot; those that are not ``valid`` hold zeros."""

    valid: np.ndarray
    """bool [S, M]."""
    beside: np.ndarray
    """bool [S, M]: far beside the road, where only what crosses counts."""
    x_m: np.ndarray
    """Near end of the object."""
    sigma_m: np.ndarray
    """Deviation of the near end along x."""
    right_m: np.ndarray
    """Its right end, left of the vehicle's middle."""
    left_m: np.ndarray
    """Its left end."""
    inside: np.ndarray
    """bool [S, M]: it reaches into the path."""
    path_x_m: np.ndarray
    """Nearest part of it that is in the path; ``x_m`` where it is outside."""
    label: np.ndarray
    """int [S, M]: index into :data:`LABELS`."""
    place: np.ndarray
    """int [S, M]: index in the list of the sensor, for pictures."""
    radial_mps: np.ndarray
    """Speed over ground along the ray, positive: away; NaN where the sensor measures none."""
    radial_sigma_mps: np.ndarray
    """Its deviation."""
    ray_y: np.ndarray
    """Sine of the ray's direction, left positive [-]."""

    @classmethod
    def empty(cls, slots: int, places: int) -> Sightings:
        """Nothing seen anywhere; at least one place, since what is picked from none is an error."""
        places = max(places, 1)

        def zeros() -> np.ndarray:
            return np.zeros((slots, places))

        return cls(
            *(np.zeros((slots, places), bool), np.zeros((slots, places), bool), zeros()),
            *(np.ones((slots, places)), zeros()),
            *(zeros(), np.zeros((slots, places), bool), zeros()),
            *(np.zeros((slots, places), np.int64), np.zeros((slots, places), np.int64)),
            *(np.full((slots, places), np.nan), np.ones((slots, places)), zeros()),
        )


def sideways_share(ray_y: np.ndarray, radial_mps: np.ndarray) -> np.ndarray:
    """Variance of a speed across that is not known yet, relative to that along: who moves along a
    ray of 30 degrees or more drives across as likely as along."""
    square = 4.0 * ray_y * ray_y
    share = np.clip(square * square, SIDEWAYS_SHARE, 1.0)
    # Comparisons with NaN, no radial speed, are false.
    return np.where(np.abs(radial_mps) > CROSSES_MPS, share, SIDEWAYS_SHARE)
