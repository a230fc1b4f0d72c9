"""``viewer export`` of ROS 2 messages: finds the attempt, and says what was written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from schemas.files.drive_record import DRIVE_FILE
from twin.base.errors import UsageError
from twin.base.progress import bars
from twin.ros2.tables import load_table
from viewer.playback.folder import attempts_of, find_recording
from viewer.playback.frames import read_case
from viewer.playback.ros2_file import DriveMessagesOf, WrittenBag, write_bag, write_ros2_mcap
from viewer.playback.true_objects import TrueTick, true_ticks


def export_ros2(
    folder: Path,
    case: str,
    mcap: Path | None,
    bag: Path | None,
    table: str,
    tell: Callable[[str], None] | None,
) -> None:
    """Write an MCAP file of ROS 2 messages, a folder of rosbag2, or both.

    ``tell``: gets remarks about the recording, from which the truth comes; None: no truth.

    Raises:
        UsageError: no such case, table or record, or it cannot be written; one line.
    """
    topics = load_table(table)
    told: dict[int, TrueTick] | None = None
    if tell is not None:
        recording = find_recording(folder, case)
        for line in recording.remarks():
            tell(line)
        attempt, told = recording.path.parent, true_ticks(read_case(recording.path))
    else:
        attempts = attempts_of(folder, case)
        # Without a record in any, the first is named in the refusal.
        attempt = next((each for each in attempts if (each / DRIVE_FILE).is_file()), attempts[0])
    messages = DriveMessagesOf(attempt, topics, told)
    if bag is not None:
        if bag.exists():
            raise UsageError(f"{bag}: it exists; give a folder that does not")
        with bars():
            written = write_bag(messages, bag)
        _say(bag, written)
    if mcap is not None:
        with bars():
            written = write_ros2_mcap(messages, mcap)
        _say(mcap, written)


def _say(out: Path, written: WrittenBag) -> None:
    print(
        f"{out}: {written.messages} messages on {written.topics} topics, "
        f"{written.end_ns / 1e9:.2f} s"
    )
