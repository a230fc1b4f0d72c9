"""``hpc scale`` on a private Slurm: killed in the middle of what it does, and dismissed."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
import slurm_cluster
import yaml
from processes import MARK
from site_networks import own_bin
from slurm_job import hpc
from waiting import wait_for

MISSING = slurm_cluster.missing()
pytestmark = pytest.mark.skipif(bool(MISSING), reason=MISSING)

STUCK = """\
campaign: stuck
simulator: noop
requires: {tags: [nobody]}
matrix: {repeat: [0, 1, 2, 3, 4, 5, 6, 7]}
"""
"""Cases that are left as long as the test lasts."""
SLOWLY = ["sh", "-c", 'sleep 0.2; exec sh -c "$0"']
"""A login node that takes its time: whoever asks it is killed meanwhile."""
ALLOCATIONS = 3


class Scaled:
    """A run whose workers find nothing to do."""

    def __init__(self, marked, cluster, folder):
        self.marked, self.cluster, self.folder = marked, cluster, folder
        self.out = folder / "runs" / "stuck"
        self.own = {MARK: marked.mark, "DRIVETWIN_HOME": str(folder / "home")}
        (folder / "stuck.yaml").write_text(STUCK)
        entry = {"scheduler": "slurm", "reach": SLOWLY, "folder": str(folder / "jobs")}
        entry |= {"bin": own_bin(), "workers": 1, "time": "00:30", "queued": ALLOCATIONS}
        (folder / "sites.yaml").write_text(yaml.safe_dump({"sites": {"here": entry}}))
        (folder / "sites.yaml").chmod(0o600)

    def hpc(self, *words):
        words = (*words, "--sites", "sites.yaml")
        return hpc(self.cluster, *words, folder=self.folder, **self.own)

    def scaler(self, *words):
        number = ALLOCATIONS
        words = ("scale", "runs/stuck", "--on", "slurm:here", "--target", f"{number}:{number}")
        child = subprocess.Popen(
            [sys.executable, "-m", "hpc", *words, "--period-s", "0.2", "--sites", "sites.yaml"],
            env={**self.cluster.environment, **self.own},
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
        )
        self.marked.children.append(child)
        return child

    def book(self):
        return json.loads((self.out / "allocations.json").read_text())

    def jobs(self):
        """Names of the jobs that Slurm has ever seen of this run."""
        text = self.cluster.call("squeue", "--noheader", "--states=all", "--format=%j %i").stdout
        return [line.split()[0] for line in text.splitlines() if line.startswith("here-")]


@pytest.fixture
def scaled(marked, cluster, tmp_path):
    made = Scaled(marked, cluster, tmp_path)
    try:
        yield made
    finally:
        cluster.call("scancel", "--name=here-1,here-2,here-3", check=False)


def test_killed_in_the_middle_of_submissions(scaled):
    """Each time an allocation was written down, and before or while it is submitted."""
    done = scaled.hpc("submit", "stuck.yaml", "--on", "slurm:here", "--time", "00:30")
    assert done.returncode == 0, done.stderr
    assert "here-1: slurm job" in done.stdout
    for number in range(2, ALLOCATIONS + 1):
        child = scaled.scaler()
        wait_for(lambda n=number: scaled.book()["made"] >= n, "an allocation that is wanted")
        child.kill()
        child.wait()
    child = scaled.scaler()
    wait_for(lambda: all(each["job"] for each in scaled.book()["allocations"]), "their jobs")
    wait_for(lambda: all(each["joined"] for each in scaled.book()["allocations"]), "workers")
    child.terminate()
    assert child.wait() == 75
    names = [f"here-{number}" for number in range(1, ALLOCATIONS + 1)]
    assert sorted(scaled.jobs()) == names, "one job for each allocation, no more"
    assert [each["id"] for each in scaled.book()["allocations"]] == names
    said = scaled.hpc("status", "runs/stuck").stdout
    assert said.count(": running, slurm job") == ALLOCATIONS, said
    ended = scaled.hpc("cancel", "runs/stuck")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.count("told to end") == ALLOCATIONS + 1
    wait_for(lambda: not scaled.marked.processes(), "the end of workers and conductor")
