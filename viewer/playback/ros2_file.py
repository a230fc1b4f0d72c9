"""A recorded drive as ROS 2 messages: an MCAP file, or a folder of rosbag2 with an MCAP file in it.

Messages are made of the drive's record by what the bridge to ROS 2 sends them with, so a recording
holds the bytes that a stack would have got. All times are sim time from reset.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schemas.files.drive_record import DRIVE_FILE
from schemas.messages import VEHICLE_COLUMNS
from twin.base.errors import UsageError
from twin.base.progress import BYTES, counter
from twin.records.drive_record import RecordedTick, RecordReader, decoded
from twin.ros2.commands import write_plain
from twin.ros2.motion import DriveMessages
from twin.ros2.sending import CarTick, TableSender, TopicMessage
from twin.ros2.store import MessageError, TypeStore, type_store
from twin.ros2.tables import COMMAND_TYPES, Qos, SensorTopic, TopicTable, type_of
from viewer.playback.outputs import needed
from viewer.playback.true_objects import TrueTick

_OPTION = "--ros2"
_VERSION = 9
"""Of rosbag2's metadata: that of ROS 2 Jazzy and later."""

TRUE_ODOMETRY = SensorTopic("/truth/odometry", "odometry", frame="map")
"""Where the ego really was, in a recording with the truth."""
TRUE_OBJECTS = SensorTopic("/truth/objects", "objects")
"""What moved, in a recording with the truth."""


@dataclass(frozen=True, slots=True)
class WrittenBag:
    """What was written."""

    messages: int
    end_ns: int
    topics: int


class DriveMessagesOf:
    """Messages of an attempt, in the order in which a bridge sends them."""

    def __init__(
        self, attempt: Path, table: TopicTable, truth: dict[int, TrueTick] | None = None
    ) -> None:
        """Open the record of an attempt.

        Args:
            attempt: its folder, with the drive's record.
            table: topics and types.
            truth: by sim time [ns]; None: the recording has none.

        Raises:
            UsageError: there is no record.
        """
        if not (attempt / DRIVE_FILE).is_file():
            raise UsageError(
                f"{attempt}: no {DRIVE_FILE}, of which ROS 2 messages are made; run the campaign "
                "with --record-drive, or `recording: {drive: all}` in its file"
            )
        self.store: TypeStore = type_store()
        self._reader = RecordReader(attempt)
        self._table = table
        self._truth = truth
        self._make = DriveMessages(self.store)

    def __iter__(self) -> Iterator[TopicMessage]:
        """Messages in the order of time.

        Raises:
            UsageError: the record is damaged, or does not fit the table.
        """
        sender: TableSender | None = None
        for tick in self._ticks():
            seen = tick.seen
            if seen.episode is not None:
                sender = TableSender(self._table, seen.episode, self.store)
                yield from sender.start()
            if sender is None:
                raise UsageError(f"{self._reader.path}: damaged: no episode begins it")
            try:
                sensors = {name: decoded(array) for name, array in seen.sensors.items()}
            except ValueError as error:
                raise UsageError(f"{self._reader.path}: damaged: {error}") from None
            counts = {name: array.count for name, array in seen.sensors.items()}
            yield from sender.tick(CarTick(seen.tick, seen.sim_time_ns, sensors, counts))
            yield from self._true(seen.sim_time_ns)
            driving = self._table.driving()
            if tick.answer is not None and driving.type == COMMAND_TYPES[0]:
                command = write_plain(self.store, seen.sim_time_ns, tick.answer.command)
                yield TopicMessage(
                    driving.topic, driving.type, command, driving.qos, seen.sim_time_ns
                )

    def _ticks(self) -> Iterator[RecordedTick]:
        """Ticks of the record, counted by the bytes of its file."""
        size = self._reader.path.stat().st_size
        more, done = counter(BYTES, size), 0
        for tick in self._reader.ticks():
            yield tick
            more(self._reader.read_bytes - done)
            done = self._reader.read_bytes
        more(size - done)

    def _true(self, time_ns: int) -> Iterator[TopicMessage]:
        if self._truth is None or time_ns not in self._truth:
            return
        told, names = self._truth[time_ns], self._table.frames
        if told.pose is not None:
            message = self._make.odometry(
                time_ns,
                (names.world, names.base),
                np.array(told.pose),
                np.array([told.speed_mps, *[0.0] * (len(VEHICLE_COLUMNS) - 1)]),
            )
            yield _told(TRUE_ODOMETRY, message, time_ns)
        objects = self._make.detections(time_ns, names.world, told.objects)
        yield _told(TRUE_OBJECTS, objects, time_ns)


def _told(row: SensorTopic, message: Any, time_ns: int) -> TopicMessage:
    return TopicMessage(row.topic, type_of(row), message, row.qos, time_ns)


def write_bag(messages: DriveMessagesOf, out: Path) -> WrittenBag:
    """Write a folder of rosbag2, whose MCAP file is called as the folder.

    Raises:
        UsageError: rosbags is not installed, or the folder is there, or cannot be written; then
            nothing of it stays.
    """
    return _written(messages, out, str(out))


def _written(messages: DriveMessagesOf, out: Path, shown: str) -> WrittenBag:
    library = needed("rosbags.rosbag2", _OPTION, "ros2")
    channels: dict[str, Any] = {}
    count, end_ns, made = 0, 0, False
    try:
        writer = library.Writer(out, version=_VERSION, storage_plugin=library.StoragePlugin.MCAP)
        with writer:
            made = True
            for each in messages:
                if each.topic not in channels:
                    channels[each.topic] = writer.add_connection(
                        each.topic,
                        each.type_name,
                        msgdef=messages.store.definition(each.type_name),
                        rihs01=messages.store.type_hash(each.type_name),
                        offered_qos_profiles=[_profile(each.qos)],
                    )
                data = messages.store.encode(each.message)
                writer.write(channels[each.topic], each.time_ns, data)
                count, end_ns = count + 1, each.time_ns
    except BaseException as error:
        exists = isinstance(error, library.WriterError) and not made
        if not exists:
            shutil.rmtree(out, ignore_errors=True)  # half a recording
        if exists:
            raise UsageError(f"{shown}: it exists; give a folder that does not") from None
        if isinstance(error, library.WriterError | MessageError):
            raise UsageError(f"{shown}: {error}") from None
        if isinstance(error, OSError):
            raise UsageError(f"{shown}: {error.strerror or error}") from None
        raise
    return WrittenBag(count, end_ns, len(channels))


def write_ros2_mcap(messages: DriveMessagesOf, out: Path) -> WrittenBag:
    """Write one MCAP file of profile ``ros2``: that of such a folder.

    Raises:
        UsageError: rosbags is not installed, or the file cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(dir=out.absolute().parent, prefix=".ros2-") as folder:
            written = _written(messages, Path(folder, "bag"), str(out))
            Path(folder, "bag", "bag.mcap").replace(out)
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from None
    return written


def _profile(qos: Qos) -> Any:
    """As rosbag2 keeps it; what a table does not say is rmw's default."""
    kinds: Any = needed("rosbags.interfaces", _OPTION, "ros2")
    forever = kinds.QosTime(sec=9223372036, nsec=854775807)
    return kinds.Qos(
        history=kinds.QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=kinds.QosReliability[qos.reliability.upper()],
        durability=kinds.QosDurability[qos.durability.upper()],
        deadline=forever,
        lifespan=forever,
        liveliness=kinds.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )
