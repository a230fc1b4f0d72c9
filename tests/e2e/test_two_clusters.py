"""One campaign, two clusters: the second reaches only a login node, and shares no disk."""

import contextlib
import json
import subprocess
import sys

import pytest
import slurm_cluster
from namespaces import hosts_in_a_row
from processes import MARK, committed, keys_of, outcomes, suspended, wait_for
from slurm_cluster import SlurmCluster

from conductor.records.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor

OTHER_DISK = ("sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"')
"""Run a command that sees an empty disk in place of a folder (namespaces of ``ip netns exec``)."""

SLOTS = 2
"""Of each worker."""
JOB_A = """\
#!/bin/bash
#SBATCH --ntasks=1 --output=a.out
{python} -m conductor serve --campaign chaos-16 --until-done --listen tls/127.0.0.1:0 \\
  --state state &
conductor=$!
until [ -e go ]; do sleep 0.1; done
srun --ntasks=1 {python} -m twin worker --state state --wait 60 --slots 2 --until-done
wait "$conductor"
"""
JOB_B = """\
#!/bin/bash
#SBATCH --ntasks=1 --output=b.out
srun --ntasks=1 {python} -m twin worker --connect {entrance} --key {key} --slots 2 --until-done
"""
"""What a user types by hand; ``hpc render`` writes the like of the first."""


@pytest.fixture
def hosts():
    """Node of cluster A, login node, node of cluster B."""
    with hosts_in_a_row(3) as found:
        yield found


@pytest.fixture
def clusters():
    """Two private Slurm clusters side by side."""
    if slurm_cluster.missing():
        pytest.skip(slurm_cluster.missing())
    with contextlib.ExitStack() as stack:
        found = []
        for _ in range(2):
            cluster = SlurmCluster()
            stack.callback(cluster.stop)
            cluster.start()
            found.append(cluster)
        yield found


def relaying(marked, listen, state, prefix=()):
    """A relay on the login node, which sees A's disk; the process and where it listens."""
    relay = marked.start(
        *("conductor", "relay", "--listen", listen, "--state", str(state)), prefix=prefix
    )
    line = relay.stdout.readline()
    assert line.startswith(f"relay to {find_conductor(state).endpoint} at "), relay.communicate()
    return relay, line.split()[-1]


def both_have_a_share(marked, campaign, in_b):
    """Let B commit a case while A's simulators stand still, then A one while B's do.

    How soon a worker starts, or finds its way back, is a matter of the machine: without this, one
    of them may have done all 16 cases before the other has done its first.
    """
    in_a = wait_for(
        lambda: [process for process in marked.processes("sim") if process not in in_b],
        "a simulator in A",
    )
    with suspended(in_a):
        before = committed(campaign)
        wait_for(lambda: committed(campaign) > before, "a case of B")
    with suspended([process for process in marked.processes("sim") if process not in in_a]):
        most = committed(campaign) + SLOTS  # what of B is on its way to the disk
        wait_for(lambda: committed(campaign) > most, "a case of A")


@pytest.mark.network
def test_workers_of_two_clusters(marked, quiet, tmp_path, hosts):
    node_a, login, node_b = hosts
    state = tmp_path / "state"
    key = ("--key", str(keys_of(state)))
    copy, laptop = tmp_path / "copied.key", tmp_path / "laptop.key"
    marked.start(
        *("conductor", "serve", "--state", str(state), "--ttl-s", "5"),
        *("--listen", f"tcp/{node_a.addresses[0]}:0"),
        prefix=node_a.inside,
    )
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    endpoint = find_conductor(state).endpoint
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    unreachable = [*node_b.inside, "bash", "-c", f"exec 3<>/dev/tcp/{host}/{port}"]
    assert subprocess.run(unreachable, capture_output=True, check=False).returncode != 0
    relay, entrance = relaying(marked, f"tls/{login.addresses[1]}:0", state, login.inside)
    # B has a copy of a worker's key and nothing else of A's disk.
    copy.write_bytes((keys_of(state) / "worker.key").read_bytes())
    copy.chmod(0o600)
    submit = marked.start(
        *("conductor", "submit", "chaos-16", "--connect", endpoint, *key), prefix=node_a.inside
    )
    assert submit.communicate()[0].startswith("submitted")
    worker_b = marked.start(
        *("twin", "worker", "--connect", entrance, "--key", str(copy)),
        *("--slots", str(SLOTS), "--until-done"),
        prefix=(*node_b.inside, *OTHER_DISK, str(state)),
    )
    in_b = wait_for(lambda: marked.processes("sim"), "a simulator in B")
    relay.kill()
    relay, again = relaying(marked, entrance, state, login.inside)
    assert again == entrance
    worker_a = marked.start(
        *("twin", "worker", "--state", str(state), "--slots", str(SLOTS), "--until-done"),
        prefix=node_a.inside,
    )
    both_have_a_share(marked, state / "chaos-16", in_b)
    workers = [worker_a, worker_b]
    errors = [worker.communicate()[1] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], errors
    assert ["not the conductor's folder here" in error for error in errors] == [False, True]
    invitation = marked.run(
        *("conductor", "invite", "--role", "admin", "--state", str(state)),
        *("--connect", entrance, "--out", str(laptop)),
    )
    assert invitation.returncode == 0, invitation.stderr
    stop = marked.start(*("conductor", "stop", "--key", str(laptop)), prefix=node_b.inside)
    assert stop.communicate()[0].startswith("draining"), "and a laptop may command through it"
    relay.terminate()
    wait_for(lambda: not marked.processes(), "the end")
    rows = outcomes(state / "chaos-16")
    assert len({row["worker"] for row in rows.values()}) == 2, json.dumps(rows)
    assert fingerprint(state / "chaos-16").sha256 == quiet["fingerprint"]


def test_jobs_of_two_slurm_clusters(marked, quiet, tmp_path, clusters):
    """An allocation here and one there; jobs are queued by two controllers that share nothing."""
    state = tmp_path / "state"
    jobs = []

    def submit(cluster, name, text, **values):
        script = tmp_path / name
        script.write_text(text.format(python=sys.executable, **values))
        jobs.append((cluster, cluster.submit(script, **{MARK: marked.mark})))

    submit(clusters[0], "a.sh", JOB_A)
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    relay, entrance = relaying(marked, "tls/127.0.0.1:0", state)
    submit(clusters[1], "b.sh", JOB_B, entrance=entrance, key=keys_of(state) / "worker.key")
    in_b = wait_for(lambda: marked.processes("sim"), "a simulator in B")
    (tmp_path / "go").touch()
    both_have_a_share(marked, state, in_b)
    ends = [wait_for(lambda: c.ended(job), f"job {job}") for c, job in jobs]  # noqa: B023
    logs = [(tmp_path / name).read_text() for name in ("a.out", "b.out")]
    assert [end["ExitCode"] for end in ends] == ["1:0", "0:0"], logs
    relay.terminate()
    rows = outcomes(state)
    assert len({row["worker"] for row in rows.values()}) == 2, logs
    assert fingerprint(state).sha256 == quiet["fingerprint"]
