"""Submission leaves a queued job, or the folder as it was."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from test_hpc_slurm import REQUESTS

import hpc.submit
from hpc.backends import scheduler
from hpc.scheduler import JobStatus
from hpc.slurm.job_script import render
from hpc.submit import check_walltime, job_of, p95_s, submit
from twin.base.errors import InfrastructureError, UsageError


class Ledger:
    """A batch system that keeps a list, and refuses at the point it is told to."""

    name = "slurm"

    def __init__(self, refuses=""):
        self.refuses = refuses
        self.jobs = {}

    def render(self, request):
        return render(request)

    def check(self, text, request, /):
        if self.refuses == "check":
            raise UsageError("refused")

    def submit(self, path, folder):
        if self.refuses == "submit":
            raise UsageError("refused")
        job = str(len(self.jobs) + 1)
        self.jobs[job] = path.read_text()
        return job

    def status(self, job):
        return JobStatus("running" if job in self.jobs else "gone", "RUNNING")

    def cancel(self, job):
        del self.jobs[job]

    def log(self, job, request, /):
        return f"slurm-{job}.out"


@pytest.fixture
def request_here(tmp_path):
    return replace(REQUESTS["two_cpu_workers"], out=str(tmp_path / "runs" / "a b"))


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_job_is_queued(tmp_path, request_here):
    ledger = Ledger()
    done = submit(request_here, ledger, 60.0)
    out = Path(request_here.out)
    assert (done.job, done.scheduler, done.out) == ("1", "slurm", str(out))
    assert ledger.jobs["1"] == (out / "job.sh").read_text() == render(request_here)
    assert os.access(out / "job.sh", os.X_OK)
    assert job_of(out) == ("slurm", "1")
    assert sorted(path.name for path in out.iterdir()) == ["job.id", "job.sh"]


def test_files_are_no_wider_than_the_umask(tmp_path, request_here):
    before = os.umask(0o077)
    try:
        submit(request_here, Ledger(), 60.0)
    finally:
        os.umask(before)
    out = Path(request_here.out)
    assert [(out / name).stat().st_mode & 0o777 for name in ("job.sh", "job.id")] == [0o700, 0o600]


def test_a_job_that_nobody_would_know_of_is_cancelled(tmp_path, request_here, monkeypatch):
    real = hpc.submit.write_atomic

    def interrupted(path, data, **options):
        if path.name == "job.id":
            raise KeyboardInterrupt
        real(path, data, **options)

    monkeypatch.setattr("hpc.submit.write_atomic", interrupted)
    ledger = Ledger()
    with pytest.raises(KeyboardInterrupt):
        submit(request_here, ledger, 60.0)
    assert ledger.jobs == {}
    assert everything(tmp_path) == []


@pytest.mark.parametrize("refuses", ["check", "submit"])
def test_a_refusal_leaves_nothing(tmp_path, request_here, refuses):
    with pytest.raises(UsageError, match="refused"):
        submit(request_here, Ledger(refuses), 60.0)
    assert everything(tmp_path) == []


@pytest.mark.parametrize("refuses", ["check", "submit"])
def test_a_refusal_leaves_what_was_there(tmp_path, request_here, refuses):
    out = Path(request_here.out)
    out.mkdir(parents=True)
    (out / "job.sh").write_text("an older one")
    (out / "conductor.db").write_text("results")
    before = everything(tmp_path)
    with pytest.raises(UsageError, match="refused"):
        submit(request_here, Ledger(refuses), 60.0)
    assert everything(tmp_path) == before
    assert (out / "job.sh").read_text() == "an older one"


@pytest.mark.parametrize("full_at", ["probe", "job.sh", "job.id"])
def test_a_full_disk_or_quota_is_one_line_and_nothing_is_queued(
    tmp_path, request_here, monkeypatch, full_at
):
    real = hpc.submit.write_atomic

    def full(path, data, **options):
        if full_at in path.name:
            raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT), str(path))
        real(path, data, **options)

    monkeypatch.setattr("hpc.submit.write_atomic", full)
    ledger = Ledger()
    with pytest.raises(InfrastructureError, match="quota is used up") as caught:
        submit(request_here, ledger, 60.0)
    assert len(str(caught.value).splitlines()) == 1
    assert ledger.jobs == {}
    assert everything(tmp_path) == []


def test_one_job_per_folder(request_here):
    ledger = Ledger()
    submit(request_here, ledger, 60.0)
    with pytest.raises(UsageError, match="job 1 is RUNNING and works here"):
        submit(request_here, ledger, 60.0)
    ledger.cancel("1")
    submit(request_here, ledger, 60.0)


@pytest.mark.parametrize(
    ("minutes", "deadline_s", "case_s", "least"),
    [
        (4, 60.0, None, None),
        (3, 60.0, None, "00:04"),
        (4, 90.0, None, None),
        (4, 90.5, None, "00:05"),
        (60, 60.0, 3450.0, None),
        (60, 60.0, 3451.0, "01:01"),
    ],
)
def test_a_case_must_fit(request_here, minutes, deadline_s, case_s, least):
    asked = replace(request_here, walltime_min=minutes)
    if least is None:
        check_walltime(asked, deadline_s, case_s)
        return
    with pytest.raises(UsageError, match=f"give --time {least} or more"):
        check_walltime(asked, deadline_s, case_s)


def test_what_earlier_starts_took(tmp_path):
    assert p95_s(tmp_path) is None
    rows = {str(n): {"outcome": "verdict", "wall_s": float(n)} for n in range(1, 101)}
    rows["open"] = {"outcome": "", "wall_s": 1e9}
    (tmp_path / "outcomes.json").write_text(json.dumps({"cases": rows}))
    assert p95_s(tmp_path) == 95.0
    (tmp_path / "outcomes.json").write_text("{")
    assert p95_s(tmp_path) is None


def test_no_scheduler_on_this_host(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    for kind in ("auto", "slurm", "pbs"):
        with pytest.raises(InfrastructureError, match="log in to a login node"):
            scheduler(kind)
