"""Reads a recording back, tick by tick: pictures, boxes, plots and events. The only reader.

Works on the file of a recorder that was killed and on recordings of older versions: what a
recording does not hold is None, never 0.
"""

from __future__ import annotations

import bisect
import math
import os
import subprocess
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from twin.base.errors import UsageError
from viewer.playback import native
from viewer.playback.point_rows import PointMount, PointRows, mount_of, rows_of, sensor_of
from viewer.recording import naming

_PROPERTIES = "__properties/"


@dataclass(frozen=True, slots=True)
class Mark:
    """A labelled box in a picture [px]; x and y are its upper left corner."""

    x_px: float
    y_px: float
    width_px: float
    height_px: float
    label: str
    """Text at the box, as ``car 0.90`` (detected) or ``car 21 m`` (true)."""


@dataclass(frozen=True, slots=True)
class MoverBox:
    """Box of an object that moves."""

    position_m: tuple[float, float, float]
    """Its middle in the world."""
    rotation: tuple[float, float, float, float]
    """x, y, z, w: world from object."""
    size_m: tuple[float, float, float]
    """Length, width and height."""


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A line of the case's log."""

    sim_time_ns: int
    text: str
    level: str
    """INFO, WARN or ERROR."""


@dataclass(slots=True)
class PlayedTick:
    """One control tick as it was recorded."""

    sim_time_ns: int
    jpeg: bytes | None = None
    """The camera's picture."""
    x_m: float | None = None
    y_m: float | None = None
    z_m: float | None = None
    yaw_rad: float | None = None
    pitch_rad: float | None = None
    """Down at the front; missing in recordings without heights, as the roll."""
    roll_rad: float | None = None
    speed_mps: float | None = None
    accel_mps2: float | None = None
    dtc_m: float | None = None
    ttc_s: float | None = None
    throttle: float | None = None
    brake: float | None = None
    aeb: bool | None = None
    detections: list[Mark] | None = None
    trigger: Mark | None = None
    """The detection that emergency braking began for in this tick, if the stack says which."""
    truth: list[Mark] | None = None
    movers: list[MoverBox] | None = None
    """Objects that move; None: there were none."""
    readings: dict[str, dict[str, float]] = field(default_factory=dict)
    """Readings of the sensors with a row of numbers that were due: name -> column -> value."""
    points: dict[str, PointRows] = field(default_factory=dict)
    """Rows of the sensors that are drawn as points and were due, by name."""


@dataclass(slots=True)
class RecordedCase:
    """A recorded attempt."""

    path: Path
    recording_id: str
    frames: list[PlayedTick] = field(default_factory=list)
    """Frames in order of sim time, one per time."""
    events: list[LogEvent] = field(default_factory=list)
    mounts: dict[str, PointMount] = field(default_factory=dict)
    """Where the sensors that are drawn as points sit, by name."""
    properties: dict[str, dict[str, Any]] = field(default_factory=dict)
    """``case`` (campaign, model, weather, ...) and, unless the recorder was killed, ``verdict``."""

    @property
    def pictures(self) -> list[PlayedTick]:
        """The frames with a picture."""
        return [frame for frame in self.frames if frame.jpeg is not None]

    def picture_at(self, sim_time_ns: int) -> PlayedTick:
        """The picture that stood at a time: the latest until then, or else the first.

        Raises:
            UsageError: the recording holds no picture.
        """
        pictures = self.pictures
        if not pictures:
            raise UsageError(f"{self.path}: the recording holds no camera picture")
        times = [frame.sim_time_ns for frame in pictures]
        return pictures[max(0, bisect.bisect_right(times, sim_time_ns) - 1)]


_SCALARS = {
    naming.SPEED: "speed_mps",
    naming.ACCEL: "accel_mps2",
    naming.DTC: "dtc_m",
    naming.TTC: "ttc_s",
    naming.THROTTLE: "throttle",
    naming.BRAKE: "brake",
}


def read_case(path: Path) -> RecordedCase:
    """Read all of a recording.

    Raises:
        UsageError: it is not there, damaged from the start, or no case's recording.
    """
    return _read(path, None)


def read_cover(path: Path) -> RecordedCase:
    """What a recording says about itself: no frames and no events, but in milliseconds.

    Raises:
        UsageError: as `read_case`.
    """
    return _read(path, f"/{_PROPERTIES}**")


def read_pictures(path: Path) -> RecordedCase:
    """The main camera's pictures and nothing else, in a tenth of the time of all.

    Raises:
        UsageError: as `read_case`.
    """
    return _read(path, f"/{naming.CAMERA}")


def _read(path: Path, content: str | None) -> RecordedCase:
    """Read a recording; ``content``: only these entities; None: all of them."""
    if not path.is_file():
        raise UsageError(f"{path}: no such file")
    try:
        return _read_whole(path, content)
    except (OSError, ValueError, RuntimeError):
        # A power cut leaves half a message at the end.
        return _read_repaired(path, content)


def _read_whole(path: Path, content: str | None) -> RecordedCase:
    with warnings.catch_warnings():
        # The file of a killed recorder has no footer; that is what this reader says about it.
        warnings.simplefilter("ignore", RerunWarning)
        reader = RrdReader(path)
        store = next(iter(reader.recordings()), None)
        if store is None or store.application_id != naming.CASE_APP:
            raise UsageError(f"{path}: not the recording of a case")
        case = RecordedCase(path, store.recording_id)
        frames: dict[int, PlayedTick] = {}
        for chunk in reader.stream(store=store).filter(content=content):
            _take(case, frames, chunk)
    case.frames = [frames[time_ns] for time_ns in sorted(frames)]
    for frame in case.frames:
        if frame.detections is not None:  # near and far ones come in any order
            frame.detections.sort(key=lambda m: (-m.width_px, m.x_px, m.y_px, m.label))
    case.events.sort(key=lambda event: event.sim_time_ns)
    return case


def _read_repaired(path: Path, content: str | None) -> RecordedCase:
    """Read what Rerun's own tool saves of a damaged file."""
    with tempfile.TemporaryDirectory(prefix="viewer-") as folder:
        whole = Path(folder, path.name)
        command = [str(native.binary()), "rrd", "optimize", str(path), "-o", str(whole)]
        environment = {**os.environ, "RUST_LOG": "error"}
        done = subprocess.run(command, env=environment, capture_output=True, check=False)
        try:
            if done.returncode:
                raise ValueError(done.stderr.decode(errors="replace"))
            case = _read_whole(whole, content)
        except (OSError, ValueError, RuntimeError, UsageError):
            raise UsageError(f"{path}: damaged, or not the recording of a case") from None
    case.path = path
    return case


def _take(case: RecordedCase, frames: dict[int, PlayedTick], chunk: Chunk) -> None:
    """Put what one chunk holds into its frames."""
    path = str(chunk.entity_path).strip("/")
    batch = chunk.to_record_batch()
    if path.startswith(_PROPERTIES):
        _take_properties(case, path.removeprefix(_PROPERTIES), batch)
        return
    sensor = sensor_of(path, batch)
    if sensor and chunk.is_static and (mount := mount_of(batch)) is not None:
        case.mounts[sensor] = mount
    if chunk.is_static or naming.SIM_TIME not in batch.schema.names:
        return
    times = [int(t) for t in batch.column(naming.SIM_TIME).cast(pa.int64()).to_pylist()]
    if path == naming.EVENTS:
        texts, levels = _firsts(batch, "TextLog:text"), _firsts(batch, "TextLog:level")
        case.events += [
            LogEvent(time_ns, text, level or "INFO")
            for time_ns, text, level in zip(times, texts, levels, strict=True)
            if text is not None
        ]
        return
    if path.startswith(f"{naming.READINGS}/"):
        _, sensor, column = path.split("/")
        for time_ns, value in zip(times, _firsts(batch, "Scalars:scalars"), strict=True):
            if value is not None:
                read = frames.setdefault(time_ns, PlayedTick(time_ns)).readings
                read.setdefault(sensor, {})[column] = value
        return
    if sensor:
        for time_ns, rows in zip(times, rows_of(batch), strict=True):
            if rows is not None:
                frames.setdefault(time_ns, PlayedTick(time_ns)).points[sensor] = rows
        return
    for time_ns, values in zip(times, _values(path, batch), strict=False):
        frame = frames.setdefault(time_ns, PlayedTick(time_ns))
        for name, value in values.items():
            if name == "detections":  # near and far ones are entities of their own
                frame.detections = [*(frame.detections or []), *value]
            else:
                setattr(frame, name, value)


def _take_properties(case: RecordedCase, name: str, batch: pa.RecordBatch) -> None:
    case.properties[name] = {
        column: _firsts(batch, column)[0]
        for column in batch.schema.names
        if ":" not in column and not column.startswith("rerun.")
    }


def _values(path: str, batch: pa.RecordBatch) -> Iterator[dict[str, Any]]:
    """Attributes of each row's frame; rows without a value yield an empty dict."""
    if path in _SCALARS:
        yield from _named(_SCALARS[path], _firsts(batch, "Scalars:scalars"))
    elif path == naming.AEB:
        values = _firsts(batch, "Scalars:scalars")
        yield from _named("aeb", [None if v is None else v > 0.5 for v in values])
    elif path == naming.CAMERA:
        yield from _named("jpeg", _blobs(batch, "EncodedImage:blob"))
    elif path in (naming.DETECTIONS, naming.DETECTIONS_FAR):
        yield from _named("detections", _marks(batch))
    elif path == naming.TRIGGER:
        yield from _named("trigger", [row[0] if row else None for row in _marks(batch)])
    elif path == naming.TRUTH:
        yield from _named("truth", _marks(batch))
    elif path == naming.MOVERS:
        yield from _named("movers", _movers(batch))
    elif path == naming.EGO:
        yield from _poses(batch)


def _named(name: str, values: list[Any]) -> Iterator[dict[str, Any]]:
    for value in values:
        yield {} if value is None else {name: value}


def _column(batch: pa.RecordBatch, name: str) -> list[Any]:
    """A component's lists, row by row; all None if it was not logged."""
    if name not in batch.schema.names:
        return [None] * batch.num_rows
    values: list[Any] = batch.column(name).to_pylist()
    return values


def _firsts(batch: pa.RecordBatch, name: str) -> list[Any]:
    return [row[0] if row else None for row in _column(batch, name)]


def _blobs(batch: pa.RecordBatch, name: str) -> list[bytes | None]:
    """Byte strings, without a Python number per byte."""
    if name not in batch.schema.names:
        return [None] * batch.num_rows
    blobs: list[bytes | None] = []
    for row in batch.column(name):
        values = row.values
        if values is None or not len(values):
            blobs.append(None)
        else:
            blobs.append(np.asarray(values[0].values, np.uint8).tobytes())
    return blobs


def _marks(batch: pa.RecordBatch) -> list[list[Mark] | None]:
    rows = zip(
        _column(batch, "Boxes2D:centers"),
        _column(batch, "Boxes2D:half_sizes"),
        _column(batch, "Boxes2D:labels"),
        strict=True,
    )
    marks: list[list[Mark] | None] = []
    for centers, halves, labels in rows:
        if centers is None or halves is None:
            marks.append(None)
            continue
        names = list(labels or [])
        names += [""] * (len(centers) - len(names))
        marks.append(
            [
                Mark(x - half_x, y - half_y, 2 * half_x, 2 * half_y, name)
                for (x, y), (half_x, half_y), name in zip(centers, halves, names, strict=False)
            ]
        )
    return marks


def _movers(batch: pa.RecordBatch) -> list[list[MoverBox] | None]:
    names = ("centers", "half_sizes", "quaternions")
    columns = [_column(batch, f"Boxes3D:{name}") for name in names]
    return [
        None
        if any(part is None for part in row)
        else [
            MoverBox((x, y, z), tuple(turn), (2 * half_x, 2 * half_y, 2 * half_z))
            for (x, y, z), (half_x, half_y, half_z), turn in zip(*row, strict=True)
        ]
        for row in zip(*columns, strict=True)
    ]


def _poses(batch: pa.RecordBatch) -> Iterator[dict[str, Any]]:
    places = _firsts(batch, "Transform3D:translation")
    turns = _firsts(batch, "Transform3D:rotation_axis_angle")
    leans = _firsts(batch, "Transform3D:quaternion")
    for place, turn, lean in zip(places, turns, leans, strict=True):
        values: dict[str, Any] = {}
        if place is not None:
            values["x_m"], values["y_m"], values["z_m"] = place
        if turn is not None:
            values["yaw_rad"] = turn["angle"] * turn["axis"][2]
        if lean is not None:
            # Of a turn by the pitch and then the roll, both far from a right angle.
            x, y, _, w = lean
            values["pitch_rad"], values["roll_rad"] = 2 * math.atan2(y, w), 2 * math.atan2(x, w)
        yield values
