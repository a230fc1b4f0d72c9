"""Reads a recording: topics of odometry, transforms and objects become arrays.

This runs in a process apart, which may be taken over without harm (:mod:`twin.drives.apart`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twin.drives.drive import (
    COORDINATE_MAX_M,
    DRIVE_CHECK,
    NAME_CHARS_MAX,
    OBJECTS_MAX,
    POSES_MAX,
    SIZE_MAX_M,
    TOPICS_MAX,
    DrivenObject,
    DriveQuestion,
    RecordedDrive,
    drive_mistake,
)
from twin.drives.frame_tree import FramePlace, FrameTree, unit
from twin.drives.object_kinds import kind_of_label, kind_of_words
from twin.drives.recording import MessageStream
from twin.drives.stamps import TopicStamps
from twin.ros2.motion import kind_of_size
from twin.world.apart.parser import Parser

ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
OBJECT_TYPES = (
    "vision_msgs/msg/Detection3DArray",
    "autoware_perception_msgs/msg/TrackedObjects",
    "autoware_perception_msgs/msg/PredictedObjects",
    "autoware_auto_perception_msgs/msg/TrackedObjects",
    "autoware_auto_perception_msgs/msg/PredictedObjects",
)
"""Types of objects with identities, the preferred first."""
BASE_FRAMES = ("base_link", "base_footprint", "ego_vehicle", "ego")
"""Frames of the ego, the preferred first."""

MESSAGES_MAX = 5_000_000
"""Most messages that are decoded."""
_BESIDE_NS = 10_000_000_000
"""Objects that were seen so long before or after the ego are of its time [ns]."""


@dataclass(slots=True)
class _Seen:
    """An object, as it was told."""

    kind: str
    size_m: tuple[float, float, float]
    times_ns: list[int] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    places: list[FramePlace] = field(default_factory=list)


@dataclass(slots=True)
class _Gathered:
    """What the topics say."""

    tree: FrameTree = field(default_factory=FrameTree)
    ego: dict[int, tuple[str, str, FramePlace]] = field(default_factory=dict)
    """Frame, frame of the ego, and place, by time [ns]."""
    objects: dict[str, _Seen] = field(default_factory=dict)
    nameless: int = 0
    broken: int = 0
    beyond: int = 0
    stamps: TopicStamps = field(default_factory=TopicStamps)

    def take_ego(self, pose: tuple[str, str, FramePlace], time_ns: int) -> None:
        """A pose of the ego; the last of equal times holds."""
        self.ego[time_ns] = pose

    def take_object(
        self, name: str, told: _Seen, frame: str, place: FramePlace, time_ns: int
    ) -> None:
        """An object at a place of a frame."""
        if name not in self.objects and len(self.objects) >= OBJECTS_MAX:
            self.beyond += 1
            return
        seen = self.objects.setdefault(name, told)
        if len(seen.places) < POSES_MAX:
            seen.times_ns.append(time_ns)
            seen.frames.append(frame)
            seen.places.append(place)
            seen.size_m = _larger(seen.size_m, told.size_m)


def read_drive(path: Path, question: bytes = b"") -> RecordedDrive:
    """The drive of a recording.

    Args:
        path: an MCAP file, or ``metadata.yaml`` of a rosbag2 folder.
        question: a :class:`DriveQuestion` as JSON.

    Raises:
        ValueError: it is none, or has no ego; one line.
    """
    asked = msgspec.json.decode(question, type=DriveQuestion) if question else DriveQuestion()
    with MessageStream(path) as stream:
        topics = stream.topics()
        ego, objects = _chosen(path, asked, topics)
        wanted = {ego, objects} | {name for name, kind in topics.items() if kind == TRANSFORMS}
        gathered = _gather(stream, wanted & set(topics), topics)
        told = stream.told()
    by_frames = objects.endswith("*")
    if ego not in topics:
        gathered.ego = _ego_of_frame(gathered.tree, ego)
    if len(gathered.ego) < 2:
        raise ValueError(f"{path}: {ego}: no poses of the ego there; {_shown(told)}")
    if by_frames:
        _objects_of_frames(gathered, objects.removesuffix("*"))
        if asked.objects and not gathered.objects:
            frames = sorted(gathered.tree.tracks)
            raise ValueError(
                f"{path}: --objects {asked.objects}: no frame's name begins so; {_shown(frames)}"
            )
    drive = _drive(path, gathered, ego, objects, told)
    if wrong := drive_mistake(drive):
        raise ValueError(f"{path}: {wrong}")
    return drive


def _chosen(path: Path, asked: DriveQuestion, topics: dict[str, str]) -> tuple[str, str]:
    """Source of the ego and of the objects."""
    if asked.ego:
        ego = asked.ego
        if ego.startswith("/") and topics.get(ego) != ODOMETRY:
            raise ValueError(f"{path}: no topic {ego} of type {ODOMETRY}; {_shown_topics(topics)}")
    else:
        # The truth of our own exports, then what localisation says, then by name.
        named = sorted(
            (name for name, kind in topics.items() if kind == ODOMETRY),
            key=lambda name: ("truth" not in name, "localization" not in name, name),
        )
        if not named and TRANSFORMS not in topics.values():
            raise ValueError(
                f"{path}: neither {ODOMETRY} nor {TRANSFORMS} in it; {_shown_topics(topics)}"
            )
        ego = named[0] if named else BASE_FRAMES[0]
    objects = asked.objects
    if objects.startswith("/"):
        if topics.get(objects) not in OBJECT_TYPES:
            raise ValueError(
                f"{path}: no topic {objects} of objects with identities "
                f"({', '.join(OBJECT_TYPES)}); {_shown_topics(topics)}"
            )
    elif not objects:
        known = [name for kind in OBJECT_TYPES for name in sorted(topics) if topics[name] == kind]
        objects = known[0] if known else ""
    elif not objects.endswith("*"):
        objects += "*"
    return ego, objects


def _shown_topics(topics: dict[str, str]) -> str:
    return _shown([f"{name} ({kind})" for name, kind in sorted(topics.items())])


def _shown(told: list[str]) -> str:
    shown = ", ".join(text[:80] for text in told[:12])
    return f"there: {shown or 'nothing'}{', ...' if len(told) > 12 else ''}"


def _gather(stream: MessageStream, wanted: set[str], topics: dict[str, str]) -> _Gathered:
    gathered = _Gathered()
    for count, (topic, time_ns, message) in enumerate(stream.messages(wanted)):
        if count >= MESSAGES_MAX:
            raise ValueError(f"{stream.path}: more than {MESSAGES_MAX} messages of its topics")
        try:
            _take(gathered, topic, topics[topic], time_ns, message)
        # A type of this name with other fields: the definition is the recording's.
        except (AttributeError, TypeError, ValueError, OverflowError, IndexError):
            gathered.broken += 1
    gathered.stamps.end()
    return gathered


def _take(gathered: _Gathered, topic: str, type_name: str, time_ns: int, message: Any) -> None:
    if message is None:
        gathered.broken += 1
    elif type_name == TRANSFORMS:
        _take_transforms(gathered, topic, time_ns, message)
    elif type_name == ODOMETRY:
        place = _placement(message.pose.pose)
        if place is None:
            gathered.broken += 1
            return
        frames = message.header.frame_id.strip("/"), message.child_frame_id.strip("/")
        put = partial(gathered.take_ego, (*frames, place))
        gathered.stamps.put(topic, _stamp(message.header), time_ns, put)
    elif type_name == OBJECT_TYPES[0]:
        _take_objects(gathered, topic, time_ns, message, _vision(message))
    else:
        _take_objects(gathered, topic, time_ns, message, _autoware(message))


def _stamp(header: Any) -> int:
    """Stamp of a header [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _placement(pose: Any) -> FramePlace | None:
    """None: numbers that are none."""
    at, turn = pose.position, pose.orientation
    return _placed((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w))


def _placed(
    at: tuple[float, float, float], turn: tuple[float, float, float, float]
) -> FramePlace | None:
    finite = all(math.isfinite(part) for part in (*at, *turn))
    if not finite or max(abs(part) for part in at) > COORDINATE_MAX_M:
        return None
    whole = unit(turn)
    return None if whole is None else FramePlace(at, whole)


def _take_transforms(gathered: _Gathered, topic: str, time_ns: int, message: Any) -> None:
    for each in message.transforms:
        move, turn = each.transform.translation, each.transform.rotation
        place = _placed((move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w))
        parent, child = each.header.frame_id.strip("/"), each.child_frame_id.strip("/")
        if place is None or not parent or not child or parent == child:
            gathered.broken += 1
            continue
        put = partial(gathered.tree.add, parent, child, placement=place)
        gathered.stamps.put(topic, _stamp(each.header), time_ns, put)


def _take_objects(
    gathered: _Gathered, topic: str, time_ns: int, message: Any, objects: Iterator[_Told]
) -> None:
    stamp, frame = _stamp(message.header), message.header.frame_id.strip("/")
    for name, kind, size, pose in objects:
        place = _placement(pose)
        if place is None or not all(0.0 <= side <= SIZE_MAX_M for side in size):
            gathered.broken += 1
        elif not name:
            gathered.nameless += 1
        else:
            put = partial(gathered.take_object, name, _Seen(kind, size), frame, place)
            gathered.stamps.put(topic, stamp, time_ns, put)


_Told = tuple[str, str, tuple[float, float, float], Any]
"""Name, kind, size and pose."""


def _vision(message: Any) -> Iterator[_Told]:
    for each in message.detections:
        size = each.bbox.size.x, each.bbox.size.y, each.bbox.size.z
        words = each.results[0].hypothesis.class_id if each.results else ""
        yield each.id, kind_of_words(words) or kind_of_size(size), size, each.bbox.center


def _autoware(message: Any) -> Iterator[_Told]:
    for each in message.objects:
        told = each.shape.dimensions
        size = told.x, told.y, told.z
        best = max(each.classification, key=lambda c: c.probability, default=None)
        kind = kind_of_label(best.label) if best is not None else ""
        motion = each.kinematics
        pose = getattr(motion, "pose_with_covariance", None)
        pose = motion.initial_pose_with_covariance if pose is None else pose
        yield bytes(each.object_id.uuid).hex(), kind or kind_of_size(size), size, pose.pose


def _larger(one: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (max(pair) for pair in zip(one, other, strict=True))
    return x, y, z


def _ego_of_frame(tree: FrameTree, frame: str) -> dict[int, tuple[str, str, FramePlace]]:
    """Poses of a frame in its root, whenever it or one above it was told of."""
    if frame not in tree.tracks and frame == BASE_FRAMES[0]:
        frame = next((name for name in BASE_FRAMES if name in tree.tracks), frame)
    root = tree.root(frame)
    chain, above = [], frame
    while above in tree.tracks:
        chain.append(tree.tracks[above])
        above = chain[-1].parent
    if not chain:
        return {}
    # What moves nearest to the ego says when it was there: a frame above it may have been told of
    # long before, or by another clock, as those of /tf_static are.
    nearest = next((track for track in chain if track.moves), None)
    span = (nearest or max(chain, key=lambda track: len(track.times))).times
    times = {time for track in chain for time in track.times if span[0] <= time <= span[-1]}
    return {time: (root, frame, tree.in_root(frame, time)) for time in sorted(times)}


def _objects_of_frames(gathered: _Gathered, prefix: str) -> None:
    for name in sorted(gathered.tree.tracks):
        if name.startswith(prefix) and len(gathered.objects) < OBJECTS_MAX:
            times = gathered.tree.times(name)[:POSES_MAX]
            track = gathered.tree.tracks[name]
            size = (0.0, 0.0, 0.0)
            kind = kind_of_words(name) or "car"
            count = len(times)
            gathered.objects[name] = _Seen(
                kind, size, list(times), [track.parent] * count, track.placements[:count]
            )


def _drive(
    path: Path, gathered: _Gathered, ego: str, objects: str, told: list[str]
) -> RecordedDrive:
    """Everything in one frame, from the ego's first pose on."""
    tree = gathered.tree
    times = sorted(gathered.ego)[:POSES_MAX]
    frame, base, _ = gathered.ego[times[0]]
    if base and base not in tree.tracks:
        # Objects in the ego's own axes are placed by its odometry.
        for time in times:
            tree.add(frame, base, time, gathered.ego[time][2])
    try:
        root = tree.root(frame)
        rows = []
        for time in times:
            inside, _, place = gathered.ego[time]
            rows.append(_row(time, times[0], tree.in_root(inside, time).then(place)))
        found, strangers = [], 0
        for name, seen in gathered.objects.items():
            poses = _object_poses(tree, root, seen, (times[0], times[-1]))
            strangers += len(seen.places) - len(poses)
            if len(poses):
                size = np.array(seen.size_m)
                found.append(DrivenObject(name[:NAME_CHARS_MAX], seen.kind, size, poses))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    notes = [
        f"{count} {words}"
        for count, words in (
            (gathered.broken, "messages, transforms or objects with numbers that are none"),
            (gathered.nameless, "objects without an id, of which nobody knows which is which"),
            (gathered.beyond, f"objects beyond the first {OBJECTS_MAX}"),
            (strangers, f"poses of objects beside the ego's time or no frame of '{root[:80]}'"),
        )
        if count
    ]
    return RecordedDrive(
        ego_source=ego[:NAME_CHARS_MAX],
        objects_source=objects[:NAME_CHARS_MAX] if found else "",
        frame=root[:NAME_CHARS_MAX],
        ego=_rising(rows),
        objects=found,
        topics=told[:TOPICS_MAX],
        notes=notes,
    )


def _object_poses(tree: FrameTree, root: str, seen: _Seen, span_ns: tuple[int, int]) -> np.ndarray:
    rows = []
    start_ns, end_ns = span_ns
    for time, frame, place in zip(seen.times_ns, seen.frames, seen.places, strict=True):
        # A recording without any transforms has one frame, whatever it is called.
        if frame and tree.tracks and tree.root(frame) != root:
            continue
        # Some recordings mix the clock on the wall with that of a simulation.
        if not start_ns - _BESIDE_NS <= time <= end_ns + _BESIDE_NS:
            continue
        rows.append(_row(time, start_ns, tree.in_root(frame, time).then(place)))
    return _rising(rows)


def _row(time_ns: int, start_ns: int, place: FramePlace) -> tuple[float, ...]:
    return ((time_ns - start_ns) / 1e9, *place.at, place.heading_rad)


def _rising(rows: Iterable[tuple[float, ...]]) -> np.ndarray:
    """Rows by time, the last of equal times."""
    table = np.array(list(rows), float).reshape(-1, 5)
    table = table[np.argsort(table[:, 0], kind="stable")]
    last = np.append(np.diff(table[:, 0]) > 0.0, True) if len(table) else np.zeros(0, bool)
    rising: np.ndarray = table[last]
    return rising


RECORDED_DRIVE = Parser(
    "twin.drives.reading:read_drive", DRIVE_CHECK, "cannot be read as a recorded drive"
)
"""The parser, for the process apart."""
