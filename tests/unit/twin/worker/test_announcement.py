"""What a rig leaves in ``--join-dir``: nothing while its worker can help it, nothing for long."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import msgspec

from twin.base.process import end, spawn
from twin.fabric.keys.rig_keys import RigKeys
from twin.worker.announcement import Announcement, RigOwner, born_ticks, sweep

OTHER = """
import sys
from pathlib import Path
from twin.fabric.keys.rig_keys import RigKeys
from twin.worker.announcement import Announcement
Announcement(Path(sys.argv[1]), sys.argv[2]).write(["--rig", sys.argv[2]], RigKeys(sys.argv[2]))
print("announced", flush=True)
sys.stdin.read()
"""


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _worker(folder: Path, rig: str) -> subprocess.Popen[bytes]:
    """Another process that has announced ``rig``, and lives."""
    process = spawn([sys.executable, "-c", OTHER, str(folder), rig], pipe_output=True)
    assert process.stdout is not None
    assert process.stdout.readline() == b"announced\n"
    return process


def test_a_rig_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "not/yet"
    keys = RigKeys("f00d")
    announced = Announcement(folder, "f00d")
    announced.write(["--rig", "f00d"], keys)
    assert _names(folder) == [".f00d.owner", "f00d.json", "f00d.key"]
    assert stat.S_IMODE((folder / "f00d.key").stat().st_mode) == 0o600
    assert json.loads((folder / "f00d.json").read_text()) == {"arguments": ["--rig", "f00d"]}
    assert sweep(folder) == [], "this process lives"
    (folder / "f00d.json").rename(folder / "f00d.claimed-here-1")  # a stack's host has died with it
    (folder / "mine.txt").touch()
    announced.remove()
    announced.remove()
    assert _names(folder) == ["mine.txt"]
    keys.close()


def test_of_dead_workers_everything_goes_and_of_others_nothing(tmp_path: Path) -> None:
    alive, killed = _worker(tmp_path, "a11ve"), _worker(tmp_path, "dead")
    killed.kill()
    os.waitid(os.P_PID, killed.pid, os.WEXITED | os.WNOWAIT)  # dead, and still in the table
    (tmp_path / "dead.json").unlink()  # its stack had come
    (tmp_path / ".dead.key.0123.tmp").touch()
    (tmp_path / ".nonsense.owner").write_bytes(b"\xff{")
    (tmp_path / ".*.owner").write_bytes((tmp_path / ".dead.owner").read_bytes())
    elsewhere = RigOwner("another pid:[1]", killed.pid, 1)
    (tmp_path / ".far.owner").write_bytes(msgspec.json.encode(elsewhere))
    (tmp_path / "far.key").touch()
    # The number of a process that died has been given to another one.
    own = msgspec.json.decode((tmp_path / ".a11ve.owner").read_bytes(), type=RigOwner)
    older = msgspec.structs.replace(own, born_ticks=own.born_ticks - 1)
    (tmp_path / ".01der.owner").write_bytes(msgspec.json.encode(older))
    (tmp_path / "01der.key").touch()
    try:
        assert born_ticks(alive.pid) == own.born_ticks > 0
        assert sweep(tmp_path) == ["01der", "dead"]
        assert _names(tmp_path) == [
            *(".*.owner", ".a11ve.owner", ".far.owner", ".nonsense.owner"),
            *("a11ve.json", "a11ve.key", "far.key"),
        ]
        killed.wait()
        assert sweep(tmp_path / "none") == []
    finally:
        end(alive)
        end(killed)
