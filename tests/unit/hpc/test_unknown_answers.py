"""Answers about a job's state that say nothing: the job has not ended by them."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from hpc.cli import app
from hpc.pbs.commands import Pbs
from hpc.scheduler import JobStatus
from hpc.slurm.commands import Slurm, parse_account, parse_job
from hpc.submit import JOB_FILE, check_free
from twin.base.errors import InfrastructureError, TwinError, UsageError


@pytest.fixture
def says(tmp_path, monkeypatch):
    """Puts a program into the path that answers as a line of shell says."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")

    def put(program, line):
        path = folder / program
        path.write_text(f"#!/bin/sh\n{line}\n")
        path.chmod(0o700)

    return put


@pytest.mark.parametrize(
    ("native", "state"),
    [
        *((word, "ended") for word in ("COMPLETED", "BOOT_FAIL", "OUT_OF_MEMORY", "REVOKED")),
        *((word, "ended") for word in ("CANCELLED", "DEADLINE", "FAILED", "NODE_FAIL", "TIMEOUT")),
        *((word, "running") for word in ("RUNNING", "STOPPED", "RESIZING", "COMPLETING")),
        *((word, "pending") for word in ("PENDING", "REQUEUED")),
        *((word, "unknown") for word in ("FROZEN", "completed", "COMPLETED+", "RECONFIG_FAIL")),
    ],
)
def test_states_of_slurm(native, state):
    """An allocation that somebody has stopped, or whose state is new, has not ended."""
    found = parse_job(f"JobId=7 JobState={native} ExitCode=0:0")
    assert (found.state, found.native) == (state, native)
    assert parse_account(f"{native}|0:0|n1|0\n").state == state


@pytest.mark.parametrize(
    ("scontrol", "sacct", "status"),
    [
        ("echo slurm_load_jobs error: Invalid job id specified >&2; exit 1", "exit 0", "gone"),
        ("echo slurm_load_jobs error: Invalid job id specified >&2; exit 1", "exit 1", "gone"),
        (
            "echo slurm_load_jobs error: Invalid job id specified >&2; exit 1",
            "echo 'FROZEN|0:0|n1|0'",
            "unknown",
        ),
        ("echo JobId=7 JobState=FROZEN", "exit 1", "unknown"),
        ("echo Last login: today", "exit 1", "unknown"),
        ("exit 0", "exit 1", "unknown"),
    ],
)
def test_what_slurm_says_of_a_job(says, scontrol, sacct, status):
    says("scontrol", scontrol)
    says("sacct", sacct)
    found = Slurm().status("7")
    assert (found.state, found.exit_code) == (status, None)


@pytest.mark.parametrize(
    ("qstat", "state"),
    [
        ("echo qstat: Unknown Job Id 7.head >&2; exit 153", "gone"),
        ("exit 153", "gone"),  # Slurm's wrapper says nothing else
        ("printf 'Job Id: 7\\n    job_state = F\\n'", "ended"),
        ("printf 'Job Id: 7\\n    job_state = R\\n'", "running"),
        ("printf 'Job Id: 7\\n    job_state = Z\\n'", "unknown"),
        ("printf 'Job Id: 7\\n    job_state = Frozen\\n'", "unknown"),
        ("printf 'Job Id: 7\\n'", "unknown"),
        ("echo Last login: today", "unknown"),
        # A history that is not kept, which only the first of two questions asks for.
        ("[ $# = 3 ] && exit 27; printf 'Job Id: 7\\n    job_state = Q\\n'", "pending"),
        ("[ $# = 3 ] && exit 27; echo qstat: Unknown Job Id 7 >&2; exit 153", "gone"),
        ("[ $# = 3 ] && exit 27; echo qstat: 7 Job has finished >&2; exit 35", "gone"),
    ],
)
def test_what_pbs_says_of_a_job(says, qstat, state):
    says("qstat", qstat)
    assert Pbs().status("7").state == state


@pytest.mark.parametrize(
    ("qstat", "kind", "line"),
    [
        ("echo Problem loading jobs. >&2; exit 255", InfrastructureError, "does not answer"),
        ("echo qstat: cannot connect to server head >&2; exit 111", InfrastructureError, "answer"),
        ("echo qstat: End of File >&2; exit 1", TwinError, "job 7: qstat: End of File"),
        ("exit 1", TwinError, "job 7: exit code 1"),
    ],
)
def test_a_server_of_pbs_in_trouble_says_nothing_of_a_job(says, qstat, kind, line):
    says("qstat", qstat)
    with pytest.raises(kind, match=line):
        Pbs().status("7")


@pytest.mark.parametrize(
    ("status", "kind", "line"),
    [
        (JobStatus("running", "R"), UsageError, "job 7 is R and works here"),
        (JobStatus("unknown", "Frozen"), InfrastructureError, "job 7 may still work here: .Frozen"),
        (JobStatus("unknown"), InfrastructureError, "may still work here: nothing is said of it"),
    ],
)
def test_no_second_job_while_nobody_knows_of_the_first(tmp_path, status, kind, line):
    class System(Slurm):
        def status(self, job):
            assert job == "7"
            return status

    (tmp_path / JOB_FILE).write_text("slurm 7\n")
    with pytest.raises(kind, match=line):
        check_free(tmp_path, System())


@pytest.mark.parametrize("state", ["ended", "gone"])
def test_the_next_job_after_the_end_of_the_first(tmp_path, state):
    asked = []

    class System(Slurm):
        def status(self, job):
            asked.append(job)
            return JobStatus(state)

    (tmp_path / JOB_FILE).write_text("slurm 7\n")
    check_free(tmp_path, System())
    assert asked == ["7"]


@pytest.mark.parametrize(
    ("scontrol", "line"),
    [
        ("echo JobState=FROZEN", "slurm job 7: FROZEN, which is no known state; ask again"),
        ("exit 0", "slurm job 7: nothing is said of it, which is no known state; ask again"),
        ("echo Invalid job id >&2; exit 1", "slurm job 7: not known any more; see its log"),
    ],
)
def test_hpc_status(says, scontrol, line):
    says("scontrol", scontrol)
    says("sacct", "exit 1")
    done = CliRunner().invoke(app, ["status", "7", "--scheduler", "slurm"])
    assert (done.exit_code, done.output) == (0, f"{line}\n")
