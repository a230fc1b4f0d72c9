"""Attacks by recorded drives that somebody sends."""

from __future__ import annotations

import json
import os
from pathlib import Path

from attacks import Found, attack, refused_if
from backports import zstd
from input_rows import all_refused
from parser_theft import read_by
from ros2_recordings import STORE, circle_rows, write_bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from scenario_rows import played
from theatre import Theatre

BOMB_BYTES = 16 << 30
"""What a chunk of the bomb becomes, four times what its reader may have [bytes]."""


def _bomb(folder: Path) -> Path:
    """An MCAP file of some kilobytes with a chunk of many gigabytes of zeros."""
    frame = zstd.compress(bytes(256 << 20))
    name = "nav_msgs/msg/Odometry"
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        writer.storage.compressor = lambda _: frame * (BOMB_BYTES // (256 << 20))
        definition, told = STORE.definition(name), STORE.type_hash(name)
        channel = writer.add_connection("/odom", name, msgdef=definition, rihs01=told)
        writer.write(channel, 1, STORE.encode(circle_rows(1)[0][2]))
    return folder / f"{folder.name}.mcap"


def _defined(folder: Path, definition: str) -> Path:
    """A recording whose odometry is defined so."""
    name = "nav_msgs/msg/Odometry"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        channel = writer.add_connection("/odom", name, msgdef=definition, rihs01="RIHS01_0")
        for time_ns in range(3):
            writer.write(channel, time_ns, STORE.encode(circle_rows(1)[0][2]))
    return folder / f"{folder.name}.mcap"


@attack(15, "recordings of bombs, pipes, devices and code", "who sends a recording", "files")
def hostile_recordings(theatre: Theatre) -> Found:
    """Each is a line and exit code 2, within a minute, and none is run."""
    ran = theatre.folder / "RAN"
    pipe, device = theatre.folder / "pipe.mcap", theatre.folder / "device.mcap"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    linked = write_bag(theatre.folder / "linked", circle_rows(3))
    (linked / "linked.mcap").unlink()
    (linked / "linked.mcap").symlink_to(theatre.secret)
    large = theatre.folder / "large.mcap"
    with large.open("wb") as file:
        file.truncate(100 << 30)
    code = f'string X="""+__import__(\'pathlib\').Path(\'{ran}\').touch()+"""\nfloat64 x\n'
    paths = {
        "bomb": _bomb(theatre.folder / "bomb"),
        "pipe": pipe,
        "device": device,
        "a link in a folder": linked,
        "too large": large,
        "code in a definition": _defined(theatre.folder / "code", code),
        "a type of itself": _defined(theatre.folder / "self", "nav_msgs/Odometry[] again\n"),
        "a long definition": _defined(theatre.folder / "long", "float64 x\n" * 100_000),
        "noise": theatre.write("noise.mcap", "\x89MCAP0\r\n" * 10_000),
        "a key": theatre.secret,
    }
    found = {
        name: played(theatre, "replay-log", str(path), "-o", str(theatre.folder / f"out-{number}"))
        for number, (name, path) in enumerate(paths.items())
    }
    found["code"] = "it ran" if ran.exists() else ""
    return all_refused(found, f"{len(paths)} recordings: one line and exit code 2 each")


TAKES_OVER = """
from twin.drives.drive import DRIVE_CHECK, RecordedDrive
from twin.world.apart.parser import Parser

def tries(path, question):
    ego = np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0, 0.0]])
    return RecordedDrive("e", "", "map", ego, [], [reached(path, "beside.mcap")], [])

TRIES = Parser("taken_over:tries", DRIVE_CHECK, "cannot be read")
"""

READS_RECORDING = """
import functools, json, sys
from pathlib import Path
from twin.drives import apart
from twin.drives.drive import DriveQuestion
from twin.world.apart.reading import read_apart
apart._PARSER = "taken_over:TRIES"
apart.read_apart = functools.partial(read_apart, readable=[Path(sys.argv[2])])
drive = apart.drive_apart(Path(sys.argv[1]), DriveQuestion("e"))
print(json.dumps([drive.topics[0], apart.note_of_reading()]))
"""


@attack(15, "a recording that takes its parser over", "who sends a recording", "files")
def recording_that_takes_over(theatre: Theatre) -> Found:
    """What code in the parser's process reaches."""
    theatre.write("beside.mcap", "another recording")
    done = read_by(theatre, READS_RECORDING, TAKES_OVER, "drive.mcap")
    assert done.returncode == 0, done.stderr[-2000:]
    reached, unprotected = json.loads(done.stdout)
    by = "it is parsed by a process in a sandbox, which sees its files and nothing else"
    return refused_if(reached == "nothing", by, f"{reached} ({unprotected})")
