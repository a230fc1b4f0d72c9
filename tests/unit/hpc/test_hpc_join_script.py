"""Scripts of workers that join a conductor elsewhere, run by bash with stand-ins."""

import re

import pytest
from test_hpc_pbs_script import PbsJob
from test_hpc_script_logic import Job
from waiting import PATIENCE_S, wait_for

from hpc.pbs.job_script import render
from hpc.pbs.lint import lint
from hpc.request import JobRequest
from twin.base.errors import UsageError

TWIN = """
if [ "$STAY" ]; then
  # Nothing that outlives it holds the pipe of who started the job.
  sleep 600 > /dev/null 2>&1 &
  trap "kill $!; exit 75" TERM
fi
printf '%s\\n' "$@" > "$T/worker.args"
[ ! "$STAY" ] || { : > "$T/stays.$$"; wait; }
exit "${CODE:-0}"
"""
SRUN = """
echo "$@" > "$T/srun.args"; while [[ $1 == --* ]]; do shift; done
bash -c 'echo $$ > "$T/step.pid"; exec "$@"' step "$@" & wait $!
"""
"""The number of the step stands there before the worker can say anything."""
JOIN = {"connect": "tls/login:7447", "site": "north", "allocation": "north-3"}


class SlurmJoin(Job):
    tasks = 1  # the stand-in of srun starts one

    def __init__(self, folder):
        self.stubs = {**Job.stubs, "bin/twin": TWIN, "slurm/srun": SRUN}
        super().__init__(folder, join=str(folder / "the key"), **JOIN)


class PbsJoin(PbsJob):
    tasks = 2

    def __init__(self, folder):
        self.stubs = {**PbsJob.stubs, "bin/twin": TWIN}
        super().__init__(folder, join=str(folder / "the key"), **JOIN)


@pytest.fixture(params=[SlurmJoin, PbsJoin])
def job(request, tmp_path):
    return request.param(tmp_path)


@pytest.mark.parametrize("code", ["0", "75", "3"])
def test_the_workers_exit_code_is_the_jobs(job, code):
    assert job.run(CODE=code)[0] == int(code)
    assert job.said("conductor") == ""
    assert job.said("worker").splitlines() == [
        *("worker", "--key", str(job.folder / "the key")),
        *("--site", "north", "--tag", "allocation:north-3", "--wait", "120"),
        *("--started-again", "--until-done", "--device", "cpu"),
    ]
    assert "requeue" not in job.said("scontrol")
    assert job.said("qsub") == ""


def test_a_signal_is_forwarded(job):
    with job.start(STAY="1") as child:
        wait_for(lambda: len([*job.folder.glob("stays.*")]) == job.tasks, "all workers")
        child.terminate()
        child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 75


def test_the_worst_code_of_several_tasks_counts(tmp_path):
    job = PbsJoin(tmp_path)
    (tmp_path / "bin" / "twin").write_text(
        '#!/bin/bash\nmkdir "$T/first" 2>/dev/null && exit 75\nexit 0\n'
    )
    assert job.run()[0] == 75


def test_pbs_takes_it(tmp_path):
    request = {
        "campaign": "aeb-demo",
        "out": "/o",
        "folder": "/o",
        "bin_folder": "/b",
        "walltime_min": 60,
        "gpus": 2,
        "join": "/o/worker.key",
        **JOIN,
    }
    text = render(JobRequest(**request))
    assert lint(text) == []
    assert "#PBS -N north-3\n" in text
    assert "#PBS -r n\n" in text
    assert not re.search('conductor["=]', text)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"join": "worker.key"}, "give an absolute path"),
        ({"join": "/a\nb"}, "line break"),
        ({"connect": ""}, "expected tls/HOST:PORT"),
        ({"connect": "tcp/a:1"}, "expected tls/HOST:PORT"),
        ({"connect": "tls/$(id):1"}, "expected tls/HOST:PORT"),
        ({"site": "a b"}, "1 to 32 letters"),
        ({"allocation": "north"}, "expected SITE-NUMBER"),
        ({"allocation": "north-3;id"}, "expected SITE-NUMBER"),
        ({"remote_stacks": True}, "autonomy.placement: node"),
    ],
)
def test_mistakes(change, said):
    place = {"out": "/o", "folder": "/o", "bin_folder": "/b", "walltime_min": 60}
    request = {"campaign": "aeb-demo", "workers": 1, "join": "/o/worker.key", **place, **JOIN}
    with pytest.raises(UsageError, match=said):
        JobRequest(**{**request, **change})
