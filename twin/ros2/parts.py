"""Small ROS 2 messages of which the large ones are made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.ros2.frames import Quaternion
from twin.ros2.store import TypeStore

NANOSECONDS = 1_000_000_000


class MessageParts:
    """Makes the parts, of one store's types."""

    def __init__(self, store: TypeStore) -> None:
        self.store = store

    def time(self, time_ns: int) -> Any:
        """builtin_interfaces/Time."""
        seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
        return self.store.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def header(self, time_ns: int, frame: str) -> Any:
        """std_msgs/Header."""
        return self.store.make("std_msgs/msg/Header", stamp=self.time(time_ns), frame_id=frame)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        """geometry_msgs/Vector3."""
        return self.store.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def point(self, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Point."""
        return self.store.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))

    def quaternion(self, turn: Sequence[float]) -> Any:
        """geometry_msgs/Quaternion of x, y, z, w."""
        x, y, z, w = (float(part) for part in turn)
        return self.store.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, position_m: Sequence[float], turn: Sequence[float]) -> Any:
        """geometry_msgs/Pose."""
        x, y, z = position_m
        return self.store.make(
            "geometry_msgs/msg/Pose",
            position=self.point(x, y, z),
            orientation=self.quaternion(turn),
        )

    def pose_with_covariance(self, position_m: Sequence[float], turn: Sequence[float]) -> Any:
        """geometry_msgs/PoseWithCovariance; all zeros: the covariance is not known."""
        return self.store.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self.pose(position_m, turn),
            covariance=np.zeros(36),
        )

    def twist_with_covariance(self, linear: Any, angular: Any) -> Any:
        """geometry_msgs/TwistWithCovariance."""
        twist = self.store.make("geometry_msgs/msg/Twist", linear=linear, angular=angular)
        return self.store.make(
            "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
        )

    def transform(
        self,
        time_ns: int,
        parent: str,
        child: str,
        position_m: Sequence[float],
        turn: Quaternion,
    ) -> Any:
        """geometry_msgs/TransformStamped: where ``child`` is in ``parent``."""
        x, y, z = position_m
        return self.store.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(time_ns, parent),
            child_frame_id=child,
            transform=self.store.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(x, y, z),
                rotation=self.quaternion(turn),
            ),
        )


def nanoseconds_of(time: Any) -> int:
    """A builtin_interfaces/Time [ns]."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
