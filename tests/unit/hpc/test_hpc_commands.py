"""What schedulers print, what a host offers, and the commands that are built for the user."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from test_hpc_slurm import REQUESTS
from waiting import PATIENCE_S

from hpc.doctor import Address, Facts, judge
from hpc.interactive import shell_command
from hpc.pbs.commands import Pbs, parse_queues
from hpc.pbs.commands import parse_job as parse_pbs
from hpc.pull import pull_command
from hpc.scheduler import JobStatus, Partition
from hpc.slurm.array import render as render_array
from hpc.slurm.commands import Slurm, minutes, parse_account, parse_job, parse_sinfo
from twin.base.errors import UsageError
from twin.base.files import filesystem

FACTS = Facts(
    scheduler="slurm",
    looked_for=("sbatch", "qsub"),
    unusable=(),
    version="slurm 22.05.8",
    answers="",
    partitions=(Partition("gpu*", "1-00:00:00", "2 nodes", "2 x gpu:a100:4", "up"),),
    gpus=(),
    containers=("apptainer 1.4.5",),
    folder="/work/runs",
    filesystem="nfs4",
    writable="",
    free_bytes=1 << 40,
    quota="",
    addresses=(Address("lo", "127.0.0.1"), Address("ib0", "10.1.0.1")),
    port="",
    python=(3, 11, 2),
    missing=(),
    site="",
)


@pytest.mark.parametrize(
    ("line", "status"),
    [
        (
            "JobId=7 JobState=PENDING Reason=Resources NodeList=(null) ExitCode=0:0 Restarts=2",
            JobStatus("pending", "PENDING", "Resources", restarts=2),
        ),
        (
            "JobId=7 JobState=RUNNING Reason=None NodeList=n[1-2] ExitCode=0:0 Restarts=0",
            JobStatus("running", "RUNNING", nodes="n[1-2]"),
        ),
        (
            "JobId=7 JobState=FAILED Reason=NonZeroExitCode NodeList=n1 ExitCode=1:0 Restarts=0",
            JobStatus("ended", "FAILED", nodes="n1", exit_code=1),
        ),
        (
            "JobId=7 JobState=TIMEOUT Reason=TimeLimit NodeList=n1 ExitCode=0:9 Restarts=0",
            JobStatus("ended", "TIMEOUT", nodes="n1", exit_code=137),
        ),
    ],
)
def test_slurm_jobs(line, status):
    assert parse_job(line) == status


def test_slurm_accounts():
    found = parse_account("CANCELLED by 0|0:15|n3|1\n")
    assert found == JobStatus("ended", "CANCELLED", nodes="n3", exit_code=143, restarts=1)


@pytest.mark.parametrize(
    ("limit", "expected"),
    [("30:00", 30), ("2:00:00", 120), ("1-12:00:00", 2160), ("infinite", None), ("n/a", None)],
)
def test_slurm_times(limit, expected):
    assert minutes(limit) == expected


def test_pbs_jobs():
    """A long value goes on in the next line after a tab."""
    text = (
        "Job Id: 12.head\n    Job_Name = night\n    job_state = F\n    exec_host = n1/0+n\n\t2/0\n"
        "    Exit_status = 75\n    run_count = 2\n    Variable_List = PBS_O_HOME=/home/me,\n"
        "\tPBS_O_LANG=C\n"
    )
    assert parse_pbs(text) == JobStatus("ended", "F", nodes="n1/0+n2/0", exit_code=75, restarts=1)
    waiting = "Job Id: 12\n    job_state = Q\n    comment = Not Running: no ngpus\n"
    assert parse_pbs(waiting) == JobStatus("pending", "Q", "Not Running: no ngpus")


def test_queues():
    text = (
        "Queue: gpu\n    queue_type = Execution\n    resources_max.walltime = 48:00:00\n"
        "    resources_available.ngpus = 16\n    started = True\n\n"
        "Queue: old\n    started = False\n"
    )
    assert parse_queues(text) == (
        Partition("gpu", "48:00:00", gpus="16 GPUs", state="up"),
        Partition("old", state="stopped"),
    )


def test_partitions_with_unequal_nodes():
    text = (
        "main*|1-00:00:00|1|(null)|up\nmain*|1-00:00:00|2|gpu:a100:4|up\n"
        "low|infinite|3|(null)|down\n"
    )
    assert parse_sinfo(text) == (
        Partition("main*", "1-00:00:00", "3 nodes", "2 x gpu:a100:4", "up"),
        Partition("low", "infinite", "3 nodes", "", "down"),
    )


def test_a_healthy_login_node():
    found = judge(FACTS)
    assert found.can_submit
    assert not [line for line in found.lines if line.level == "bad"]
    assert "10.1.0.1 (ib0)" in next(line.found for line in found.lines if line.what == "addresses")


@pytest.mark.parametrize(
    ("changes", "what", "can_submit"),
    [
        ({"scheduler": "", "partitions": ()}, "scheduler", False),
        ({"answers": "connection refused", "partitions": ()}, "scheduler", False),
        ({"partitions": ()}, "partitions", False),
        ({"writable": "/work/runs: Permission denied"}, "run folder", False),
        ({"missing": ("twin",)}, "software", False),
        ({"python": (3, 9, 1)}, "software", False),
        ({"filesystem": "ext4"}, "shared", True),
        ({"free_bytes": 1 << 20}, "space", True),
        ({"addresses": (Address("lo", "127.0.0.1"),)}, "addresses", True),
        ({"port": "no port"}, "ports", True),
        ({"containers": ()}, "containers", True),
    ],
)
def test_what_will_not_work(changes, what, can_submit):
    found = judge(replace(FACTS, **changes))
    assert found.can_submit == can_submit
    (line,) = [line for line in found.lines if line.what == what and line.level != "ok"]
    assert line.level == ("note" if can_submit else "bad")
    assert line.found


def test_doctor_without_a_scheduler(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "hpc", "doctor"],
        cwd=tmp_path,
        env={"PATH": "/nowhere", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 3
    assert "no job can be submitted" in done.stdout
    assert done.stderr == ""
    assert list(tmp_path.iterdir()) == []


def test_file_systems(tmp_path):
    assert filesystem(tmp_path / "..") != "unknown"
    assert filesystem(Path("/proc/self")) == "proc"


def test_interactive_allocations():
    request = replace(
        REQUESTS["one_node"], modules=("cuda/12",), directives=("--qos=long",), folder="/my work"
    )
    inside = shell_command(request, [])
    assert inside[2].endswith("cd '/my work'; export PATH=/opt/drivetwin/bin:$PATH; exec bash -i")
    words = Slurm().interactive(request, inside)
    assert words[0] == "salloc"
    assert {"--ntasks=4", "--gpus-per-task=1", "--nodes=1", "--qos=long"} <= set(words)
    words = Pbs().interactive(replace(request, directives=()), inside)
    assert words[:2] == ["qsub", "-I"]
    assert "select=1:ncpus=16:ngpus=4:mpiprocs=4" in words


def test_array():
    text = render_array(REQUESTS["two_cpu_workers"], ["a", "b", "c"])
    checked = subprocess.run(["bash", "-n"], input=text, text=True, check=False)
    assert checked.returncode == 0
    assert "#SBATCH --array=1-3%2\n" in text
    assert "#SBATCH --ntasks=1\n" in text
    assert "<<'CASES'\na\nb\nc\nCASES\n" in text
    with pytest.raises(UsageError, match="10001 cases"):
        render_array(REQUESTS["two_cpu_workers"], ["a"] * 10_001)
    with pytest.raises(UsageError, match="placement node"):
        render_array(replace(REQUESTS["two_cpu_workers"], remote_stacks=True), ["a"])


def test_pull_command(tmp_path):
    words = pull_command("login1:runs/x/", tmp_path, rsync=True)
    assert words[0] == "rsync"
    assert words[-2:] == ["login1:runs/x/", f"{tmp_path}/"]
    assert pull_command("login1:runs/x", tmp_path, rsync=False)[-2:] == [
        "login1:runs/x/.",
        str(tmp_path),
    ]


def pull(*arguments, folder, path=None):
    """``hpc pull`` as a user meets it."""
    environment = {**os.environ, **({"PATH": path} if path else {})}
    return subprocess.run(
        [sys.executable, "-m", "hpc", "pull", *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_pull_brings_the_run_and_then_only_what_is_new(tmp_path):
    run = tmp_path / "there" / "night"
    (run / "cases" / "a").mkdir(parents=True)
    (run / "cases" / "a" / "kpi.parquet").write_bytes(b"values")
    (run / "conductor.json").write_text("{}")
    (run / "rigs").mkdir()
    (run / "keys").mkdir()
    (run / "keys" / "authority.key").write_text("private")
    done = pull(str(run), folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "runs/night\n"), done.stderr
    here = tmp_path / "runs" / "night"
    assert (here / "cases" / "a" / "kpi.parquet").read_bytes() == b"values"
    if shutil.which("rsync"):
        assert not (here / "conductor.json").exists()
        assert not (here / "rigs").exists()
        assert not (here / "keys").exists()
    (run / "report.html").write_text("done")
    assert pull(str(run), folder=tmp_path).returncode == 0
    assert (here / "report.html").read_text() == "done"


@pytest.mark.parametrize("source", ["", "none", "-x"])
def test_pull_of_nothing(tmp_path, source):
    done = pull("--", source, folder=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_pull_without_programs(tmp_path):
    (tmp_path / "run").mkdir()
    done = pull("run", folder=tmp_path, path="/nowhere")
    assert done.returncode == 3
    assert "install rsync" in done.stderr


@pytest.mark.parametrize(
    ("free_bytes", "found", "level"),
    [
        (3 << 30, "3.0 GiB free", "ok"),
        (1 << 30, "1.0 GiB free", "ok"),
        (1 << 29, "0.5 GiB free", "note"),
    ],
)
def test_free_space_is_told_in_gibibytes(free_bytes, found, level):
    (line,) = [x for x in judge(replace(FACTS, free_bytes=free_bytes)).lines if x.what == "space"]
    assert (line.found, line.level) == (found, level)
