"""Nodes with networks of their own: stacks elsewhere, a node switched off, a node cut off."""

import sys

import pytest
import slurm_namespaces
from changed_campaigns import changed, from_nearby
from processes import MARK, committed, outcomes
from slurm_job import Job
from slurm_namespaces import NamespacedCluster

from conductor.records.fingerprint import fingerprint

pytestmark = [
    pytest.mark.slow,
    pytest.mark.network,
    pytest.mark.skipif(bool(slurm_namespaces.missing()), reason=slurm_namespaces.missing()),
]
BY_HAND = """\
#!/bin/bash
#SBATCH --nodes=2 --ntasks=2 --time=00:30:00 --no-kill
address=$(scontrol show node "$SLURMD_NODENAME" | sed -n 's/.*NodeAddr=\\([^ ]*\\).*/\\1/p')
{python} -m conductor serve --state state --listen "tcp/$address:0" --ttl-s 2 &
until [ -s state/conductor.json ]; do sleep 0.1; done
{python} -m conductor submit campaign.yaml --state state
srun --no-kill --wait=0 --kill-on-bad-exit=0 --label \\
  {python} -m twin worker --state state --wait 60 --until-done
{python} -m conductor stop --state state
wait
"""
"""As docs/cluster.md says it, but with a short time to live: a cut-off node is missed soon."""


@pytest.fixture(scope="module")
def cluster():
    """Three idle nodes on a bridge."""
    slurm = NamespacedCluster()
    try:
        slurm.start()
        yield slurm
    finally:
        slurm.stop()


def test_stacks_on_another_node(marked, cluster, local, tmp_path):
    """``autonomy.placement: node``: frames over TCP between two nodes, the same values."""

    def elsewhere(data):
        from_nearby(data)
        data["autonomy"].update(placement="node")

    path = changed(tmp_path, "aeb-demo", elsewhere)
    where = ("--workers", "1", "--nodes", "2", "--interface", "eth0")
    job = Job(marked, cluster, tmp_path, path, *where, "--slots", "8")

    def places():
        steps = cluster.call("squeue", "--steps", "--noheader", "--format=%i %N").stdout
        return [line.split()[1] for line in steps.splitlines() if line.split()[0][-2:] != "ch"]

    nodes = job.wait(lambda: len(places()) == 2 and places(), "workers and stacks")
    assert sorted(nodes) == ["n1", "n2"]
    found = job.end()
    assert found["ExitCode"] == f"{local['code']}:0", job.text
    assert "joining" in job.text
    assert fingerprint(job.out).sha256 == local["fingerprint"]


def test_late_commits_of_a_node_that_was_cut_off_are_fenced(marked, cluster, tmp_path):
    """Started by hand. The cut-off worker finishes a case that was given to another meanwhile."""
    changed(tmp_path, "chaos-16", lambda data: data["matrix"].update(repeat=[0, 1, 2, 3, 4]))
    script = tmp_path / "job.sh"
    script.write_text(BY_HAND.format(python=sys.executable))
    job = cluster.submit(script, **{MARK: marked.mark})
    out = tmp_path / "state" / "chaos-16"
    log = tmp_path / f"slurm-{job}.out"
    wait = cluster.wait
    wait(lambda: committed(out) >= 2, "two cases")
    (lost,) = {"n1", "n2"} - {cluster.job(job)["BatchHost"]}
    cluster.cut(lost)
    try:
        wait(lambda: list(out.glob("cases/*/attempt-2/kpi.parquet")), "a second attempt")
        assert list(out.glob("cases/*/attempt-1/kpi.parquet"))
    finally:
        cluster.mend(lost)
    found = wait(lambda: cluster.ended(job), "the end of the job")
    assert found["JobState"] == "COMPLETED", log.read_text()
    rows = outcomes(out)
    assert len(rows) == 80
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert all(row["charges"] == [] for row in rows.values())
    late = [(row, each) for row in rows.values() for each in row["late"]]
    assert all(each["agrees"] for _, each in late)
    # With so short a time to live a busy machine may make others late, too.
    cut = [row for row, each in late if each["worker"].startswith(lost)]
    assert cut, "nobody of the cut-off node came late"
    assert not any(row["worker"].startswith(lost) for row in cut)


def test_a_node_is_switched_off(marked, cluster, quiet, tmp_path):
    """Silently, then Slurm is told. Its cases are handed back, and nobody is charged.

    The last test of this cluster: the node stays off.
    """
    where = ("--workers", "2", "--nodes", "2", "--interface", cluster.network)
    job = Job(marked, cluster, tmp_path, "chaos-16", *where)
    job.wait(lambda: committed(job.out) >= 2, "two cases")
    batch = cluster.job(job.id)["BatchHost"]
    (lost,) = {"n1", "n2"} - {batch}
    cluster.switch_off(lost)
    cluster.call("scontrol", "update", f"nodename={lost}", "state=down", "reason=test")
    found = job.end()
    assert (found["ExitCode"], found["Restarts"], found["NodeList"]) == ("1:0", "0", batch)
    assert f"Node failure on {lost}" in job.text
    assert all(row["charges"] == [] for row in outcomes(job.out).values())
    assert quiet["fingerprint"] in job.text
