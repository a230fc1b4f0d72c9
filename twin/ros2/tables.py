"""Topic tables: which topic carries what, as which type, in which frame, at which quality.

A table is a YAML file; ``plain``, ``nav2`` and ``autoware`` are shipped. Names of topics and frames
may hold ``{name}``, which stands for the name of a camera, a LiDAR or another sensor, and
``{sensor}``, which stands for that of a sensor message.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from schemas.files.yaml_file import YamlError, load_yaml
from schemas.kinds.sensor import sensor_kinds
from schemas.validation import Mistake, convert_all
from twin.base.errors import UsageError

FOLDER = Path(__file__).parent / "shipped"
"""Folder of the shipped tables."""

TOPICS_MAX = 200
"""Most rows of a table, each way."""
TOPIC_CHARS_MAX = 200
"""Longest name of a topic or frame [characters]."""

SOURCES: dict[str, tuple[str, ...]] = {
    "clock": ("rosgraph_msgs/msg/Clock",),
    "tf": ("tf2_msgs/msg/TFMessage",),
    "tf_static": ("tf2_msgs/msg/TFMessage",),
    "episode": ("drivetwin_msgs/msg/Episode",),
    "tick": ("drivetwin_msgs/msg/Tick",),
    "array": ("drivetwin_msgs/msg/SensorArray",),
    "camera": ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
    "camera_info": ("sensor_msgs/msg/CameraInfo",),
    "depth": ("sensor_msgs/msg/Image",),
    "lidar": ("sensor_msgs/msg/PointCloud2",),
    "odometry": ("nav_msgs/msg/Odometry",),
    "velocity": ("autoware_vehicle_msgs/msg/VelocityReport",),
    "steering": ("autoware_vehicle_msgs/msg/SteeringReport",),
    "control_mode": ("autoware_vehicle_msgs/msg/ControlModeReport",),
    "boxes": ("vision_msgs/msg/Detection2DArray",),
    "objects": (
        "vision_msgs/msg/Detection3DArray",
        "autoware_perception_msgs/msg/TrackedObjects",
    ),
    # Sensors of the car whose declaration says so.
    **{kind.name: (kind.ros2.type_name,) for kind in sensor_kinds().declared if kind.ros2},
}
"""What a row may carry, and as which types."""

NAMED_SOURCES = ("camera", "camera_info", "depth", "lidar", "boxes")
"""Sources of which a car may have several, each with its place in the episode: their topics need
``{name}`` then."""

COMMAND_TYPES = (
    "drivetwin_msgs/msg/DriveCommand",
    "ackermann_msgs/msg/AckermannDriveStamped",
    "ackermann_msgs/msg/AckermannDrive",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "autoware_control_msgs/msg/Control",
    "autoware_vehicle_msgs/msg/GearCommand",
    "autoware_vehicle_msgs/msg/TurnIndicatorsCommand",
    "autoware_vehicle_msgs/msg/HazardLightsCommand",
)
"""Types that a stack may answer with."""

DRIVING_TYPES = COMMAND_TYPES[:6]
"""Those that move the car: a table has exactly one."""

# https://design.ros2.org/articles/topic_and_service_names.html
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_FRAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/.-]*")

Name = Annotated[str, Meta(max_length=TOPIC_CHARS_MAX)]


class Qos(Struct, frozen=True, forbid_unknown_fields=True):
    """Quality of service of a topic."""

    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    depth: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Messages that are kept for a slow reader."""


class SensorTopic(Struct, frozen=True, forbid_unknown_fields=True):
    """What the simulator sends."""

    topic: Name
    source: str
    """One of :data:`SOURCES`."""
    type: str = ""
    """One of the source's types; empty: its first."""
    frame: Name = ""
    """``header.frame_id``; empty: the frame of the source's own sensor."""
    layout: Literal["columns", "xyzirc"] = "columns"
    """Points of a LiDAR: ``columns``: all columns of the sensor, in order, NaN where nothing came
    back; ``xyzirc``: Autoware's PointXYZIRC, returns alone."""
    qos: Qos = Qos()


class CommandTopic(Struct, frozen=True, forbid_unknown_fields=True):
    """What the stack sends."""

    topic: Name
    type: str
    """One of :data:`COMMAND_TYPES`."""
    qos: Qos = Qos()


class FrameNames(Struct, frozen=True, forbid_unknown_fields=True):
    """Names of frames."""

    world: Name = "map"
    odom: Name = "odom"
    base: Name = "base_link"
    camera: Name = "{name}_link"
    optical: Name = "{name}_optical_frame"
    lidar: Name = "{name}_link"
    sensor: Name = "{name}_link"
    """Of another sensor."""


class FrameMount(Struct, frozen=True, forbid_unknown_fields=True):
    """Where a frame stands on the car, for those that the drive plane does not tell."""

    position_m: Annotated[list[float], Meta(min_length=3, max_length=3)]
    """x forward of ``base_link``, y left, z up [m]."""
    rotation_deg: Annotated[list[float], Meta(min_length=3, max_length=3)] = field(
        default_factory=lambda: [0.0, 0.0, 0.0]
    )
    """Roll, pitch (down positive) and yaw (left positive) [deg]."""


class TopicTable(Struct, frozen=True, forbid_unknown_fields=True):
    """A table."""

    table: Name
    sensors: Annotated[list[SensorTopic], Meta(max_length=TOPICS_MAX)]
    """What the simulator sends, in the order in which a tick's messages are sent."""
    commands: Annotated[list[CommandTopic], Meta(max_length=TOPICS_MAX)]
    """What the stack sends."""
    frames: FrameNames = FrameNames()
    mounts: Annotated[dict[str, FrameMount], Meta(max_length=TOPICS_MAX)] = {}
    """Mounts by name of a frame, for ``/tf_static``: of a radar, IMU or GNSS antenna."""

    def driving(self) -> CommandTopic:
        """The command that moves the car."""
        return next(row for row in self.commands if row.type in DRIVING_TYPES)


def type_of(row: SensorTopic) -> str:
    """Type of a row's messages."""
    return row.type or SOURCES[row.source][0]


def is_topic(name: str) -> bool:
    """Whether ROS 2 allows this full name of a topic: no part begins with a digit, no ``__``."""
    return len(name) <= 255 and "__" not in name and bool(_TOPIC.fullmatch(name))


def shipped_tables() -> list[str]:
    """Names of the tables that are shipped, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_table(name: str) -> TopicTable:
    """A shipped table by its name, or one of the user's by its path (``.yaml``).

    Raises:
        UsageError: no such table, or mistakes in it, a line for each.
    """
    if name.endswith((".yaml", ".yml")):
        path = Path(name)
    elif name in shipped_tables():
        path = FOLDER / f"{name}.yaml"
    else:
        raise UsageError(
            f"topic table '{name}' given, allowed: {', '.join(shipped_tables())}, "
            "or the path of a .yaml file"
        )
    try:
        data = load_yaml(path)
    except YamlError as error:
        raise UsageError(str(error)) from None
    table, mistakes = convert_all(data, TopicTable)
    if table is not None:
        mistakes = _mistakes(table)
    if table is None or mistakes:
        raise UsageError("\n".join(mistake.line(str(path)) for mistake in mistakes))
    return table


def _mistakes(table: TopicTable) -> list[Mistake]:
    found = []
    for number, row in enumerate(table.sensors):
        found += _sensor_mistakes(f"sensors[{number}]", row)
    for number, command in enumerate(table.commands):
        where = f"commands[{number}]"
        found += _name_mistakes(f"{where}.topic", command.topic)
        if command.type not in COMMAND_TYPES:
            found.append(_choice(f"{where}.type", command.type, COMMAND_TYPES))
    driving = [row.type for row in table.commands if row.type in DRIVING_TYPES]
    if len(driving) != 1:
        found.append(
            Mistake(
                "commands",
                f"{len(driving)} rows move the car ({', '.join(driving) or 'none'}); "
                f"exactly one must, of type {', '.join(DRIVING_TYPES)}",
            )
        )
    topics = Counter([row.topic for row in table.sensors] + [row.topic for row in table.commands])
    found += [
        Mistake("", f"topic {topic} stands in {count} rows; a topic has one type and one sender")
        for topic, count in topics.items()
        if count > 1
    ]
    for key in FrameNames.__struct_fields__:
        found += _frame_mistakes(f"frames.{key}", getattr(table.frames, key))
    return found


def _sensor_mistakes(where: str, row: SensorTopic) -> list[Mistake]:
    found = _name_mistakes(f"{where}.topic", row.topic)
    if row.source not in SOURCES:
        return [*found, _choice(f"{where}.source", row.source, tuple(SOURCES))]
    if row.type and row.type not in SOURCES[row.source]:
        found.append(_choice(f"{where}.type", row.type, SOURCES[row.source]))
    if row.source == "array" and "{sensor}" not in row.topic:
        found.append(Mistake(f"{where}.topic", f"given '{row.topic}', it must hold {{sensor}}"))
    if row.layout != "columns" and row.source != "lidar":
        found.append(Mistake(f"{where}.layout", "only rows with source lidar have a layout"))
    return found + (_frame_mistakes(f"{where}.frame", row.frame) if row.frame else [])


def _name_mistakes(where: str, topic: str) -> list[Mistake]:
    filled = topic.replace("{name}", "name").replace("{sensor}", "sensor")
    if is_topic(filled):
        return []
    return [
        Mistake(
            where,
            f"given '{topic}', expected a full topic name such as /sensing/imu "
            "(letters, digits, _ and /; it may hold {name})",
        )
    ]


def _frame_mistakes(where: str, frame: str) -> list[Mistake]:
    if _FRAME.fullmatch(frame.replace("{name}", "name")):
        return []
    return [
        Mistake(
            where, f"given '{frame}', expected a frame name such as base_link, without '/' first"
        )
    ]


def _choice(where: str, given: str, allowed: tuple[str, ...]) -> Mistake:
    return Mistake(where, f"given '{given}', allowed: {', '.join(allowed)}")
