"""Fixtures of the end-to-end tests."""

import fcntl
import json
import os
import subprocess
from pathlib import Path

import kube_cluster
import pytest
from changed_campaigns import changed, from_nearby
from kube_cluster import KubeCluster
from kube_site import NOOP, Site
from processes import MARK, Marked, nothing_left
from slurm_cluster import SlurmCluster

from conductor.records.fingerprint import fingerprint


@pytest.fixture
def marked():
    """Starts processes; fails if anything is left behind, and kills it."""
    starter = Marked()
    try:
        with nothing_left(starter):
            yield starter
    finally:
        starter.end()


@pytest.fixture(scope="session")
def quiet(tmp_path_factory):
    """The campaign chaos-16 run once in peace: 1 worker x 1 slot."""
    return _once(tmp_path_factory, "quiet", "chaos-16", "--workers", "1", "--slots", "1")


@pytest.fixture(scope="session")
def local(tmp_path_factory):
    """The demo from nearby on this machine, without a scheduler: 2 workers x 1 slot."""
    path = changed(tmp_path_factory.mktemp("demo"), "aeb-demo", from_nearby)
    return _once(tmp_path_factory, "local", path, "--workers", "2", "--slots", "1")


@pytest.fixture(scope="session")
def cluster():
    """A private Slurm: three idle nodes; two of them have two and four pretended GPUs."""
    slurm = SlurmCluster()
    try:
        slurm.start()
        yield slurm
    finally:
        slurm.stop()


def _once(tmp_path_factory, name, campaign, *options):
    """A campaign that is run once for all processes of pytest-xdist; what it said.

    Tests must leave its folder as it is, since others read it at the same time.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, said = shared / name / Path(campaign).stem, shared / f"{name}.json"
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not said.exists():
            asked = ("conductor", "run", campaign, "--out", str(folder), "--output", "json")
            starter = Marked()
            try:
                child = starter.start(*asked, *options)
                out, err = child.communicate(timeout=500)
            finally:
                starter.end()
            assert child.returncode in (0, 1), err
            text = {"code": child.returncode, "stdout": out, "stderr": err}
            said.write_text(json.dumps({"folder": str(folder), **text}))
    found = json.loads(said.read_text())
    return {**found, "folder": folder, **json.loads(found["stdout"])}


@pytest.fixture
def kube(marked):
    if kube_cluster.missing():
        pytest.skip(kube_cluster.missing())
    with KubeCluster(variables={MARK: marked.mark}) as found:
        yield found


@pytest.fixture
def site(marked, kube, tmp_path, monkeypatch):
    monkeypatch.setenv("KUBECONFIG", str(tmp_path / "kubeconfig"))
    return Site(marked, kube, tmp_path)


@pytest.fixture(scope="session")
def many_here(tmp_path_factory):
    """Fingerprint of the campaign of :mod:`kube_site` on this machine."""
    folder = tmp_path_factory.mktemp("here")
    (folder / "many.yaml").write_text(NOOP)
    starter = Marked()
    try:
        done = starter.run("conductor", "run", "many.yaml", "--out", "out", folder=folder)
    finally:
        starter.end()
    assert done.returncode == 0, done.stderr
    return fingerprint(folder / "out").sha256


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs root to mount a small tmpfs")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)
