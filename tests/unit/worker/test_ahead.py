"""A worker that is started before the conductor listens, and what it does until it is told."""

import os
import subprocess
import sys

import psutil


def test_nobody_to_serve_and_words_that_are_none(tmp_path):
    """It ends with the simulator that was loading; a line that is no order is one for people."""
    options = ("worker", "--connect", "-", "--load-simulator")
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
    loading: dict[int, psutil.Process] = {}
    while len(loading) < len(workers):
        for worker in workers:
            loading.update((p.pid, p) for p in psutil.Process(worker.pid).children())
        assert all(worker.poll() is None for worker in workers)
    unserved, misled = workers
    assert unserved.communicate("") == ("", "")
    assert unserved.returncode == 0
    out, err = misled.communicate('{"connect": "tcp/127.0.0.1:1"}\n')
    assert (misled.returncode, out) == (2, "")
    assert err.startswith("twin: --connect -: standard input: ")
    assert err.count("\n") == 1
    psutil.wait_procs(loading.values(), 30)
    assert not any(process.is_running() for process in loading.values())


def test_from_then_on_its_words_are_in_the_log(tmp_path):
    log = tmp_path / "worker-1.log"
    told = f'{{"connect": "tcp/127.0.0.1:1", "slots": 3, "log": "{log}"}}\n'
    worker = subprocess.run(
        [sys.executable, "-m", "twin", "worker", "--connect", "-", "--device", "cuda:99"],
        input=told,
        capture_output=True,
        text=True,
        env={**os.environ, "CUDA_VISIBLE_DEVICES": ""},
    )
    assert (worker.returncode, worker.stdout, worker.stderr) == (2, "", "")
    assert "device 'cuda:99': not here" in log.read_text()
