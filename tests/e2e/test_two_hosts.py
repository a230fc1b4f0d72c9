"""Simulator and stack in two network namespaces over mutual TLS: the same verdicts."""

import os
import shutil
import subprocess
import uuid
from pathlib import Path

import pytest
import yaml
from processes import outcomes, wait_for

import conductor
from conductor.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor

pytestmark = pytest.mark.network


def ip(*arguments):
    """``ip ARGUMENTS``."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


@pytest.fixture
def hosts():
    """Two network namespaces joined by a cable; yields their names and addresses."""
    if shutil.which("ip") is None:
        pytest.skip("needs the Debian package iproute2")
    if os.geteuid() != 0:
        pytest.skip("needs root for network namespaces")
    tag = uuid.uuid4().hex[:6]
    one, two = f"tw{tag}a", f"tw{tag}b"
    made = []
    try:
        for name in (one, two):
            ip("netns", "add", name)
            made.append(name)
            ip("-n", name, "link", "set", "lo", "up")
        ip(
            "link",
            "add",
            f"v{tag}a",
            "netns",
            one,
            "type",
            "veth",
            "peer",
            f"v{tag}b",
            "netns",
            two,
        )
        for name, end, address in ((one, "a", "10.77.9.1"), (two, "b", "10.77.9.2")):
            ip("-n", name, "addr", "add", f"{address}/24", "dev", f"v{tag}{end}")
            ip("-n", name, "link", "set", f"v{tag}{end}", "up")
        yield (one, "10.77.9.1"), (two, "10.77.9.2")
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "del", name], capture_output=True)


def test_stack_on_another_host(marked, quiet, tmp_path, hosts):
    (here, address), (there, _) = hosts
    source = Path(conductor.__file__).parent / "campaigns" / "chaos-16.yaml"
    data = yaml.safe_load(source.read_text())
    data["autonomy"]["placement"] = "node"
    data["matrix"]["time_of_day"] = ["05:00", "13:00"]
    path = tmp_path / "chaos-16.yaml"
    path.write_text(yaml.safe_dump(data))
    state, rigs = tmp_path / "state", tmp_path / "rigs"
    rigs.mkdir()
    inside = ("ip", "netns", "exec", here)
    server = marked.start(
        *("conductor", "serve", "--state", str(state), "--listen", "tls/127.0.0.1:0"),
        prefix=inside,
    )
    wait_for(lambda: (state / "conductor.json").exists() and find_conductor(state), "the conductor")
    submit = marked.start("conductor", "submit", str(path), "--state", str(state), prefix=inside)
    assert submit.communicate()[0].startswith("submitted")
    marked.start(*("devkit", "host", "--join", str(rigs)), prefix=("ip", "netns", "exec", there))
    worker = marked.start(
        *("twin", "worker", "--state", str(state), "--slots", "4", "--until-done"),
        *("--drive-listen", f"tcp/{address}:0", "--join-dir", str(rigs)),
        prefix=inside,
    )
    _, err = worker.communicate()
    assert worker.returncode == 0, err
    server.terminate()
    server.communicate()
    rows = outcomes(state / "chaos-16")
    assert all(row["outcome"] == "verdict" for row in rows.values())
    assert fingerprint(state / "chaos-16").sha256 == quiet["fingerprint"]
    for process in marked.processes("host"):
        process.terminate()


def test_worker_on_another_host(marked, quiet, tmp_path, hosts):
    """Conductor here, worker there: control over TLS, rig on the worker's own loopback."""
    (here, address), (there, _) = hosts
    state = tmp_path / "state"
    inside, outside = ("ip", "netns", "exec", here), ("ip", "netns", "exec", there)
    server = marked.start(
        *("conductor", "serve", "--state", str(state), "--listen", f"tcp/{address}:0"),
        prefix=inside,
    )
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    endpoint = find_conductor(state).endpoint
    assert endpoint.startswith(f"tls/{address}:"), "what was asked for as tcp/ is TLS"
    connect = ("--connect", endpoint, "--key", str(state / "conductor.key"))
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
