"""Simulator and stack in two network namespaces over mutual TLS: the same verdicts."""

import stat
from pathlib import Path

import msgspec
import pytest
import yaml
from namespaces import hosts_in_a_row
from processes import keys_of, outcomes, wait_for

import conductor
from conductor.records.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor
from twin.worker.announcement import me

pytestmark = pytest.mark.network


@pytest.fixture
def hosts():
    """Two hosts joined by a cable."""
    with hosts_in_a_row(2) as found:
        yield found


def test_stack_on_another_host(marked, quiet, tmp_path, hosts):
    here, there = hosts
    address = here.addresses[0]
    source = Path(conductor.__file__).parent / "campaigns" / "chaos-16.yaml"
    data = yaml.safe_load(source.read_text())
    data["autonomy"]["placement"] = "node"
    data["matrix"]["time_of_day"] = ["05:00", "13:00"]
    path = tmp_path / "chaos-16.yaml"
    path.write_text(yaml.safe_dump(data))
    state, rigs = tmp_path / "state", tmp_path / "rigs"
    rigs.mkdir()
    inside = here.inside
    server = marked.start(
        *("conductor", "serve", "--state", str(state), "--listen", "tls/127.0.0.1:0"),
        prefix=inside,
    )
    wait_for(lambda: (state / "conductor.json").exists() and find_conductor(state), "the conductor")
    submit = marked.start("conductor", "submit", str(path), "--state", str(state), prefix=inside)
    assert submit.communicate()[0].startswith("submitted")
    marked.start(*("devkit", "host", "--join", str(rigs)), prefix=there.inside)
    # What a worker of this host left that was killed.
    (rigs / ".dead.owner").write_bytes(msgspec.json.encode(msgspec.structs.replace(me(), pid=0)))
    (rigs / "dead.key").touch()
    worker = marked.start(
        *("twin", "worker", "--state", str(state), "--slots", "4", "--until-done"),
        *("--drive-listen", f"tcp/{address}:0", "--join-dir", str(rigs)),
        prefix=inside,
    )
    (key,) = wait_for(lambda: [p for p in rigs.glob("[!.]*.key") if p.stem != "dead"], "its key")
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert not (keys_of(state) / "stack.key").exists(), "nothing else opens a rig"
    _, err = worker.communicate()
    assert worker.returncode == 0, err
    assert list(rigs.iterdir()) == [], "they end with the rig, and those of dead rigs"
    server.terminate()
    server.communicate()
    rows = outcomes(state / "chaos-16")
    assert all(row["outcome"] == "verdict" for row in rows.values())
    assert fingerprint(state / "chaos-16").sha256 == quiet["fingerprint"]
    for process in marked.processes("host"):
        process.terminate()


def test_worker_on_another_host(marked, quiet, tmp_path, hosts):
    """Conductor here, worker there: control over TLS, rig on the worker's own loopback."""
    here, there = hosts
    address = here.addresses[0]
    state = tmp_path / "state"
    inside, outside = here.inside, there.inside
    server = marked.start(
        *("conductor", "serve", "--state", str(state), "--listen", f"tcp/{address}:0"),
        prefix=inside,
    )
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    endpoint = find_conductor(state).endpoint
    assert endpoint.startswith(f"tls/{address}:"), "what was asked for as tcp/ is TLS"
    connect = ("--connect", endpoint, "--key", str(keys_of(state)))
    submit = marked.start("conductor", "submit", "chaos-16", *connect, prefix=outside)
    assert submit.communicate()[0].startswith("submitted")
    worker = marked.start(
        *("twin", "worker", *connect, "--slots", "2", "--until-done"), prefix=outside
    )
    _, err = worker.communicate()
    assert worker.returncode == 0, err
    server.terminate()
    server.communicate()
    assert fingerprint(state / "chaos-16").sha256 == quiet["fingerprint"]
