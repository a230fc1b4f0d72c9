"""ROS 2: messages of a stack, topic tables, recordings of drives."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fuzz_target import Target, of_file

from twin.base.errors import UsageError
from twin.drives.drive import drive_mistake
from twin.drives.reading import RECORDED_DRIVE, read_drive
from twin.drives.scenario import DriveCut, cut_drive
from twin.ros2.commands import read_command
from twin.ros2.store import MessageError, type_store
from twin.ros2.tables import COMMAND_TYPES, FOLDER, load_table
from twin.world.apart.checks import pack, unpack


def _command(data: bytes) -> object:
    """The first byte says which type it is."""
    name = COMMAND_TYPES[data[0] % len(COMMAND_TYPES)] if data else ""
    return read_command(type_store(), name, data[1:])


def _recording(path: Path) -> object:
    """As the process apart reads it, and as its answer is used."""
    drive = read_drive(path)
    tree, arrays = pack(drive, RECORDED_DRIVE.check)
    answer = unpack(tree, RECORDED_DRIVE.check, arrays)
    assert drive_mistake(answer) == "", "a reader apart would be taken for a liar"
    return cut_drive(answer, DriveCut(0.0, None, 120.0, moved=True))


def _table(data: bytes) -> object:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "t.yaml")
        path.write_bytes(data)
        return load_table(str(path))


TARGETS: dict[str, Target] = {
    "ros2-command": Target(_command, (MessageError, UsageError)),
    "ros2-recording": Target(of_file("r.mcap", _recording), (ValueError, UsageError), cost=30),
    "ros2-table": Target(
        _table,
        (UsageError,),
        shipped=tuple(sorted(FOLDER.glob("*.yaml"))),
        lines_max=102,
        cost=10,
    ),
}
