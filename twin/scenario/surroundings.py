"""Where a case takes place, as far as its scenario looks at it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas.kinds.scenario import ScenarioKind
from twin.road.lane import LanePath

if TYPE_CHECKING:  # who judges what is written needs no world
    from twin.vehicle.vehicle_file import Vehicle
    from twin.world.street.build import World


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The ego's lane, the target of the scenario, and how large the ego is."""

    lane: LanePath
    target: np.ndarray | None
    """Hull of what the scenario is about [5]: x, y [m], yaw [rad], half length and width [m]; None:
    it is not in this scene."""
    centre_offset_m: float
    """Distance from the ego's reference point to the middle of its hull, forward [m]."""
    half_length_m: float
    half_width_m: float
    further: tuple[np.ndarray | None, ...] = ()
    """Hulls of the scenario's further targets, like ``target``, in the order of its declaration."""
    front_offset_m: float = 0.0
    """Distance from the ego's reference point to its front bumper; not in records [m]."""
    scene: str = ""
    """Name of the scene, for messages; not in records."""
    street: bool = True
    """The scene has a street with lanes; not in records."""
    target_name: str = ""
    """Name of the target, where a trial is about one."""
    events: tuple[str, ...] = ()
    """Names of what may happen in the case, in the order of its file."""

    @classmethod
    def of(
        cls, world: World, vehicle: Vehicle, kind: ScenarioKind, scene: str, *, street: bool
    ) -> Surroundings:
        """Surroundings of a vehicle in a world, as far as a family looks at them."""

        def hull(name: str) -> np.ndarray | None:
            index = world.collider_of(name)
            return None if index is None else world.colliders[index]

        return cls(
            lane=world.lane,
            target=hull(kind.target),
            centre_offset_m=vehicle.centre_offset_m,
            half_length_m=vehicle.length_m / 2,
            half_width_m=vehicle.width_m / 2,
            further=tuple(hull(name) for name in kind.further_targets),
            front_offset_m=vehicle.front_offset_m,
            scene=scene,
            street=street,
        )

    def before_target(self, distance_m: float) -> tuple[float, float, float]:
        """World x, y [m] and heading [rad] on the lane, ``distance_m`` before the target's rear
        bumper; along the lane. Without a target, where the lane begins."""
        return place_before(self.lane, self.target, distance_m)


def place_before(
    lane: LanePath, hull: np.ndarray | None, distance_m: float
) -> tuple[float, float, float]:
    """World x, y [m] and heading [rad] on a lane, ``distance_m`` before the rear of a hull [5];
    without one, where the lane begins."""
    if hull is None:
        pose = lane.at(0.0)
        return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)
    x, y, yaw, half_length, _ = hull.tolist()
    if not lane.closed:
        return x - half_length - distance_m, 0.0, 0.0
    rear = (x - half_length * math.cos(yaw), y - half_length * math.sin(yaw))
    pose = lane.at(lane.locate(*rear).s_m - distance_m)
    return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)
