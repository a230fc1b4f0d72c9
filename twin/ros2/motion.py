"""The car's own motion, the world's objects and the drive plane itself -> ROS 2 messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.messages import VEHICLE_COLUMNS, Episode
from twin.ros2.frames import Quaternion
from twin.ros2.sensing import SensorMessages

_SPEED, _YAW_RATE, _STEERING = (
    VEHICLE_COLUMNS.index(name) for name in ("speed_mps", "yaw_rate_radps", "steering_rad")
)

LABELS = {
    "car": 1,
    "van": 1,
    "truck": 2,
    "bus": 3,
    "trailer": 4,
    "motorcycle": 5,
    "bicycle": 6,
    "pedestrian": 7,
    "animal": 8,
}
"""Classes of autoware_perception_msgs/ObjectClassification by our names, of those of equal label
the usual one first; others are UNKNOWN."""

_BOX, _ORIENTED = 0, 2

# Largest length, width and height of a kind [m].
_SIZES = (
    ("pedestrian", 1.2, 1.2, 2.3),
    ("bicycle", 2.4, 1.1, 2.3),
    ("car", 5.3, 2.3, 1.9),
    ("van", 6.5, 2.3, 3.0),
    ("truck", 9.5, 3.0, 5.0),
)

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class TrueObject:
    """An object of the world at one time."""

    name: str
    """The same in every message; ASCII."""
    kind: str
    """``car``, ``van``, ``truck``, ``bus``, ``bicycle``, ``pedestrian`` or another word."""
    position_m: tuple[float, float, float]
    """Middle of its box in the world."""
    rotation: Quaternion
    """World from object."""
    size_m: tuple[float, float, float]
    """Length, width and height."""
    speed_mps: float = 0.0
    """Along its own x."""


def kind_of_size(size_m: Sequence[float]) -> str:
    """Kind of an object of which only length, width and height are known; without them a car."""
    if min(size_m[:2]) <= 0.0:
        return "car"
    fitting = (
        kind for kind, *most in _SIZES if all(s <= m for s, m in zip(size_m, most, strict=True))
    )
    return next(fitting, "bus")


class DriveMessages(SensorMessages):
    """Makes all messages that the simulator sends."""

    def clock(self, time_ns: int) -> Any:
        """rosgraph_msgs/Clock."""
        return self.store.make("rosgraph_msgs/msg/Clock", clock=self.time(time_ns))

    def transforms(self, transforms: Sequence[Any]) -> Any:
        """tf2_msgs/TFMessage."""
        return self.store.make("tf2_msgs/msg/TFMessage", transforms=list(transforms))

    def odometry(self, time_ns: int, frames: tuple[str, str], pose: Floats, vehicle: Floats) -> Any:
        """nav_msgs/Odometry.

        Args:
            time_ns: sim time.
            frames: of the pose and of the car.
            pose: row of ``POSE_COLUMNS``.
            vehicle: row of ``VEHICLE_COLUMNS``.
        """
        parent, child = frames
        speed, rate = self.vector(vehicle[_SPEED]), self.vector(z=vehicle[_YAW_RATE])
        return self.store.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time_ns, parent),
            child_frame_id=child,
            pose=self.pose_with_covariance(pose[:3].tolist(), pose[3:7].tolist()),
            twist=self.twist_with_covariance(speed, rate),
        )

    def velocity(self, time_ns: int, frame: str, vehicle: Floats) -> Any:
        """autoware_vehicle_msgs/VelocityReport."""
        return self.store.make(
            "autoware_vehicle_msgs/msg/VelocityReport",
            header=self.header(time_ns, frame),
            longitudinal_velocity=float(vehicle[_SPEED]),
            lateral_velocity=0.0,
            heading_rate=float(vehicle[_YAW_RATE]),
        )

    def steering(self, time_ns: int, vehicle: Floats) -> Any:
        """autoware_vehicle_msgs/SteeringReport."""
        return self.store.make(
            "autoware_vehicle_msgs/msg/SteeringReport",
            stamp=self.time(time_ns),
            steering_tire_angle=float(vehicle[_STEERING]),
        )

    def control_mode(self, time_ns: int) -> Any:
        """autoware_vehicle_msgs/ControlModeReport: the stack always drives."""
        name = "autoware_vehicle_msgs/msg/ControlModeReport"
        mode = self.store.constant(name, "AUTONOMOUS")
        return self.store.make(name, stamp=self.time(time_ns), mode=mode)

    def array(
        self, time_ns: int, frame: str, name: str, values: NDArray[Any], count: int = -1
    ) -> Any:
        """drivetwin_msgs/SensorArray: one sensor's array of one car, exactly."""
        dtype = values.dtype.newbyteorder("<")
        plain = np.ascontiguousarray(values, dtype)
        return self.store.make(
            "drivetwin_msgs/msg/SensorArray",
            header=self.header(time_ns, frame),
            name=name,
            dtype=dtype.str,
            shape=np.array(values.shape, np.uint32),
            count=count,
            data=plain.reshape(-1).view(np.uint8),
        )

    def tick(self, time_ns: int, tick: int, sensors: Sequence[str]) -> Any:
        """drivetwin_msgs/Tick."""
        return self.store.make(
            "drivetwin_msgs/msg/Tick", stamp=self.time(time_ns), tick=tick, sensors=list(sensors)
        )

    def episode(self, time_ns: int, episode: Episode) -> Any:
        """drivetwin_msgs/Episode. Slot and token are the bridge's own: 0 in the message."""
        plain = msgspec.structs.replace(episode, seq=0, slot=0, token=0)
        return self.store.make(
            "drivetwin_msgs/msg/Episode",
            stamp=self.time(time_ns),
            case_name=episode.case,
            seed=episode.seed,
            control_period_s=episode.control_period_ns / 1e9,
            msgpack=np.frombuffer(msgspec.msgpack.encode(plain), np.uint8),
        )

    def detections(self, time_ns: int, frame: str, objects: Sequence[TrueObject]) -> Any:
        """vision_msgs/Detection3DArray of the truth; ``id`` is the object's name."""
        header = self.header(time_ns, frame)
        found = []
        for each in objects:
            x, y, z = each.size_m
            box = self.store.make(
                "vision_msgs/msg/BoundingBox3D",
                center=self.pose(each.position_m, each.rotation),
                size=self.vector(x, y, z),
            )
            found.append(
                self.store.make(
                    "vision_msgs/msg/Detection3D",
                    header=header,
                    results=[self.hypothesis(each.kind, each.position_m, each.rotation)],
                    bbox=box,
                    id=each.name,
                )
            )
        return self.store.make("vision_msgs/msg/Detection3DArray", header=header, detections=found)

    def tracked_objects(self, time_ns: int, frame: str, objects: Sequence[TrueObject]) -> Any:
        """autoware_perception_msgs/TrackedObjects of the truth."""
        return self.store.make(
            "autoware_perception_msgs/msg/TrackedObjects",
            header=self.header(time_ns, frame),
            objects=[self._tracked(each) for each in objects],
        )

    def _tracked(self, each: TrueObject) -> Any:
        package = "autoware_perception_msgs/msg"
        accel = self.store.make(
            "geometry_msgs/msg/Accel", linear=self.vector(), angular=self.vector()
        )
        kinematics = self.store.make(
            f"{package}/TrackedObjectKinematics",
            pose_with_covariance=self.pose_with_covariance(each.position_m, each.rotation),
            twist_with_covariance=self.twist_with_covariance(
                self.vector(each.speed_mps), self.vector()
            ),
            acceleration_with_covariance=self.store.make(
                "geometry_msgs/msg/AccelWithCovariance", accel=accel, covariance=np.zeros(36)
            ),
            orientation_availability=_ORIENTED,
            is_stationary=each.speed_mps == 0.0,
        )
        x, y, z = each.size_m
        shape = self.store.make(
            f"{package}/Shape",
            type=_BOX,
            footprint=self.store.make("geometry_msgs/msg/Polygon", points=[]),
            dimensions=self.vector(x, y, z),
        )
        label = self.store.make(
            f"{package}/ObjectClassification", label=LABELS.get(each.kind, 0), probability=1.0
        )
        # A name is the same object in every message: 16 bytes of it are its UUID.
        number = np.frombuffer(each.name.encode()[:16].ljust(16, b"\0"), np.uint8)
        return self.store.make(
            f"{package}/TrackedObject",
            object_id=self.store.make("unique_identifier_msgs/msg/UUID", uuid=number),
            existence_probability=1.0,
            classification=[label],
            kinematics=kinematics,
            shape=shape,
        )
