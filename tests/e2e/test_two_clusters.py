"""One campaign, two clusters: the second reaches only a login node, and shares no disk."""

import json
import subprocess

import pytest
from namespaces import hosts_in_a_row
from processes import outcomes, wait_for

from conductor.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor

pytestmark = pytest.mark.network

OTHER_DISK = ("sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"')
"""Run a command that sees an empty disk in place of a folder (namespaces of ``ip netns exec``)."""


@pytest.fixture
def hosts():
    """Node of cluster A, login node, node of cluster B."""
    with hosts_in_a_row(3) as found:
        yield found


def relaying(marked, login, listen, state):
    """A relay on the login node, which sees A's disk; the process and where it listens."""
    relay = marked.start(
        *("conductor", "relay", "--listen", listen, "--state", str(state)), prefix=login.inside
    )
    line = relay.stdout.readline()
    assert line.startswith(f"relay to {find_conductor(state).endpoint} at "), relay.communicate()
    return relay, line.split()[-1]


def test_workers_of_two_clusters(marked, quiet, tmp_path, hosts):
    node_a, login, node_b = hosts
    state = tmp_path / "state"
    key = ("--key", str(state / "conductor.key"))
    copy = tmp_path / "copied.key"
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
    relay, entrance = relaying(marked, login, f"tls/{login.addresses[1]}:0", state)
    # B has a copy of the key and nothing else of A's disk.
    copy.write_bytes((state / "conductor.key").read_bytes())
    copy.chmod(0o600)
    submit = marked.start(
        *("conductor", "submit", "chaos-16", "--connect", endpoint, *key), prefix=node_a.inside
    )
    assert submit.communicate()[0].startswith("submitted")
    worker_b = marked.start(
        *("twin", "worker", "--connect", entrance, "--key", str(copy)),
        *("--slots", "2", "--until-done"),
        prefix=(*node_b.inside, *OTHER_DISK, str(state)),
    )
    wait_for(lambda: marked.processes("sim"), "a simulator in B")
    relay.kill()
    relay, again = relaying(marked, login, entrance, state)
    assert again == entrance
    worker_a = marked.start(
        *("twin", "worker", "--state", str(state), "--slots", "2", "--until-done"),
        prefix=node_a.inside,
    )
    workers = [worker_a, worker_b]
    errors = [worker.communicate()[1] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], errors
    assert ["not the conductor's folder here" in error for error in errors] == [False, True]
    stop = marked.start(
        *("conductor", "stop", "--connect", entrance, "--key", str(copy)), prefix=node_b.inside
    )
    assert stop.communicate()[0].startswith("draining"), "and a laptop may command through it"
    relay.terminate()
    wait_for(lambda: not marked.processes(), "the end")
    rows = outcomes(state / "chaos-16")
    assert len({row["worker"] for row in rows.values()}) == 2, json.dumps(rows)
    assert fingerprint(state / "chaos-16").sha256 == quiet["fingerprint"]
