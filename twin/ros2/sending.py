"""One car's tick on the drive plane -> the messages of a topic table, in the table's order.

The bridge sends them and a recording holds them: both take them from here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from schemas.escape import escape
from schemas.kinds.sensor import sensor_kinds
from schemas.messages import CameraSite, Episode, LidarSite
from twin.base.errors import UsageError
from twin.ros2.frames import IDENTITY, OPTICAL, StaticFrame, of_mount
from twin.ros2.motion import DriveMessages, TrueObject
from twin.ros2.store import TypeStore
from twin.ros2.tables import NAMED_SOURCES, Qos, SensorTopic, TopicTable, is_topic, type_of


@dataclass(frozen=True, slots=True)
class TopicMessage:
    """A message and where it goes."""

    topic: str
    type_name: str
    message: Any
    qos: Qos
    time_ns: int
    """Sim time of the tick."""


@dataclass(frozen=True, slots=True)
class CarTick:
    """What one car's sensors saw at one tick, without the axis of slots."""

    tick: int
    time_ns: int
    """Sim time since reset [ns]."""
    sensors: Mapping[str, NDArray[Any]]
    """Array by name of the sensor message; a sensor that is not due is absent."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Valid rows of ragged sensors."""
    objects: Sequence[TrueObject] | None = None
    """The world's objects, for those with a right to the truth; None: they are not told."""

    def rows(self, name: str) -> NDArray[Any]:
        """Valid rows of a sensor."""
        values = self.sensors[name]
        count = self.counts.get(name, -1)
        return values if count < 0 else values[:count]


class TableSender:
    """Makes a table's messages for one case."""

    def __init__(self, table: TopicTable, episode: Episode, store: TypeStore) -> None:
        """Look the types of the table up.

        Raises:
            UsageError: two cameras or LiDARs of the case would share a topic, or the name of one
                makes a topic that ROS 2 does not allow.
        """
        self.table = table
        self.episode = episode
        self._make = DriveMessages(store)
        self._cameras = {site.message: site for site in episode.cameras}
        self._lidars = {site.message: site for site in episode.lidars}
        self._covered = {row.source for row in table.sensors}
        self._makers: dict[str, Callable[[SensorTopic, CarTick], Iterator[tuple[str, Any]]]] = {
            "camera": self._pictures,
            "camera_info": self._camera_infos,
            "depth": self._depths,
            "lidar": self._sweeps,
            "boxes": self._boxes,
            "array": self._arrays,
            **{kind.name: self._formed for kind in sensor_kinds().declared if kind.ros2},
        }
        for row in table.sensors:
            sites = self._lidars if row.source == "lidar" else self._cameras
            several = row.source in NAMED_SOURCES and len(sites) > 1
            if several and "{name}" not in row.topic:
                names = ", ".join(site.name for site in sites.values())
                raise UsageError(
                    f"topic table '{table.table}': {row.topic} would carry {names}; "
                    "its name must hold {name}"
                )
            for topic, name in self._filled(row):
                if not is_topic(topic):
                    raise UsageError(
                        f"topic table '{table.table}': the name of {name} makes the topic "
                        f"{escape(topic)}, allowed: letters, digits and single underscores, no "
                        "digit first; take another name, or a table without {name} in that topic"
                    )

    def _filled(self, row: SensorTopic) -> Iterator[tuple[str, str]]:
        """Topics of a row by which cameras, LiDARs and sensors the case has, and names of these."""
        if row.source == "lidar":
            for lidar in self._lidars.values():
                yield _named(row.topic, lidar.name), f"LiDAR {lidar.name}"
        elif row.source in NAMED_SOURCES:
            for camera in self._cameras.values():
                yield _named(row.topic, camera.name), f"camera {camera.name}"
        elif row.source == "array":
            for message in (*self._cameras, *self._lidars):
                if message.partition(".")[0] in self._covered:
                    continue
                yield _array_topic(row, message), f"sensor {message}"
        elif self._makers.get(row.source) == self._formed:
            yield _named(row.topic, row.source), f"sensor {row.source}"

    def start(self) -> list[TopicMessage]:
        """What is sent once, before the first tick: static frames and the episode."""
        messages: list[TopicMessage] = []
        for row in self.table.sensors:
            if row.source == "tf_static":
                frames = [
                    self._make.transform(0, each.parent, each.child, each.position_m, each.rotation)
                    for each in self.static_frames()
                ]
                messages.append(self._sent(row, row.topic, self._make.transforms(frames), 0))
            elif row.source == "episode":
                message = self._make.episode(0, self.episode)
                messages.append(self._sent(row, row.topic, message, 0))
        return messages

    def tick(self, car: CarTick) -> list[TopicMessage]:
        """What is sent for one tick."""
        messages: list[TopicMessage] = []
        for row in self.table.sensors:
            if row.source in ("tf_static", "episode"):
                continue
            maker = self._makers.get(row.source, self._single)
            messages += [
                self._sent(row, topic, message, car.time_ns) for topic, message in maker(row, car)
            ]
        return messages

    def static_frames(self) -> list[StaticFrame]:
        """Frames that stand still, parents first: cameras, LiDARs, and the table's mounts."""
        names = self.table.frames
        frames = [StaticFrame(names.world, names.odom, (0.0, 0.0, 0.0), IDENTITY)]
        for camera in self.episode.cameras:
            body = _named(names.camera, camera.name)
            frames.append(_mounted(names.base, body, camera.position_m, camera.rotation_deg))
            optical = _named(names.optical, camera.name)
            frames.append(StaticFrame(body, optical, (0.0, 0.0, 0.0), OPTICAL))
        for lidar in self.episode.lidars:
            child = _named(names.lidar, lidar.name)
            frames.append(_mounted(names.base, child, lidar.position_m, lidar.rotation_deg))
        for child, mount in sorted(self.table.mounts.items()):
            frames.append(_mounted(names.base, child, mount.position_m, mount.rotation_deg))
        return frames

    def _sent(self, row: SensorTopic, topic: str, message: Any, time_ns: int) -> TopicMessage:
        return TopicMessage(topic, type_of(row), message, row.qos, time_ns)

    def _single(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        """Rows of which there is one message per tick, if its sensors are due."""
        message = self._single_message(row, car)
        if message is not None:
            yield row.topic, message

    def _single_message(self, row: SensorTopic, car: CarTick) -> Any | None:
        make, names, due = self._make, self.table.frames, car.sensors
        time_ns, source = car.time_ns, row.source
        if source == "clock":
            return make.clock(time_ns)
        if source == "tick":
            return make.tick(time_ns, car.tick, list(due))
        if source == "control_mode":
            return make.control_mode(time_ns)
        if source == "velocity" and "vehicle" in due:
            return make.velocity(time_ns, row.frame or names.base, due["vehicle"])
        if source == "steering" and "vehicle" in due:
            return make.steering(time_ns, due["vehicle"])
        if source == "objects" and car.objects is not None:
            make_objects = (
                make.detections if type_of(row).startswith("vision") else make.tracked_objects
            )
            return make_objects(time_ns, row.frame or names.world, car.objects)
        if source == "odometry" and {"pose", "vehicle"} <= set(due):
            frames = (row.frame or names.odom, names.base)
            return make.odometry(time_ns, frames, due["pose"], due["vehicle"])
        if source == "tf" and "pose" in due:
            pose = due["pose"].tolist()
            x, y, z, w = pose[3:7]
            moved = make.transform(time_ns, names.odom, names.base, pose[:3], (x, y, z, w))
            return make.transforms([moved])
        return None

    def _pictures(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        whole = type_of(row).endswith("/Image")
        make = self._make.image if whole else self._make.compressed_image
        for site in self._due(self._cameras, car):
            pixels = car.sensors[site.message]
            yield _named(row.topic, site.name), make(car.time_ns, self._optical(row, site), pixels)

    def _camera_infos(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        for site in self._due(self._cameras, car):
            message = self._make.camera_info(car.time_ns, self._optical(row, site), site)
            yield _named(row.topic, site.name), message

    def _depths(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        for site in self._cameras.values():
            if (name := _of_kind("depth", site)) in car.sensors:
                frame = self._optical(row, site)
                message = self._make.image(car.time_ns, frame, car.sensors[name])
                yield _named(row.topic, site.name), message

    def _boxes(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        for site in self._cameras.values():
            if (name := _of_kind("boxes", site)) in car.sensors:
                frame = self._optical(row, site)
                message = self._make.boxes(car.time_ns, frame, car.rows(name))
                yield _named(row.topic, site.name), message

    def _sweeps(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        for site in self._due(self._lidars, car):
            frame = _named(row.frame or self.table.frames.lidar, site.name)
            # The count is that of returns: they are not the first rows.
            rows = car.sensors[site.message]
            message = self._make.points(car.time_ns, frame, site, rows, row.layout)
            yield _named(row.topic, site.name), message

    def _formed(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        """Sensors whose declarations say which message they become."""
        kind = sensor_kinds().find(row.source)
        if kind.ros2 is not None and kind.name in car.sensors:
            frame = _named(row.frame or self.table.frames.sensor, kind.name)
            rows = car.rows(kind.name)
            message = self._make.of_form(car.time_ns, frame, kind.ros2, kind.columns, rows)
            yield _named(row.topic, kind.name), message

    def _arrays(self, row: SensorTopic, car: CarTick) -> Iterator[tuple[str, Any]]:
        """Every sensor that no other row sends whole."""
        for name, values in car.sensors.items():
            kind = name.partition(".")[0]
            if kind in ("camera", "lidar") and kind in self._covered:
                continue
            topic = _array_topic(row, name)
            frame = row.frame or self.table.frames.base
            count = car.counts.get(name, -1)
            yield topic, self._make.array(car.time_ns, frame, name, values, count)

    def _optical(self, row: SensorTopic, site: CameraSite) -> str:
        return _named(row.frame or self.table.frames.optical, site.name)

    @staticmethod
    def _due(sites: Mapping[str, Any], car: CarTick) -> list[Any]:
        return [site for message, site in sites.items() if message in car.sensors]


def _named(pattern: str, name: str) -> str:
    return pattern.replace("{name}", name)


def _array_topic(row: SensorTopic, message: str) -> str:
    return row.topic.replace("{sensor}", message.replace(".", "/"))


def _of_kind(kind: str, site: CameraSite | LidarSite) -> str:
    """Name of another message of a camera."""
    _, dot, rest = site.message.partition(".")
    return f"{kind}{dot}{rest}"


def _mounted(
    parent: str, child: str, position_m: Sequence[float], rotation_deg: Sequence[float]
) -> StaticFrame:
    x, y, z = position_m
    return StaticFrame(parent, child, (x, y, z), of_mount(rotation_deg))
