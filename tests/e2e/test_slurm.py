"""Rendered job scripts on a real Slurm: a private cluster of three nodes, for this module alone."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
import slurm_cluster
from processes import MARK, Marked, committed, outcomes
from slurm_cluster import SlurmCluster

PATIENCE_S = 500.0
"""Longest a job may take; it has to share two slow cores."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(bool(slurm_cluster.missing()), reason=slurm_cluster.missing()),
]


@pytest.fixture(scope="module")
def cluster():
    """Three idle nodes; two of them have two pretended GPUs each."""
    slurm = SlurmCluster()
    try:
        slurm.start()
        yield slurm
    finally:
        slurm.stop()


@pytest.fixture(scope="session")
def local(tmp_path_factory):
    """``conductor run aeb-demo`` on this machine, without Slurm: its fingerprint."""
    folder = tmp_path_factory.mktemp("local") / "aeb-demo"
    starter = Marked()
    try:
        child = starter.start(
            "conductor", "run", "aeb-demo", "--out", str(folder), "--output", "json"
        )
        out, err = child.communicate(timeout=PATIENCE_S)
        assert child.returncode == 1, err
        return json.loads(out)["fingerprint"]
    finally:
        starter.end()


class Job:
    """A campaign rendered and submitted."""

    def __init__(self, marked, cluster, folder, campaign, *options):
        self.cluster = cluster
        self.out = folder / "a folder"
        self.script = render(folder, campaign, "--out", str(self.out), *options)
        self.id = cluster.submit(self.script, **{MARK: marked.mark})
        self.log = folder / f"slurm-{self.id}.out"

    def wait(self, look, what):
        """Poll until ``look`` returns something true."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            if found := look():
                return found
            time.sleep(0.1)
        raise AssertionError(f"in vain: {what}\n{self.text}\n{self.cluster.logs()}")

    def end(self):
        """Wait until it has ended; what Slurm knows of it."""
        return self.wait(lambda: self.cluster.ended(self.id), "the end of the job")

    @property
    def text(self):
        """Its log."""
        return self.log.read_text() if self.log.exists() else "(no log)"


def render(folder, campaign, *options, time_limit="00:30"):
    """``hpc render``; the script's path."""
    done = subprocess.run(
        [sys.executable, "-m", "hpc", "render", campaign, "--time", time_limit, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    script = folder / "job.sh"
    script.write_text(done.stdout)
    return script


@pytest.mark.parametrize(
    "options",
    [
        ["--workers", "1"],
        ["--workers", "20", "--nodes", "3", "--restarts-max", "0"],
        ["--gpus", "4", "--slots", "64", "--partition", "main", "--account", "proj@x"],
        ["--gpus", "2", "--nodes", "2", "--cpus-per-worker", "8", "--signal-lead", "300"],
        ["--gpus", "1", "--nodes", "1", "--out", '/tmp/it\'s $(a) "folder"'],
    ],
    ids=" ".join,
)
def test_sbatch_accepts(cluster, tmp_path, options):
    script = render(tmp_path, "aeb-demo", *options)
    done = cluster.call("sbatch", "--test-only", str(script))
    assert "to start at" in done.stderr


def test_sbatch_refuses_what_the_cluster_has_not(cluster, tmp_path):
    """``--test-only`` does look at the request: the test above could fail."""
    script = render(tmp_path, "aeb-demo", "--gpus", "5")
    assert cluster.call("sbatch", "--test-only", str(script), check=False).returncode != 0


def test_aeb_demo(marked, cluster, local, tmp_path):
    """Two nodes, one worker on each: the verdict is the exit code, the values are the same."""
    job = Job(marked, cluster, tmp_path, "aeb-demo", "--workers", "2", "--nodes", "2")
    found = job.end()
    assert found["ExitCode"] == "1:0", job.text
    assert (found["Restarts"], found["NumNodes"]) == ("0", "2")
    done = marked.run("conductor", "fingerprint", str(job.out))
    assert done.stdout.strip() == local
    assert (job.out / "report.html").exists()
    assert "6 of 8 passed" in job.text
    assert {line[:2] for line in job.text.splitlines() if "slot(s) on cpu" in line} == {"0:", "1:"}
    assert not (job.out / "conductor.json").exists()


def test_told_to_stop(marked, cluster, quiet, tmp_path):
    """As before the end of the wall time: drained, queued again, finished by the second start."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "2")
    job.wait(lambda: committed(job.out) >= 4, "four cases")
    cluster.call("scancel", "--batch", "--signal=TERM", job.id)
    job.wait(lambda: cluster.job(job.id)["Restarts"] == "1", "the second start")
    rows = outcomes(job.out)
    done = {name for name, row in rows.items() if row["outcome"]}
    assert 4 <= len(done) < 16
    before = {name: kpi_ns(job.out, rows[name]) for name in done}
    found = job.end()
    assert (found["ExitCode"], found["Restarts"]) == ("1:0", "1"), job.text
    assert job.text.count("unfinished, queued again") == 1
    rows = outcomes(job.out)
    assert len(rows) == 16
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert all(row["charges"] == [] for row in rows.values())
    assert before == {name: kpi_ns(job.out, rows[name]) for name in done}, "done twice"
    assert quiet["fingerprint"] in job.text


def kpi_ns(out: Path, row) -> int:
    """When the committed attempt's values were written [ns]."""
    return (out / row["attempt_dir"] / "kpi.parquet").stat().st_mtime_ns


def test_cancelled(marked, cluster, tmp_path):
    """Whoever cancels a job does not want it queued again."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "1")
    job.wait(lambda: committed(job.out) >= 1, "a case")
    cluster.call("scancel", job.id)
    found = job.end()
    assert (found["JobState"], found["Restarts"]) == ("CANCELLED", "0")
    assert "queued again" not in job.text


def test_a_node_is_lost(marked, cluster, quiet, tmp_path):
    """The job goes on with the worker on the other node, and nobody is charged."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "2", "--nodes", "2")
    job.wait(lambda: committed(job.out) >= 4, "four cases")
    batch = cluster.job(job.id)["BatchHost"]
    (lost,) = {"n1", "n2"} - {batch}
    try:
        cluster.call("scontrol", "update", f"nodename={lost}", "state=down", "reason=test")
        found = job.end()
    finally:
        # Refused if its slurmd has already said that it is well.
        cluster.call("scontrol", "update", f"nodename={lost}", "state=resume", check=False)
    assert (found["ExitCode"], found["Restarts"], found["NodeList"]) == ("1:0", "0", batch)
    assert f"Node failure on {lost}" in job.text
    assert all(row["charges"] == [] for row in outcomes(job.out).values())
    assert quiet["fingerprint"] in job.text


@pytest.fixture
def probes(tmp_path):
    """Stand-ins for ``conductor`` and ``twin``: each worker writes which GPU it sees."""
    conductor = """
        mkdir -p "${@: -1}"; cd "${@: -1}"; echo {} > conductor.json
        until [ "$(cat worker-* 2>/dev/null | wc -l)" = 4 ]; do sleep 0.05; done
        rm conductor.json
    """
    twin = 'echo "$SLURMD_NODENAME $CUDA_VISIBLE_DEVICES ${@: -1}" > "$3/worker-$SLURM_PROCID"'
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, text in (("conductor", conductor), ("twin", twin)):
        (folder / name).write_text(f"#!/bin/bash\n{text}\n")
        (folder / name).chmod(0o755)
    return folder


@pytest.mark.parametrize("options", [[], ["--nodes", "2", "--slots", "8"]], ids=" ".join)
def test_each_worker_sees_one_gpu_of_its_own(marked, cluster, tmp_path, probes, options):
    job = Job(marked, cluster, tmp_path, "aeb-demo", "--gpus", "4", "--bin", str(probes), *options)
    found = job.end()
    assert found["ExitCode"] == "0:0", job.text
    seen = sorted(path.read_text().strip() for path in job.out.glob("worker-*"))
    assert seen == ["n2 0 cuda:0", "n2 1 cuda:0", "n3 0 cuda:0", "n3 1 cuda:0"]
