"""A run on a double of Kubernetes with results and journal in an object store, without a claim."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import re
import signal
import tempfile
import threading
from pathlib import Path

import pytest
from changed_campaigns import changed
from kube_cluster import send
from kube_site import with_kernels
from kubernetes import client, config
from object_store import broken_wire, reached_by, s3_server
from processes import outcomes
from waiting import PATIENCE_S, wait_for

from conductor.core.facts import Committed
from conductor.journal.store import Journal
from conductor.records.fingerprint import fingerprint
from conductor.stored.owner import StoreClaims
from conductor.stored.seals import StoreSeal
from conductor.stored.successor import bring_journal
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.own_keys import fabric_folder, fabric_name
from twin.fabric.keys.roles import Role
from twin.stores.opening import open_store

pytest.importorskip("s3fs")

CASES = 16
FIRST = 3
"""Requests of workers whose results reach the store before the gate closes."""
CREDENTIALS = """[default]
aws_access_key_id = tester
aws_secret_access_key = not-to-be-told
"""


class Gate:
    """Lets the first results of workers into the store, and the others when it is opened."""

    def __init__(self) -> None:
        self.passed = 0
        self._lock = threading.Lock()
        self._opened = threading.Event()

    def before(self, method: str, path: str) -> None:
        """Hold a request that is too early."""
        if method != "PUT" or not re.search("/results/[^/]+/[0-9]+-[0-9a-f]+$", path):
            return
        with self._lock:
            self.passed += 1
            early = self.passed > FIRST
        if early:
            assert self._opened.wait(PATIENCE_S)

    def close(self) -> None:
        """Let everything through: nobody waits at it any more."""
        self._opened.set()


def give_secret(site, **files):
    """Create the Secret of the store with the official client."""
    configuration = client.Configuration()
    config.load_kube_config(str(site.folder / "kubeconfig"), client_configuration=configuration)
    data = {name: base64.b64encode(text.encode()).decode() for name, text in files.items()}
    body = {
        "apiVersion": "v1",
        "kind": "Secret",
        "metadata": {"name": "bucket"},
        "type": "Opaque",
        "data": data,
    }
    client.CoreV1Api(client.ApiClient(configuration)).create_namespaced_secret("robots", body)


def words(port):
    """Directives of a store at ``port``."""
    return (
        "--directive=--store=s3://results/runs",
        "--directive=--store-secret=bucket",
        f"--directive=--store-endpoint=http://127.0.0.1:{port}",
    )


def served(kube, but=""):
    """The running conductor that listens; ``but``: uid of an earlier one."""
    for pod in kube.pods("conductor", "Running"):
        uid = pod["metadata"]["uid"]
        listens = kube.folder / "pods" / uid / "work" / "run" / "conductor.json"
        if uid != but and uid in kube.running and listens.exists():
            return pod
    return None


def commits(site, url, folder):
    """Cases in the journal of the store, as a successor would read it, and their tokens."""
    key = load_key(fabric_folder(fabric_name(site.out)), Role.conductor)
    store = open_store(url)
    seal = StoreSeal(store, key)
    number, _ = StoreClaims(store, seal).latest()
    with tempfile.TemporaryDirectory(dir=folder) as name:
        if not bring_journal(store, seal, number, Path(name)):
            return []
        journal = Journal(Path(name))
        facts = [fact for fact in journal.fold() if isinstance(fact, Committed)]
        journal.close()
    return [(fact.result.case, fact.result.token) for fact in facts]


@pytest.mark.slow
def test_a_conductor_that_moves_has_an_empty_disk(site, kube, marked, quiet, tmp_path, monkeypatch):
    """Killed, then lost with its node: nothing is lost, nothing counts twice."""
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "own"))
    gate = Gate()
    kube.variables["WARP_CACHE_PATH"] = "/kernels"
    kube.image_folders["/kernels"] = with_kernels(kube.folder / "kernels")
    give_secret(site, credentials=CREDENTIALS, config="[default]\nregion = us-east-1\n")
    with (
        s3_server(tmp_path / "s3.log") as port,
        broken_wire(port) as wire,
        reached_by(port),
        contextlib.closing(gate),
    ):
        wire.before = gate.before
        run = site.submitted(*words(wire.port), workers=3, campaign="chaos-16")
        url = f"s3://results/runs/{run}"
        assert not kube.store.list("persistentvolumeclaims")
        first = wait_for(lambda: served(kube), "the conductor")
        before = wait_for(lambda: commits(site, url, tmp_path), "results in the store's journal")
        uid = first["metadata"]["uid"]
        assert send(kube.running[uid].pid, signal.SIGKILL)
        second = wait_for(lambda: served(kube, uid), "another conductor")
        assert kube.lose(second["spec"]["nodeName"])
        gate.close()
        said = site.ended()
        assert said["exit_code"] == 1, "a verdict is not a pass"
        assert said["restarts"] == 2, "the one that was killed, and that verdict; no lost node"
        third = kube.pods("conductor", "Failed")[-1]
        assert third["spec"]["nodeName"] != second["spec"]["nodeName"]

        # What is in the store is all there is, and it is what one machine has.
        pulled = site.hpc("pull", str(site.out), "home")
        assert pulled.returncode == 2
        assert f"its results are in {url}: `conductor report URL --out" in pulled.stderr
        asked = ("conductor", "report", url, "--out", "read")
        read = marked.run(*asked, folder=tmp_path)
        assert read.returncode == 3, "the last pod has signed it with a key of its own"
        (signer,) = re.findall("signed by key ([0-9a-f]{64}), which is not yours", read.stderr)
        assert f"fingerprint {quiet['fingerprint']}" in kube.logs().decode(), "so it is believed"
        (tmp_path / "own" / "trusted").mkdir(mode=0o700)
        (tmp_path / "own" / "trusted" / "pod.pub").write_text(f"{signer}\n")
        read = marked.run(*asked, folder=tmp_path)
        assert read.returncode == 1, read.stderr
        after = commits(site, url, tmp_path)
        assert (len(after), len(dict(after))) == (CASES, CASES), "each once"
        assert {*before} <= {*after}, "what had counted has not run again"
        assert {row["outcome"] for row in outcomes(tmp_path / "read").values()} == {"verdict"}
        assert fingerprint(tmp_path / "read").sha256 == quiet["fingerprint"]

    # Credentials are in their Secret and nowhere else.
    others = [found for _, plural, found in kube.store.history if plural != "secrets"]
    logs = kube.logs().decode()
    assert run in logs
    assert "not-to-be-told" not in f"{others} {logs}"
    assert "not-to-be-told" not in (site.out / "job.yaml").read_text()


def recorded(data):
    """Six recorded cases: some end while a worker still has others to do."""
    data["view"] = "record"
    weathers = ["clear", "heavy_fog", "light_rain"]
    data["matrix"] |= {"weather": weathers, "time_of_day": ["13:00"]}


def assert_recordings_are_here(read, kube):
    """A report has fetched what outcomes name of :func:`recorded` cases."""
    rows = outcomes(read)
    assert len(rows) == 6
    # What a recorder has finished too late for its worker's last seconds is named nowhere.
    named = {name: row["recording"] for name, row in rows.items() if "recording" in row}
    assert named, kube.logs().decode()
    for name, stored in named.items():
        data = (read / rows[name]["attempt_dir"] / "recording.rrd").read_bytes()
        assert (hashlib.sha256(data).hexdigest(), len(data)) == (stored["sha256"], stored["size"])
        assert stored["complete"]


@pytest.mark.slow
def test_recordings_of_pods_are_in_the_store(site, kube, marked, tmp_path, monkeypatch):
    """Pods share no disk with the conductor, and leave nothing behind but what they have put."""
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "own"))
    kube.variables["WARP_CACHE_PATH"] = "/kernels"
    kube.image_folders["/kernels"] = with_kernels(kube.folder / "kernels")
    campaign = changed(tmp_path, "chaos-16", recorded)
    done = site.submit(campaign=campaign)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert "recordings (view: record): workers here share no disk" in line
    assert "give --directive=--store=URL" in line
    assert not kube.store.objects
    give_secret(site, credentials=CREDENTIALS, config="[default]\nregion = us-east-1\n")
    with s3_server(tmp_path / "s3.log") as port, reached_by(port):
        run = site.submitted(*words(port), "--slots", "2", workers=1, campaign=campaign)
        url = f"s3://results/runs/{run}"
        assert site.ended()["exit_code"] == 1, "a verdict is not a pass"
        asked = ("conductor", "report", url, "--out", "read", "--recordings", "all")
        read = marked.run(*asked, folder=tmp_path)
        (signer,) = re.findall("signed by key ([0-9a-f]{64}), which is not yours", read.stderr)
        assert not list(tmp_path.glob("read/cases/*/*/recording.rrd")), "nobody is trusted yet"
        (tmp_path / "own" / "trusted").mkdir(mode=0o700)
        (tmp_path / "own" / "trusted" / "pod.pub").write_text(f"{signer}\n")
        read = marked.run(*asked, folder=tmp_path)
        assert read.returncode == 1, read.stderr
    assert_recordings_are_here(tmp_path / "read", kube)


def test_a_secret_that_is_not_there(site, kube):
    done = site.submit(*words(9), workers=1)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert "--store-secret bucket: namespace robots has no such Secret; kubectl" in line
    assert not kube.store.objects


def test_credentials_that_are_not_accepted(site, kube, tmp_path):
    """The conductor says so in one line of its log, and the Job ends at once: bad input."""
    give_secret(site, other="x")
    with s3_server(tmp_path / "s3.log") as port:
        site.submitted(*words(port), workers=1)
        wait_for(lambda: site.status()["state"] == "ended", "the end of the conductor")
    assert site.status()["exit_code"] == 2
    lines = [line for line in kube.logs().decode().splitlines() if "s3://results/runs" in line]
    assert len(lines) == 1
    assert "credentials" in lines[0]
    assert site.hpc("cancel", str(site.out)).returncode == 0
    wait_for(lambda: not kube.live(), "the end of the pods")
