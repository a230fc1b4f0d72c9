"""A campaign on a double of Kubernetes whose pods are real processes, over the official client."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import threading

import kube_cluster
import pytest
import yaml
from kube_api import Api, RefusalError, Store
from kube_cluster import IMAGE, KubeCluster, send
from kube_site import CASES, Site, with_kernels
from kubernetes import client, config, watch
from processes import MARK, committed, outcomes
from waiting import wait_for

from conductor.records.fingerprint import fingerprint
from hpc.kubernetes.api import Namespace
from hpc.kubernetes.commands import Kubernetes
from hpc.request import JobRequest
from hpc.submit import submit
from twin.base.errors import InfrastructureError
from twin.fabric.keys.own_keys import fabric_folder, fabric_name


def all_there(folder, expected):
    """Every case has one outcome, and the results are those of one machine."""
    rows = outcomes(folder)
    assert len(rows) == CASES
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert fingerprint(folder).sha256 == expected


def batch(site):
    """The official client, as a user would write a script with it."""
    configuration = client.Configuration()
    config.load_kube_config(str(site.folder / "kubeconfig"), client_configuration=configuration)
    return client.BatchV1Api(client.ApiClient(configuration))


def held(kube, count):
    """Wait until so many workers have joined, and hear SIGTERM; each is stopped as soon as it has,
    so that cases are left for the others. Returns what is to be continued."""
    stopped = {}

    def all_stopped():
        for pod in kube.pods("worker", "Running"):
            running = kube.running.get(pod["metadata"]["uid"])
            said = kube.log("robots", pod["metadata"]["name"])
            pid = running.pid if running else 0
            if pid not in stopped and b"slot(s) on cpu" in said and send(pid, signal.SIGSTOP):
                stopped[pid] = pod
        return len(stopped) >= count

    wait_for(all_stopped, f"{count} workers")
    return [*stopped]


def thaw(pids):
    for pid in pids:
        send(pid, signal.SIGCONT)  # some have gone meanwhile


def test_a_run_from_its_submission_to_its_results(site, kube, many_here, tmp_path):
    run = site.submitted()
    assert (site.out / "job.yaml").read_text().startswith("# Objects of Kubernetes")
    assert (site.out / "job.id").read_text() == f"kubernetes robots/{run}@double\n"
    said = site.ended()
    assert (said["native"], said["exit_code"], said["restarts"]) == ("Complete", 0, 0)
    jobs = {
        job.metadata.name: job.status for job in batch(site).list_namespaced_job("robots").items
    }
    assert jobs[f"{run}-worker"].conditions[0].type == "Complete"
    folder = site.pulled(tmp_path / "home")
    all_there(folder, many_here)
    assert not list(folder.rglob("conductor.json"))
    assert not kube.pods("reader"), "the pod that read the claim has gone"
    # Secrets are in Secrets and nowhere else: no variable, no log, no other object.
    keys = fabric_folder(fabric_name(site.out))
    bodies = [path.read_text().splitlines()[6][:60] for path in keys.glob("*.key")]
    assert len(bodies) == 6
    secrets = {found["metadata"]["name"]: found["data"] for found in kube.store.list("secrets")}
    assert {name: [*data] for name, data in secrets.items()} == {
        f"{run}-conductor": ["conductor.key"],
        f"{run}-worker": ["worker.key"],
    }
    others = [found for _, plural, found in kube.store.history if plural != "secrets"]
    seen = f"{others} {kube.logs().decode()}"
    files = [path for path in kube.claim(run).rglob("*") if path.is_file()]
    seen += "".join(path.read_bytes().decode("latin-1") for path in files)
    assert not [body for body in bodies if body in seen]


def test_what_a_container_may_do_on_its_node(site, kube):
    run = site.submitted(workers=1)
    frozen = held(kube, 1)
    name = kube.pods("worker")[0]["metadata"]["name"]
    tries = (
        ("id -u", "10001\n"),
        ("touch /x /usr/x /etc/x 2>/dev/null; ls /x /usr/x /etc/x 2>/dev/null", ""),
        ("cat /secret/* 2>/dev/null; stat -c '%a %u' /keys/*", "600 10001\n"),
        ("ls /var/run/secrets /work 2>/dev/null", ""),
        ("grep CapEff /proc/self/status", "CapEff:\t0000000000000000\n"),
    )
    for words, expected in tries:
        command = kube.run_in("robots", name, "worker", ["sh", "-c", words])
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.stdout == expected, (words, done.stderr)
    thaw(frozen)
    site.ended()
    assert run


def test_workers_come_and_go(site, kube, many_here, tmp_path):
    run = site.submitted(workers=1)
    api = batch(site)
    api.patch_namespaced_job(f"{run}-worker", "robots", {"spec": {"parallelism": 8}})
    frozen = held(kube, 8)
    assert "with 8 workers on n1, n2" in site.status()["nodes"]
    api.patch_namespaced_job(f"{run}-worker", "robots", {"spec": {"parallelism": 2}})
    wait_for(lambda: len(kube.pods("worker", "Running")) == 2, "six workers on their way out")
    thaw(frozen)
    for event in watch.Watch().stream(api.list_namespaced_job, "robots", timeout_seconds=200):
        job = event["object"]
        conditions = job.status.conditions or ()
        if job.metadata.name == f"{run}-conductor" and conditions:
            break
    assert site.ended()["exit_code"] == 0
    assert len(kube.pods("worker", "Succeeded")) == 2
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_evicted_pods_go_on_elsewhere(site, kube, many_here, tmp_path):
    run = site.submitted()
    frozen = held(kube, 2)
    first = kube.pods("conductor", "Running")[0]
    kube.nodes[first["spec"]["nodeName"]] = False
    done = site.hpc("requeue", str(site.out))
    thaw(frozen)
    assert done.returncode == 0, done.stderr
    kube_second = wait_for(lambda: kube.pods("conductor", "Running"), "another conductor")[0]
    assert kube_second["spec"]["nodeName"] != first["spec"]["nodeName"]
    said = site.ended()
    assert (said["exit_code"], said["restarts"]) == (0, 0), "a disruption is no failure"
    worker = batch(site).read_namespaced_job(f"{run}-worker", "robots")
    assert not worker.status.failed
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_a_lost_node_takes_conductor_and_worker(site, kube, many_here, tmp_path):
    site.submitted(workers=3)
    frozen = held(kube, 3)
    lost = wait_for(lambda: kube.pods("conductor", "Running"), "the conductor")[0]
    kube.lose(lost["spec"]["nodeName"])
    thaw(frozen)
    again = wait_for(lambda: kube.pods("conductor", "Running", "Succeeded"), "another conductor")
    assert again[0]["spec"]["nodeName"] != lost["spec"]["nodeName"]
    assert site.ended()["exit_code"] == 0
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_an_image_that_cannot_be_pulled(site, kube):
    run = site.submitted(image="registry.example/missing:1")
    wait_for(lambda: len(kube.pods("worker", "Pending")) == 2, "pods")
    said = site.status()
    assert said["state"] == "pending"
    assert said["reason"].startswith("ImagePullBackOff: Back-off pulling image; 2 workers: Image")
    assert site.hpc("cancel", str(site.out)).returncode == 0
    left = {key[0] for key in kube.store.objects if key[0] != "events"}
    wait_for(lambda: not kube.store.list("pods"), "the end of the pods")
    assert left - {"pods"} == {"persistentvolumeclaims"}, "results stay, keys do not"
    assert site.status()["state"] == "gone"
    assert run


def test_a_quota_holds_a_run_back_and_does_not_end_it(site, kube, many_here, tmp_path):
    kube.store.pods_max = 0
    site.submitted()
    wait_for(lambda: len(kube.store.list("events")) == 2, "refused pods")
    said = site.status()
    assert (said["state"], said["restarts"]) == ("pending", 0)
    assert "exceeded quota: compute" in said["reason"]
    kube.store.pods_max = None
    assert site.ended()["exit_code"] == 0
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_a_namespace_that_is_deleted(site, kube):
    site.submitted()
    wait_for(lambda: kube.pods("worker", "Running"), "a worker")
    kube.delete_namespace("robots")
    said = site.status()
    assert (said["state"], said["native"]) == ("gone", "namespace robots is not there")
    done = site.submit()
    assert (done.returncode, done.stdout) == (2, "")
    assert 'namespaces "robots" not found' in done.stderr
    done = site.hpc("pull", str(site.out), "home")
    assert done.returncode == 2
    assert "without its claim the results" in done.stderr
    wait_for(lambda: not kube.live(), "the end of the pods")


def test_a_cancelled_run_goes_on_with_what_it_had(site, kube, many_here, tmp_path):
    run = site.submitted()
    began = kube.claim(run) / "run" / "conductor.db"
    wait_for(began.exists, "a journal")
    frozen = held(kube, 2)
    done = site.submit()
    assert done.returncode == 2
    assert "works here; `hpc cancel" in done.stderr
    assert site.hpc("cancel", str(site.out)).returncode == 0
    thaw(frozen)
    wait_for(lambda: not kube.live(), "the end of the pods")
    inode = began.stat().st_ino
    assert site.submitted() == run
    assert site.ended()["exit_code"] == 0
    assert began.stat().st_ino == inode
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_a_queue_of_kueue_decides_when_it_starts(site, kube, many_here, tmp_path):
    run = site.submitted("--partition", "gpu-queue", workers=1)
    said = site.status()
    assert (said["native"], said["reason"]) == ("Suspended", "suspended, until its queue admits it")
    api = batch(site)
    for job in api.list_namespaced_job("robots").items:
        assert job.metadata.labels["kueue.x-k8s.io/queue-name"] == "gpu-queue"
        api.patch_namespaced_job(job.metadata.name, "robots", {"spec": {"suspend": False}})
    frozen = held(kube, 1)
    # Kueue takes back what somebody of more weight wants, and gives it again.
    api.patch_namespaced_job(f"{run}-worker", "robots", {"spec": {"suspend": True}})
    wait_for(lambda: not kube.pods("worker", "Running"), "the end of the worker's time")
    thaw(frozen)
    wait_for(lambda: not kube.pods("worker", "Running", "Pending"), "no worker")
    api.patch_namespaced_job(f"{run}-worker", "robots", {"spec": {"suspend": False}})
    assert site.ended()["exit_code"] == 0
    all_there(site.pulled(tmp_path / "home"), many_here)


def test_what_is_refused_is_one_line_and_leaves_nothing(site, kube, monkeypatch):
    def refused(code, *words, **values):
        done = site.submit(**values)
        assert (done.returncode, done.stdout) == (code, ""), done.stderr
        assert len(done.stderr.splitlines()) == 1, done.stderr
        for word in words:
            assert word in done.stderr
        assert not kube.store.objects
        assert not site.out.exists()

    site.kubeconfig(token="nobody")
    refused(2, "your credentials are not accepted; log in to the cluster again")
    site.kubeconfig(token="looker")
    refused(2, 'User "looker" cannot create resource', "ask who runs the namespace")
    site.kubeconfig(namespace="elsewhere")
    refused(2, 'namespaces "elsewhere" not found')
    site.kubeconfig()
    kube.api.in_trouble = True
    refused(3, "the API server is in trouble (etcdserver: leader changed)")
    kube.api.in_trouble = False
    kube.api.refuses = {"jobs"}
    refused(2, "exceeded quota: count/jobs.batch")
    kube.api.refuses = set()
    (site.folder / "kubeconfig").write_text("{}")
    refused(2, "no cluster: ", "set KUBECONFIG")
    site.kubeconfig()
    text = (site.folder / "kubeconfig").read_text()
    (site.folder / "kubeconfig").write_text(text.replace(kube.api.url, "http://127.0.0.1:9"))
    refused(3, "the API server does not answer")


def test_workers_of_a_conductor_that_ended_for_good(site, kube):
    """They wait, as for one that is slow to come; that they do is said."""
    run = site.submitted("--partition", "gpu-queue", workers=1)
    api = batch(site)
    core = client.CoreV1Api(api.api_client)
    core.patch_namespaced_config_map(f"{run}-campaign", "robots", {"data": {"campaign.yaml": "?"}})

    def begin(component):
        api.patch_namespaced_job(f"{run}-{component}", "robots", {"spec": {"suspend": False}})

    begin("conductor")
    wait_for(lambda: site.status()["state"] == "ended", "the end of the conductor")
    assert site.status()["reason"] == ""
    begin("worker")
    wait_for(lambda: kube.pods("worker", "Running"), "a worker")
    said = site.status()
    assert (said["native"], said["exit_code"]) == ("Failed", 2)
    assert said["reason"].startswith("1 worker still there; the same `hpc submit` goes on, `hpc")
    assert site.hpc("cancel", str(site.out)).returncode == 0
    wait_for(lambda: not kube.live(), "the end of the pods")


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), InfrastructureError("no answer")])
def test_a_submission_that_breaks_off_leaves_no_key(tmp_path, monkeypatch, ending):
    """Whatever cannot be deleted either is no reason to leave the rest, nor to say another."""
    api = Api(Store())

    def delete(plural, namespace, name):
        if plural == "services":
            raise RefusalError(403, "Forbidden", "services is forbidden")
        api.store.put(plural, api.store.read(plural, namespace, name), "DELETED")

    def create(self, found, **options):
        real(self, found, **options)
        if found["kind"] == "Job" and not options:
            raise ending  # no answer came, and yet it is there

    api.delete = delete
    real = Namespace.create
    monkeypatch.setattr(Namespace, "create", create)
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "own"))
    path = tmp_path / "kubeconfig"
    path.write_text(yaml.safe_dump(api.kubeconfig()))
    # The client has looked into the environment when it was imported.
    monkeypatch.setattr(config.kube_config, "KUBE_CONFIG_DEFAULT_LOCATION", str(path))
    request = JobRequest(
        campaign="aeb-demo",
        out=str(tmp_path / "run"),
        folder="/",
        workers=1,
        bin_folder="/opt/drivetwin/bin",
        walltime_min=30,
        directives=(f"--image={IMAGE}",),
    )
    served = threading.Thread(target=api.serve_forever)
    served.start()
    try:
        with pytest.raises(type(ending)) as caught:
            submit(request, Kubernetes(), 60.0)
    finally:
        api.shutdown()
        api.server_close()
        served.join()
    assert caught.value is ending
    assert {key[0] for key in api.store.objects} == {"services"}
    assert not (tmp_path / "run").exists()


def test_a_claim_of_somebody_else_is_left_alone(site, kube):
    run = site.submitted(workers=1)
    assert site.ended()["exit_code"] == 0
    (site.out / "job.id").unlink()
    before = {*kube.store.objects}
    done = site.submit()
    assert done.returncode == 2
    assert f"namespace robots has a claim {run} that no job of {site.out} made" in done.stderr
    assert {*kube.store.objects} == before


def test_what_somebody_puts_into_the_claim_is_not_believed(site, kube, tmp_path):
    """Whoever may run pods in the namespace may mount the claim."""
    run = site.submitted(workers=1)
    site.ended()
    folder = kube.claim(run) / "run"
    (folder / "job.id").write_text("kubernetes robots/another@elsewhere\n")
    (folder / "link").symlink_to("/etc/passwd")
    (folder / "out").symlink_to("../../..")
    os.mkfifo(folder / "pipe")
    (folder / "program").write_text("#!/bin/sh\n")
    (folder / "program").chmod(0o4777)
    target = site.pulled(tmp_path / "home")
    names = {path.name for path in target.iterdir()}
    assert not names & {"link", "out", "pipe", "job.id"}
    assert not (target / "program").stat().st_mode & (stat.S_ISUID | stat.S_IWOTH)


def test_another_pod_of_the_namespace(site, kube, marked, tmp_path):
    """Without a key of this fabric nobody gets in; a worker's key is that of a worker, no more."""
    run = site.submitted(workers=1)
    frozen = held(kube, 1)
    here = ("--connect", f"tls/127.0.0.1:{site.port}")
    own = fabric_folder(fabric_name(site.out))
    foreign = tmp_path / "foreign"
    assert marked.run("conductor", "keygen", str(foreign)).returncode == 0
    done = marked.run("twin", "worker", *here, "--key", str(foreign))
    assert done.returncode != 0
    assert "another fabric" in done.stderr
    done = marked.run("conductor", "stop", *here, "--key", str(own / "worker.key"))
    assert done.returncode == 2
    assert "a key of role worker may not ask conductor/rpc/admin" in done.stderr
    done = marked.run("conductor", "status", *here, "--key", str(own))
    assert done.returncode == 0, done.stderr
    thaw(frozen)
    site.ended()
    assert run


@pytest.mark.slow
def test_the_real_simulator_while_its_conductor_moves(marked, quiet, tmp_path, monkeypatch):
    """Files of results come through the fabric: nothing but the conductor sees the claim."""
    if kube_cluster.missing():
        pytest.skip(kube_cluster.missing())
    variables = {MARK: marked.mark, "WARP_CACHE_PATH": "/kernels"}
    with KubeCluster(variables=variables) as kube:
        kube.image_folders["/kernels"] = with_kernels(kube.folder / "kernels")
        monkeypatch.setenv("KUBECONFIG", str(tmp_path / "kubeconfig"))
        site = Site(marked, kube, tmp_path)
        run = site.submitted("--slots", "2", campaign="chaos-16")
        claim = kube.claim(run) / "run"
        wait_for(lambda: committed(claim) >= 2, "two results")
        first = kube.pods("conductor", "Running")[0]
        kube.nodes[first["spec"]["nodeName"]] = False
        kube.evict("robots", first["metadata"]["name"])
        said = site.ended()
        assert (said["native"], said["exit_code"]) == ("Failed", 1), "a verdict is not a pass"
        folder = site.pulled(tmp_path / "home")
        assert fingerprint(folder).sha256 == quiet["fingerprint"]
        assert committed(folder) >= 16
        shutil.rmtree(claim)
