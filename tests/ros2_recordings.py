"""Recordings as others make them: other frames, types and names than ours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from twin.ros2.frames import of_angles
from twin.ros2.motion import DriveMessages, TrueObject
from twin.ros2.store import type_store

STORE = type_store()
MAKE = DriveMessages(STORE)
START_NS = 1_700_000_000_000_000_000
"""As a clock on the wall shows it."""
PERIOD_NS = 100_000_000

Row = tuple[str, int, Any]
"""Topic, time [ns] and message."""


def write_bag(
    folder: Path, rows: Sequence[Row], storage: StoragePlugin = StoragePlugin.MCAP
) -> Path:
    """A folder of rosbag2."""
    channels: dict[str, Any] = {}
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        for topic, time_ns, message in rows:
            name = message.__msgtype__
            if topic not in channels:
                channels[topic] = writer.add_connection(
                    topic,
                    name,
                    msgdef=STORE.definition(name),
                    rihs01=STORE.type_hash(name),
                )
            writer.write(channels[topic], time_ns, STORE.encode(message))
    return folder


def turning_place(time_s: float) -> tuple[float, float, float]:
    """x, y and heading on a circle of 80 m radius at 8 m/s."""
    angle = 8.0 * time_s / 80.0
    return 500.0 + 80.0 * math.sin(angle), 300.0 + 80.0 * (1.0 - math.cos(angle)), angle


def odometry(time_ns: int, at: tuple[float, float, float], frame: str = "map") -> Any:
    """nav_msgs/Odometry."""
    x, y, heading = at
    pose = np.array([x, y, 12.5, *of_angles(0.0, 0.0, heading)])
    vehicle = np.array([8.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    return MAKE.odometry(time_ns, (frame, "base_link"), pose, vehicle)


def transform(
    time_ns: int, parent: str, child: str, at: tuple[float, float, float], heading: float = 0.0
) -> Any:
    """tf2_msgs/TFMessage of one transform."""
    turn = of_angles(0.0, 0.0, heading)
    return MAKE.transforms([MAKE.transform(time_ns, parent, child, at, turn)])


def tracked(time_ns: int, frame: str, objects: Sequence[TrueObject]) -> Any:
    """autoware_perception_msgs/TrackedObjects."""
    return MAKE.tracked_objects(time_ns, frame, objects)


def ahead(name: str, kind: str, x: float, y: float, heading: float = 0.0) -> TrueObject:
    """An object at a place of some frame."""
    turn = of_angles(0.0, 0.0, heading)
    return TrueObject(name, kind, (x, y, 0.7), turn, (4.4, 1.8, 1.4), 5.0)


def circle_rows(ticks: int = 40) -> list[Row]:
    """A drive on a circle: odometry, and a car 20 m ahead in the axes of the ego."""
    rows: list[Row] = []
    for tick in range(ticks):
        time_ns = START_NS + tick * PERIOD_NS
        rows.append(("/odom", time_ns, odometry(time_ns, turning_place(0.1 * tick))))
        seen = [ahead("lead", "car", 20.0, 1.0, 0.2)]
        rows.append(("/tracks", time_ns, tracked(time_ns, "base_link", seen)))
    return rows
