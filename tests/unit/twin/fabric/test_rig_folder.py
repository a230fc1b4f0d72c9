"""A rig's own folder: who may enter it, what a stack may do on its socket, and how it ends."""

import os
import queue
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from other_users import AS_ROOT, DAEMON, NOBODY, PYTHON, started_by
from waiting import PATIENCE_S, wait_for

from twin.base.errors import InfrastructureError
from twin.fabric.rig_folder import PATH_BYTES_MAX, RigFolder, frames_socket
from twin.fabric.zenoh_bus import open_bus


@pytest.fixture
def folder():
    found = RigFolder()
    yield found
    found.close()


def test_nobody_else_may_enter_it_and_it_goes_with_its_rig(folder):
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    (folder.path / "left").write_text("by a stack")
    folder.close()
    assert not folder.path.exists()


def test_a_long_temporary_folder_is_not_taken(tmp_path, monkeypatch):
    long = tmp_path / ("x" * 90)
    long.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(long))
    monkeypatch.setenv("TMPDIR", str(long))
    folder = RigFolder()
    folder.close()
    assert len(os.fsencode(folder.path / "frames")) <= PATH_BYTES_MAX


def test_it_is_gone_after_a_kill_of_its_worker(tmp_path):
    source = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from twin.fabric.rig_folder import RigFolder\n"
        "folder = RigFolder(Path(sys.argv[1]))\n"
        "print(folder.path, flush=True)\n"
        "time.sleep(600)\n"
    )
    worker = subprocess.Popen(
        [sys.executable, "-c", source, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    path = Path(worker.stdout.readline().strip())
    assert path.is_dir()
    worker.kill()
    worker.wait()
    wait_for(lambda: not path.exists(), "the end of the folder")
    worker.stdout.close()


def test_it_goes_though_a_process_still_writes_into_it():
    folder = RigFolder()
    source = (
        "import pathlib, sys\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "for number in range(10**9):\n"
        "    try: (folder / str(number)).touch()\n"
        "    except FileNotFoundError: break\n"
        "    if number == 100: print('writing', flush=True)\n"
    )
    writer = subprocess.Popen(
        [sys.executable, "-c", source, str(folder.path)], stdout=subprocess.PIPE
    )
    try:
        assert writer.stdout.readline() == b"writing\n"
        folder.close()
        assert not list(folder.path.parent.glob(f"{folder.path.name}*"))
    finally:
        writer.kill()
        writer.communicate()


KEEP = """
import sys
from pathlib import Path
from twin.fabric.rig_folder import PrivateFolder
folder = PrivateFolder(Path("/tmp"))
(folder.path / "worker").touch()
print(folder.path, flush=True)
sys.stdin.readline()
folder.close()
"""

TAKE = {
    "a folder for all": "os.mkdir(path); os.chmod(path, 0o777)",
    "a folder": "os.mkdir(path)",
    "a link": "os.symlink(sys.argv[2], path)",
}
"""What another user puts where the folder goes before it is removed."""


@AS_ROOT
@pytest.mark.parametrize("what", TAKE)
def test_another_user_does_not_keep_it_from_going(what):
    with tempfile.TemporaryDirectory(dir="/tmp") as elsewhere:
        Path(elsewhere).chmod(0o777)
        owner = started_by(NOBODY, ["-c", KEEP], stdout=subprocess.PIPE)
        path = Path(owner.stdout.readline().strip())
        taken = Path(f"{path}-gone")
        take = f"import os, sys; path = sys.argv[1]; {TAKE[what]}"
        words = [PYTHON, "-c", take, str(taken), elsewhere]
        subprocess.run(words, check=True, user=DAEMON, group=DAEMON)
        try:
            owner.communicate("\n", timeout=PATIENCE_S)
            assert not path.exists()
            assert os.listdir(elsewhere) == []
            assert what == "a link" or os.listdir(taken) == []
        finally:
            subprocess.run(["rm", "-rf", "--", str(path), str(taken)], check=True)


def test_no_folder_is_one_error(tmp_path):
    with pytest.raises(OSError, match=r"mkdir: .*nowhere"):
        RigFolder(tmp_path / "nowhere")


def test_no_more_is_let_through_its_socket_than_a_stack_may(folder):
    simulator = open_bus("peer", listen=[folder.drive], namespace="ns/r")
    stack = open_bus("peer", connect=[folder.drive], namespace="ns/r")
    heard = queue.SimpleQueue()
    told = queue.SimpleQueue()
    asked = []
    try:
        for key in ("drive/r/command", "drive/r/tick", "drive/r/sensor/x", "**"):
            simulator.subscribe(key, lambda sample: heard.put(sample.key))
        simulator.serve("drive/r/control", lambda payload, respond: asked.append(payload))
        stack.subscribe("drive/r/tick", lambda sample: told.put(sample.key))
        stack.subscribe("**", lambda sample: told.put(sample.key))
        assert stack.request("drive/r/control", b"look", 0.3) is None

        def spoken():
            for key in ("drive/r/tick", "drive/r/sensor/x", "view/c/case/control"):
                stack.publish(key, b"forged", block=True)
            stack.publish("drive/r/command", b"its own", block=True)
            return not heard.empty()

        wait_for(spoken, "a command")
        stack.publish("drive/r/command", b"the last", block=True)
        assert {heard.get() for _ in range(heard.qsize())} == {"drive/r/command"}
        while not told.empty():
            told.get()
        simulator.publish("drive/r/secret", b"", block=True)
        simulator.publish("drive/r/tick", b"", block=True)
        assert told.get(timeout=PATIENCE_S) == "drive/r/tick"
        assert asked == []
    finally:
        stack.close()
        simulator.close()


def test_where_nobody_listens_it_says_so(folder):
    with pytest.raises(InfrastructureError, match="no simulator answers"):
        open_bus("peer", connect=[folder.drive], namespace="ns/r", connect_timeout_s=0.2)
    assert frames_socket(folder.drive) == folder.path / "frames"
