"""What conductors, workers and simulators have in memory is nothing for a stack of their user."""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import psutil
import pytest
from waiting import PATIENCE_S, wait_for

LOOK = """
import sys
for name in ("mem", "environ", "fd/0", "maps"):
    try:
        open(f"/proc/{sys.argv[1]}/{name}", "rb").read(1)
        print("read", name)
    except OSError:
        pass
"""
"""A process of another program of the user, in place of a stack."""

RUN = """
import sys
if sys.argv[1] == "kept":
    from twin.base.process import keep_to_itself
    keep_to_itself()
print("runs", flush=True)
sys.stdin.read()
"""


NOBODY = 65534
PYTHON = "/usr/bin/python3"
"""One that every user may start."""

pytestmark = pytest.mark.skipif(
    os.getuid() != 0 or not Path(PYTHON).exists(), reason="takes another user's place"
)


def environment():
    """Ours and the packages, without this Python's own."""
    folders = [folder for folder in sys.path if folder and not folder.startswith(sys.base_prefix)]
    return {"PYTHONPATH": os.pathsep.join(folders)}


@pytest.mark.parametrize("how", ["kept", "open"])
def test_another_process_of_the_user_reads_nothing(how):
    child = subprocess.Popen(
        [PYTHON, "-c", RUN, how],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        user=NOBODY,
        group=NOBODY,
        env=environment(),
    )
    try:
        assert child.stdout.readline() == "runs\n"
        found = subprocess.run(
            [PYTHON, "-c", LOOK, str(child.pid)],
            capture_output=True,
            text=True,
            user=NOBODY,
            group=NOBODY,
        )
        assert found.returncode == 0, found.stderr
        assert bool(found.stdout) == (how == "open"), found.stdout
        assert psutil.Process(child.pid).memory_info().rss > 0
    finally:
        child.communicate(timeout=PATIENCE_S)


def test_a_worker_and_its_simulator_keep_theirs():
    """Files in /proc of a process that keeps to itself are root's, whoever runs it."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o777)
        worker = started(folder, "twin", "worker", "-", '{"load_simulator": true}')
        try:
            simulator = wait_for(lambda: child_of(worker, "sim"), "a simulator")
            for pid in (simulator.pid, worker.pid):
                wait_for(lambda pid=pid: owner_of(pid) == 0, "files of root's")
        finally:
            worker.communicate(timeout=PATIENCE_S)
        wait_for(lambda: not list(Path(folder).glob("twin-*")), "the end of the rig's folder")


def test_a_conductor_keeps_its_own():
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o777)
        conductor = started(folder, "conductor", "serve", "--state", f"{folder}/state")
        try:
            wait_for((Path(folder) / "state/conductor.json").exists, "a conductor that listens")
            assert owner_of(conductor.pid) == 0
        finally:
            conductor.terminate()
            conductor.communicate(timeout=PATIENCE_S)


STORE = """
import sys
from twin.stores.apart import StoreApart
store = StoreApart(sys.argv[1])
print(store.pid, flush=True)
sys.stdin.read()
"""
"""A program that has the process of a store, in place of a conductor."""


def test_the_process_of_a_store_keeps_its_own():
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o777)
        words = [PYTHON, "-c", STORE, f"{folder}/store"]
        with run_by_nobody(folder, words, subprocess.PIPE) as conductor:
            pid = int(conductor.stdout.readline())
            wait_for(lambda: owner_of(pid) == 0, "files of root's")
            conductor.kill()


def started(folder, *command):
    """A program of ours that nobody runs."""
    return run_by_nobody(folder, [PYTHON, "-m", *command], subprocess.DEVNULL)


def run_by_nobody(folder, words, output):
    return subprocess.Popen(
        words,
        stdin=subprocess.PIPE,
        stdout=output,
        cwd=folder,
        user=NOBODY,
        group=NOBODY,
        env={**environment(), "HOME": folder, "TMPDIR": folder},
    )


def child_of(worker, word):
    assert worker.poll() is None
    for child in psutil.Process(worker.pid).children():
        with contextlib.suppress(psutil.Error):  # some are there for a moment
            if word in child.cmdline():
                return child
    return None


def owner_of(pid):
    return Path(f"/proc/{pid}/environ").stat().st_uid
