"""A worker that is started before the conductor listens, and what it does until it is told; and the
stack that it has load meanwhile."""

import os
import queue
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import psutil
import pytest
from case_changes import changed
from waiting import PATIENCE_S, wait_for

from conductor.run.source import load
from devkit.detector.model_files import shipped_models
from schemas.sections.foreign import Foreign
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease
from twin.rig.pipe import Building, BuildRig, Built, Listening, pack
from twin.sandbox.start import own_code
from twin.worker.options import WorkerOptions
from twin.worker.preload import begin_loading
from twin.worker.rig_process import RigProcess
from twin.worker.stack_process import load_stack, may_run, tell_stack

OPTIONS = WorkerOptions(connect="", slots=1, view=ViewMode.none)


def children_of(worker):
    """Its simulator and its stack, as soon as there are both."""

    def found():
        assert worker.poll() is None
        children = [
            child
            for child in psutil.Process(worker.pid).children()
            if {"sim", "devkit"} & set(words(child))
        ]
        return children if len(children) == 2 else None

    return wait_for(found, "two children")


def words(process):
    """Its command line; none of one that has just ended."""
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def ignores_sigterm(pid):
    """The last of what binds a waiting stack to its worker has been done."""
    status = Path(f"/proc/{pid}/status").read_text()
    ignored = int(status.split("SigIgn:")[1].split()[0], 16)
    return bool(ignored >> (signal.SIGTERM - 1) & 1)


def test_nobody_to_serve_and_words_that_are_none(tmp_path):
    """It ends with the simulator and the stack that were loading; a line that is no order is one
    for people."""
    options = ("worker", "-", '{"load_simulator": true}')
    workers = [
        subprocess.Popen(
            [sys.executable, "-m", "twin", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    loading = [child for worker in workers for child in children_of(worker)]
    unserved, misled = workers
    assert unserved.communicate("") == ("", "")
    assert unserved.returncode == 0
    out, err = misled.communicate('{"connect": "tcp/127.0.0.1:1"}\n')
    assert (misled.returncode, out) == (2, "")
    assert err.startswith("twin: worker -: standard input: ")
    assert err.count("\n") == 1
    psutil.wait_procs(loading, PATIENCE_S)
    assert not any(process.is_running() for process in loading)


def test_from_then_on_its_words_are_in_the_log(tmp_path):
    log = tmp_path / "worker-1.log"
    told = f'{{"connect": "tcp/127.0.0.1:1", "slots": 3, "log": "{log}"}}\n'
    worker = subprocess.run(
        [sys.executable, "-m", "twin", "worker", "-", '{"device": "cuda:99"}'],
        input=told,
        capture_output=True,
        text=True,
        env={**os.environ, "CUDA_VISIBLE_DEVICES": ""},
    )
    assert (worker.returncode, worker.stdout, worker.stderr) == (2, "", "")
    assert "device 'cuda:99': not here" in log.read_text()


@pytest.mark.parametrize("device", ["cpu", "cuda:99"])
def test_a_gpu_that_is_not_here_keeps_nobody_from_hearing_what_to_do(device):
    """Whoever needs it says so: the simulator when it builds, the stack when a network loads."""
    loading = begin_loading(device)
    try:
        simulator, stack = loading.simulator.process, loading.stack.process
        maps = Path(f"/proc/{simulator.pid}/maps")
        wait_for(lambda: "warp" in maps.read_text(), "the simulator loads what it needs")
        build = BuildRig(
            lease=Lease(token=1, attempt=1, out="", case=load("chaos-16").cases[0]),
            rig="r",
            listen="tcp/256.0.0.1:0",
            namespace="twin",
            slots=1,
            device=device,
            view=ViewMode.none,
            view_namespace="twin",
            view_connect="",
        )
        simulator.stdin.write(pack(build))
        simulator.stdin.flush()
        assert b"cannot open a session" in simulator.stdout.read()
        assert tell_stack(stack, ["--wrong"])
        assert stack.wait(PATIENCE_S) == 2
        assert "No such option: --wrong" in words_of(loading.stack)
    finally:
        loading.discard()


def words_of(child):
    return os.pread(child.log.fileno(), 1 << 16, 0).decode()


def test_what_loads_is_killed_with_its_worker_even_if_it_is_frozen():
    worker = subprocess.Popen(
        [sys.executable, "-m", "twin", "worker", "-", '{"load_simulator": true}'],
        stdin=subprocess.PIPE,
    )
    loading = children_of(worker)
    stack = next(process for process in loading if "devkit" in words(process))
    wait_for(lambda: ignores_sigterm(stack.pid), "its end with the worker's")
    stack.terminate()  # as a scheduler that ends a job: it leaves that to the worker
    stack.suspend()
    worker.kill()
    worker.communicate()
    gone, alive = psutil.wait_procs(loading, PATIENCE_S)
    assert (len(gone), alive) == (len(loading), [])


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("", 0, ""),
        ("--rig r\n", 2, "devkit: --connect -: standard input: JSON is malformed"),
        ('{"rig": 1}\n', 2, "devkit: --connect -: standard input: Expected `array`"),
        ('["--rig", "r"]\n', 2, "devkit: give --connect, --rig and --stack"),
        ('["--wrong"]\n', 2, "No such option: --wrong"),
    ],
)
def test_what_a_waiting_stack_is_told_counts_as_if_typed(line, code, words):
    told = subprocess.run(
        [sys.executable, "-m", "devkit", "host", "--connect", "-"],
        input=line,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert (told.returncode, told.stdout) == (code, "")
    assert words in told.stderr if words else told.stderr == ""
    assert "Traceback" not in told.stderr


def test_only_a_shipped_stack_at_the_worker_is_run_by_what_waits(tmp_path):
    case = load("chaos-16").cases[0]
    assert may_run(case)
    foreign = Foreign(command=["true"])
    others = [
        changed(case, **{key: value})
        for key, value in (
            ("placement", "node"),
            ("placement", "inline"),
            ("stack", "mine:Stack"),
            ("foreign", foreign),
        )
    ]
    assert not any(may_run(other) for other in others)
    shipped = str(shipped_models()["yolov3-w25"])
    assert may_run(changed(case, models=[shipped]))
    assert not may_run(changed(case, models=[shipped, str(tmp_path / "own.onnx")]))
    loading = begin_loading("cpu")
    lease = Lease(token=1, attempt=1, out=str(tmp_path), case=others[-1])
    rig = RigProcess(OPTIONS, lease, 1, queue.SimpleQueue(), loading)
    try:
        process = loading.stack.process
        assert own_code(process, process.returncode) == -signal.SIGKILL
        assert loading.stack.log.closed
        assert loading.simulator.process.poll() is None
    finally:
        rig.stop()


def test_a_frozen_stack_is_not_told_what_no_pipe_takes(tmp_path):
    log = tempfile.TemporaryFile()  # noqa: SIM115
    frozen = load_stack("cpu", tmp_path, log)
    frozen.process.send_signal(signal.SIGSTOP)
    assert not tell_stack(frozen.process, ["x" * (1 << 21)])
    frozen.discard()
    dead = load_stack("cpu", tmp_path, log)
    dead.process.kill()
    dead.process.wait()
    assert not tell_stack(dead.process, ["--rig"])
    dead.discard()
    assert not log.closed
    log.close()


def test_another_stack_takes_the_place_of_one_that_died_while_it_waited(tmp_path):
    case = load("chaos-16").cases[0]
    inbox = queue.SimpleQueue()
    loading = begin_loading("cpu")
    rig = RigProcess(
        OPTIONS, Lease(token=1, attempt=1, out=str(tmp_path), case=case), 1, inbox, loading
    )
    try:
        seen = []
        while not seen or not isinstance(seen[-1], Built):
            _, message = inbox.get(timeout=PATIENCE_S)
            seen.append(message)
            if isinstance(message, Listening):
                loading.stack.process.kill()
                loading.stack.process.wait()
                rig.start_stack(message.endpoint)
            assert isinstance(message, Building | Listening | Built), message
        assert rig.memory_bytes()["simulator"] > 0
        assert rig.memory_bytes()["stack"] > 0
    finally:
        rig.stop()
