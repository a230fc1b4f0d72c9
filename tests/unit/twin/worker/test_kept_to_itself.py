"""What conductors, workers and simulators have in memory is nothing for a stack of their user."""

import contextlib
import socket
import subprocess
import tempfile
from pathlib import Path

import psutil
import pytest
from other_users import AS_ROOT, NOBODY, PYTHON, environment, started_by
from waiting import PATIENCE_S, wait_for

from twin.fabric.discovery import find_conductor
from twin.fabric.endpoint import host_and_port

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

pytestmark = AS_ROOT


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
            assert owner_of(worker.pid) == 0, "what it is handed comes while others load"
            wait_for(lambda: owner_of(simulator.pid) == 0, "files of root's")
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


WATCH = """
import os, sys, time
seen = kept = set()
print("looks", flush=True)
while not kept:
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/stat") as stat, open(f"/proc/{pid}/cmdline") as words:
                parent = stat.read().rpartition(")")[2].split()[1]
                if parent != sys.argv[1] or sys.argv[2] not in words.read():
                    continue
            for name in os.listdir(f"/proc/{pid}/fd"):
                seen = seen | {os.readlink(f"/proc/{pid}/fd/{name}")}
        except PermissionError:
            kept = kept | {pid}
        except OSError:
            pass
print(*sorted(seen), sep="\\n")
"""
"""A process of another program of the user, which looks at what a child of a process has open, from
its start until it keeps to itself."""


FRONT = "twin.fabric.front.process"


def test_a_front_has_no_socket_of_a_role_before_it_keeps_to_itself():
    """It begins when anybody connects, so anybody may choose the moment to look."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o777)
        conductor = started(folder, "conductor", "serve", "--state", f"{folder}/state")
        try:
            state = Path(folder) / "state"
            wait_for((state / "conductor.json").exists, "a conductor that listens")
            at, seen = host_and_port(find_conductor(state).endpoint), []
            while not seen:  # or it came too late
                words = ["-c", WATCH, str(conductor.pid), FRONT]
                spy = started_by(NOBODY, words, folder, stdout=subprocess.PIPE)
                assert spy.stdout.readline() == "looks\n"
                with socket.create_connection(at):
                    seen = spy.communicate(timeout=PATIENCE_S)[0].splitlines()
                if front := child_of(conductor, FRONT):
                    front.kill()  # another one begins
        finally:
            conductor.terminate()
            conductor.communicate()
    assert [each for each in seen if "twin-" in each] == []


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
        words = ["-c", STORE, f"{folder}/store"]
        with started_by(NOBODY, words, folder, stdout=subprocess.PIPE) as conductor:
            pid = int(conductor.stdout.readline())
            wait_for(lambda: owner_of(pid) == 0, "files of root's")
            conductor.kill()


def started(folder, *command):
    """A program of ours that nobody runs."""
    return started_by(NOBODY, ["-m", *command], folder, stdout=subprocess.DEVNULL)


def child_of(worker, word):
    assert worker.poll() is None
    for child in psutil.Process(worker.pid).children():
        with contextlib.suppress(psutil.Error):  # some are there for a moment
            if word in child.cmdline():
                return child
    return None


def owner_of(pid):
    return Path(f"/proc/{pid}/environ").stat().st_uid
