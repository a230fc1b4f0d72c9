"""A recorded case as an MCAP file for Foxglove, Lichtblick, PlotJuggler and the like.

Pictures, boxes, pose and log in Foxglove's own Protobuf types; the plots in ``drivetwin.State``,
whose fields are absent where nothing was recorded, every sensor with a row of numbers in a type of
its own, and radar detections as point clouds. All times are sim time from reset, so the same
recording gives the same bytes.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.base.progress import steps
from viewer.playback.frames import LogEvent, Mark, PlayedTick, RecordedCase
from viewer.playback.mcap_points import PointClouds
from viewer.playback.outputs import needed, write_whole
from viewer.recording.scenery import CYAN, ORANGE, RED, YELLOW, Color, quaternion

_OPTION = "--mcap"
_TYPES = "foxglove_schemas_protobuf"

PLOTTED = (
    *("speed_mps", "accel_mps2", "dtc_m", "ttc_s"),
    *("throttle", "brake", "x_m", "y_m", "yaw_rad"),
)
"""Fields of ``drivetwin.State`` beside ``timestamp`` and ``aeb``; double."""


@dataclass(frozen=True, slots=True)
class WrittenMcap:
    """What was written."""

    messages: int
    end_ns: int


def write_mcap(case: RecordedCase, out: Path) -> WrittenMcap:
    """Write ``case``.

    Raises:
        UsageError: a library is not installed, or ``out`` cannot be written.
    """
    library = needed("mcap.writer", _OPTION)
    register_schema = needed("mcap_protobuf.schema", _OPTION).register_schema
    data = io.BytesIO()
    # Pictures are compressed already; without zstd the bytes depend on no library's version.
    writer = library.Writer(data, compression=library.CompressionType.NONE)
    writer.start(library="drivetwin")
    channels: dict[str, int] = {}
    count = 0
    for time_ns, topic, message in steps("messages", _Converter().messages(case)):
        if topic not in channels:
            schema = register_schema(writer, type(message))
            channels[topic] = writer.register_channel(topic, "protobuf", schema)
        payload = message.SerializeToString(deterministic=True)
        writer.add_message(channels[topic], time_ns, payload, time_ns, count)
        count += 1
    for name, values in sorted(case.properties.items()):
        writer.add_metadata(name, {key: _text(values[key]) for key in sorted(values)})
    writer.finish()
    write_whole(out, data.getvalue())
    return WrittenMcap(count, case.frames[-1].sim_time_ns if case.frames else 0)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


class _Converter:
    """Frames -> Protobuf messages."""

    def __init__(self) -> None:
        def schema(name: str) -> Any:
            return getattr(needed(f"{_TYPES}.{name}_pb2", _OPTION), name)

        self._image = schema("CompressedImage")
        self._annotations = schema("ImageAnnotations")
        self._transform = schema("FrameTransform")
        self._log = schema("Log")
        self._clouds = PointClouds()
        self._line_loop = schema("PointsAnnotation").LINE_LOOP
        self._state = _plotted_type("State", PLOTTED, flags=("aeb",))
        self._readings: dict[str, Any] = {}
        """Types of readings, by sensor."""

    def messages(self, case: RecordedCase) -> list[tuple[int, str, Any]]:
        """(time [ns], topic, message) of all frames and events, in order of time."""
        messages: list[tuple[int, str, Any]] = []
        for frame in steps("frames", case.frames):
            messages += [(frame.sim_time_ns, *rest) for rest in self._of(frame)]
            for name, rows in sorted(frame.points.items()):
                cloud = _stamped(self._clouds.of(rows, case.mounts.get(name)), frame.sim_time_ns)
                messages.append((frame.sim_time_ns, f"/sensors/{name}", cloud))
        messages += [(event.sim_time_ns, "/events", self._event(event)) for event in case.events]
        messages.sort(key=lambda message: message[0])
        return messages

    def _of(self, frame: PlayedTick) -> list[tuple[str, Any]]:
        messages: list[tuple[str, Any]] = [("/state", self._plots(frame))]
        for name, row in sorted(frame.readings.items()):
            if name not in self._readings:
                self._readings[name] = _plotted_type(f"Sensor_{name}", sorted(row))
            reading = self._readings[name](**row)
            messages.append((f"/sensors/{name}", _stamped(reading, frame.sim_time_ns)))
        if frame.x_m is not None and frame.yaw_rad is not None:
            messages.append(("/tf", self._pose(frame)))
        if frame.jpeg is not None:
            image = self._image(frame_id="camera", data=frame.jpeg, format="jpeg")
            messages.append(("/camera/image", _stamped(image, frame.sim_time_ns)))
        if frame.detections is not None:
            color = RED if frame.aeb else ORANGE
            boxes = self._boxes(frame, frame.detections, color, 2.0)
            self._label(boxes, frame.detections, color)
            if frame.trigger is not None:
                self._outline(boxes, frame.trigger, YELLOW, 4.0)
            messages.append(("/camera/detections", boxes))
        if frame.truth is not None:
            boxes = self._boxes(frame, frame.truth, CYAN, 1.0)
            messages.append(("/camera/truth", boxes))
        return messages

    def _plots(self, frame: PlayedTick) -> Any:
        state = self._state()
        for name in PLOTTED:
            if (value := getattr(frame, name)) is not None:
                setattr(state, name, value)
        if frame.aeb is not None:
            state.aeb = frame.aeb
        return _stamped(state, frame.sim_time_ns)

    def _pose(self, frame: PlayedTick) -> Any:
        pose = self._transform(parent_frame_id="world", child_frame_id="ego")
        at, turn = pose.translation, pose.rotation
        at.x, at.y, at.z = frame.x_m, frame.y_m, frame.z_m or 0.0
        turn.x, turn.y, turn.z, turn.w = quaternion(
            frame.yaw_rad or 0.0, frame.pitch_rad or 0.0, frame.roll_rad or 0.0
        )
        return _stamped(pose, frame.sim_time_ns)

    def _boxes(
        self, frame: PlayedTick, marks: list[Mark], color: Color, thickness_px: float
    ) -> Any:
        outlines = self._annotations()
        for mark in marks:
            self._outline(outlines, mark, color, thickness_px)
        return _stamped(outlines, frame.sim_time_ns)

    def _outline(self, target: Any, mark: Mark, color: Color, thickness_px: float) -> None:
        loop = target.points.add(type=self._line_loop, thickness=thickness_px)
        right, bottom = mark.x_px + mark.width_px, mark.y_px + mark.height_px
        for x, y in (
            (mark.x_px, mark.y_px),
            (right, mark.y_px),
            (right, bottom),
            (mark.x_px, bottom),
        ):
            loop.points.add(x=x, y=y)
        _paint(loop.outline_color, color)

    def _label(self, target: Any, marks: list[Mark], color: Color) -> None:
        for mark in marks:
            if mark.label:
                text = target.texts.add(text=mark.label, font_size=10.0)
                text.position.x, text.position.y = mark.x_px, mark.y_px
                _paint(text.text_color, color)

    def _event(self, event: LogEvent) -> Any:
        levels = {"INFO": "INFO", "WARN": "WARNING", "ERROR": "ERROR"}
        level = self._log.Level.Value(levels.get(event.level, "INFO"))
        log = self._log(level=level, message=event.text, name="case")
        return _stamped(log, event.sim_time_ns)


def _paint(target: Any, color: Color) -> None:
    target.r, target.g, target.b = (channel / 255 for channel in color)
    target.a = 1.0


def _stamped(message: Any, time_ns: int) -> Any:
    message.timestamp.seconds, message.timestamp.nanos = divmod(time_ns, 10**9)
    return message


def _plotted_type(type_name: str, numbers: Sequence[str], flags: Sequence[str] = ()) -> Any:
    """A message type of numbers over time, whose fields may be absent (hence proto2)."""
    descriptor_pb2 = needed("google.protobuf.descriptor_pb2", _OPTION)
    pool = needed("google.protobuf.descriptor_pool", _OPTION).DescriptorPool()
    factory = needed("google.protobuf.message_factory", _OPTION)
    timestamp = needed("google.protobuf.timestamp_pb2", _OPTION)
    pool.AddSerializedFile(timestamp.DESCRIPTOR.serialized_pb)
    field = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(
        name=f"drivetwin/{type_name}.proto",
        package="drivetwin",
        syntax="proto2",
        dependency=[timestamp.DESCRIPTOR.name],
    )
    kinds = [("timestamp", field.TYPE_MESSAGE), *((name, field.TYPE_BOOL) for name in flags)]
    kinds += [(name, field.TYPE_DOUBLE) for name in numbers]
    state = file.message_type.add(name=type_name)
    for number, (name, kind) in enumerate(kinds, 1):
        added = state.field.add(name=name, number=number, type=kind, label=field.LABEL_OPTIONAL)
        if kind == field.TYPE_MESSAGE:
            added.type_name = ".google.protobuf.Timestamp"
    pool.Add(file)
    return factory.GetMessageClass(pool.FindMessageTypeByName(f"drivetwin.{type_name}"))
