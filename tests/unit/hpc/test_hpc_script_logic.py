"""Rendered scripts run by bash, with stand-ins for Slurm's commands and for ours."""

import os
import subprocess

import pytest
from waiting import PATIENCE_S, wait_for

from hpc.request import JobRequest
from hpc.slurm.job_script import render

STUBS = {
    # Announces itself as the real one does, then ends as the test says.
    "bin/conductor": """
        printf '%s\\n' "$@" > "$T/conductor.args"
        trap 'rm -f "$T/o ut/conductor.json"; exit ${ON_TERM:-75}' TERM
        [ "$BEFORE_LISTENING" ] && exit "$BEFORE_LISTENING"
        mkdir -p "$T/o ut"; echo "{}" > "$T/o ut/conductor.json"
        until [ -e "$T/worker.args" ] && [ ! -e "$T/hold" ]; do sleep 0.02; done
        rm "$T/o ut/conductor.json"
        [ "$KILLED" ] && kill -KILL $$
        exit "${VERDICT:-0}"
    """,
    "bin/twin": """printf '%s\\n' "$@" > "$T/worker.args"; [ ! "$STAY" ] || exec sleep 60""",
    "slurm/srun": """
        echo "$@" > "$T/srun.args"; while [[ $1 == --* ]]; do shift; done
        "$@" & echo $! > "$T/step.pid"; wait
    """,
    "slurm/scancel": """echo "$@" >> "$T/scancel.args"; kill "$(cat "$T/step.pid")" """,
    "slurm/scontrol": """
        echo "$@" >> "$T/scontrol.args"
        [ "$1" != show ] || echo "   NodeAddr=${NODE_ADDR:-10.9.8.7} NodeHostName=n1 Version=1"
    """,
    "slurm/squeue": """echo "${STATE:-RUNNING}" """,
}


class Job:
    """A rendered script in a folder of its own."""

    stubs = STUBS
    tools = "slurm"

    def __init__(self, folder, **changes):
        self.folder = folder
        for name, text in self.stubs.items():
            path = folder / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(f"#!/bin/bash\n{text}\n")
            path.chmod(0o755)
        request = {
            "campaign": "aeb-demo",
            "out": str(folder / "o ut"),
            "folder": str(folder),
            "bin_folder": str(folder / "bin"),
            "walltime_min": 60,
            "workers": 2,
            **changes,
        }
        (folder / "job.sh").write_text(self.render(request))

    def render(self, request):
        """The script's text."""
        return render(JobRequest(**request))

    def start(self, **environment):
        path = f"{self.folder}/{self.tools}:{os.environ['PATH']}"
        own = {"T": str(self.folder), "SLURM_JOB_ID": "7", "SLURMD_NODENAME": "n1", "PATH": path}
        return subprocess.Popen(
            ["bash", str(self.folder / "job.sh")],
            env={**os.environ, **own, **environment},
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, **environment):
        """To its end; exit code and standard error."""
        with self.start(**environment) as child:
            _, err = child.communicate(timeout=PATIENCE_S)
        return child.returncode, err

    def said(self, name):
        """What a command was called with, in all calls."""
        path = self.folder / f"{name}.args"
        return path.read_text() if path.exists() else ""


@pytest.mark.parametrize("verdict", ["0", "1", "3"])
def test_the_verdict_is_the_exit_code(tmp_path, verdict):
    job = Job(tmp_path)
    assert job.run(VERDICT=verdict)[0] == int(verdict)
    assert "requeue" not in job.said("scontrol")
    assert job.said("conductor").splitlines() == [
        *("serve", "--campaign", "aeb-demo", "--until-done"),
        *("--listen", "tls/10.9.8.7:0", "--state", str(tmp_path / "o ut")),
    ]
    assert job.said("worker").splitlines() == [
        *("worker", "--state", str(tmp_path / "o ut"), "--wait", "120", "--until-done"),
        *("--device", "cpu"),
    ]


def test_the_conductor_learns_lengths_from_an_earlier_run(tmp_path):
    job = Job(tmp_path, history=str(tmp_path / "an old run"))
    assert job.run()[0] == 0
    assert job.said("conductor").splitlines()[-2:] == ["--history", str(tmp_path / "an old run")]


def test_bad_input_starts_no_worker(tmp_path):
    job = Job(tmp_path)
    assert job.run(BEFORE_LISTENING="2")[0] == 2
    assert job.said("srun") == ""


@pytest.mark.parametrize(
    ("environment", "code", "requeued"),
    [
        ({"VERDICT": "75"}, 75, True),
        ({"VERDICT": "75", "SLURM_RESTART_COUNT": "19"}, 75, True),
        ({"VERDICT": "75", "SLURM_RESTART_COUNT": "20"}, 75, False),
        ({"VERDICT": "75", "STATE": "COMPLETING"}, 75, False),
        ({"KILLED": "1"}, 3, False),
        ({"VERDICT": "0", "STAY": "1"}, 0, False),
    ],
)
def test_ends(tmp_path, environment, code, requeued):
    job = Job(tmp_path)
    assert job.run(**environment)[0] == code
    assert ("requeue 7" in job.said("scontrol")) == requeued
    assert ("--signal=TERM 7.0" in job.said("scancel")) == ("STAY" in environment)


@pytest.mark.parametrize("on_term", ["75", "1"])
def test_a_signal_is_forwarded(tmp_path, on_term):
    """Also when the conductor finished while it was told to stop: then its verdict counts."""
    job = Job(tmp_path)
    (tmp_path / "hold").touch()
    with job.start(STAY="1", ON_TERM=on_term) as child:
        wait_for(lambda: job.said("worker"), "the worker")
        child.terminate()
        _, err = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == int(on_term)
    assert ("unfinished, queued again" in err) == (on_term == "75")
    assert "--signal=TERM 7.0" in job.said("scancel")


def test_an_old_conductor_file_is_not_believed(tmp_path):
    job = Job(tmp_path)
    (tmp_path / "o ut").mkdir()
    (tmp_path / "o ut" / "conductor.json").write_text("{}\n")
    assert job.run(BEFORE_LISTENING="3")[0] == 3
    assert job.said("srun") == ""


@pytest.mark.parametrize(
    ("changes", "address"),
    [
        ({}, "10.9.8.7"),
        ({"nodes": 1}, "127.0.0.1"),
        ({"workers": 1}, "127.0.0.1"),
        ({"address": "192.0.2.1"}, "192.0.2.1"),
    ],
)
def test_where_it_listens(tmp_path, changes, address):
    job = Job(tmp_path, **changes)
    assert job.run()[0] == 0
    assert f"tls/{address}:0" in job.said("conductor")


def test_a_node_name_that_means_loopback_is_not_used(tmp_path):
    job = Job(tmp_path)
    assert job.run(NODE_ADDR="localhost")[0] == 0
    assert "tls/" in job.said("conductor")
    assert "tls/127." not in job.said("conductor")


def test_a_worker_on_each_gpu(tmp_path):
    job = Job(tmp_path, workers=0, gpus=2, slots=16)
    assert job.run()[0] == 0
    assert "--ntasks=2 --cpus-per-task=4 --gpus-per-task=1 --no-kill" in job.said("srun")
    assert job.said("worker").splitlines()[-4:] == ["--slots", "16", "--device", "cuda:0"]
