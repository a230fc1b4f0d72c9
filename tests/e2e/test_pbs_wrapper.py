"""PBS scripts through Debian's qsub wrapper (slurm-wlm-torque). This is Slurm under another name.

It shows that a script is taken by something called qsub, runs, submits itself again and ends with
the right verdict. It shows nothing of PBS Pro's own chunks, placement, signals or node file.
"""

import shutil

import pytest
import slurm_cluster
from processes import committed, outcomes, suspended
from slurm_job import Job

MISSING = slurm_cluster.missing() or (
    "" if shutil.which("qsub") else "needs the Debian package slurm-wlm-torque"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=MISSING),
]


def test_submitted_again(marked, cluster, quiet, tmp_path):
    """Signalled as by its own timer, it submits itself again; the values are those of one run."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "2", "--scheduler", "pbs")
    assert job.said["scheduler"] == "pbs"
    assert cluster.call("qstat", job.id).stdout
    job.wait(lambda: committed(job.out) >= 1, "a case")
    # However long the signal takes to arrive on a busy machine, cases are left then.
    simulators = marked.processes("sim")
    with suspended(simulators):
        # The wrapper has no qsig.
        cluster.call("scancel", "--batch", "--signal=USR2", job.id)
        job.wait(lambda: "asked to drain" in logs(job), "a worker that is asked to drain")
    first = job.end()
    assert first["ExitCode"] == "75:0", logs(job)
    scheduler, job.id = (job.out / "job.id").read_text().split()
    assert scheduler == "pbs"
    assert job.id != first["JobId"]
    assert cluster.job(job.id)["JobName"] == "chaos-16"
    last = job.end()
    assert last["ExitCode"] == "1:0", logs(job)
    assert logs(job).count("unfinished, queued again as") == 1
    assert f"fingerprint {quiet['fingerprint']}" in logs(job)
    rows = outcomes(job.out).values()
    assert {row["outcome"] for row in rows} == {"verdict"}
    # Where the signal takes long, a simulator that stands still is charged with that, and no other.
    charges = [charge for row in rows for charge in row["charges"]]
    assert all("no progress for" in charge for charge in charges), charges
    assert f"pbs job {job.id}: C" in job.hpc("status")


def test_deleted(marked, cluster, tmp_path):
    """``qdel`` means it: the job does not come back."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "1", "--scheduler", "pbs")
    job.wait(lambda: committed(job.out) >= 1, "a case")
    job.hpc("cancel")
    assert job.end()["JobState"] == "CANCELLED"
    assert (job.out / "job.id").read_text() == f"pbs {job.id}\n"
    assert "queued again" not in logs(job)


def logs(job):
    """All that the starts have said; the wrapper names and splits logs in its own way."""
    return "\n".join(path.read_text() for path in sorted(job.out.glob("*.[oe][0-9]*")))
