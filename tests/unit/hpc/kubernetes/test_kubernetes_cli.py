"""What ``hpc`` says of Kubernetes without any cluster: one line, and nothing is written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import kubernetes
import pytest
import yaml
from waiting import PATIENCE_S

import hpc.kubernetes.api

ROOT = Path(__file__).resolve().parents[4]
IMAGE = "--directive=--image=registry.example/drivetwin:1"
JOB = ("aeb-demo", "--workers", "2", "--time", "00:30", "--scheduler", "kubernetes")


def run_hpc(folder, *words, **environment):
    own = {"DRIVETWIN_HOME": str(folder / "own"), "KUBECONFIG": str(folder / "kubeconfig")}
    return subprocess.run(
        [sys.executable, "-m", "hpc", *words],
        cwd=folder,
        env={**os.environ, **own, **environment},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def one_line(done, code, words):
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert words in done.stderr


def test_it_is_printed_where_no_cluster_is(tmp_path):
    done = run_hpc(tmp_path, "render", *JOB, IMAGE)
    assert (done.returncode, done.stderr) == (0, "")
    kinds = [found["kind"] for found in yaml.safe_load_all(done.stdout)]
    assert kinds[-2:] == ["Job", "Job"]
    assert [*tmp_path.iterdir()] == []


def test_a_base_is_written(tmp_path):
    done = run_hpc(tmp_path, "render", *JOB, IMAGE, "--into", "deep/base")
    assert (done.returncode, done.stderr) == (0, "")
    files = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.yaml"))
    assert files == ["deep/base/kustomization.yaml", "deep/base/objects.yaml"]
    assert done.stdout.splitlines() == ["deep/base/objects.yaml", "deep/base/kustomization.yaml"]


def test_a_chart_is_written(tmp_path):
    (tmp_path / "mine.yaml").write_text("campaign: mine\nmatrix: {repeat: [0]}\n")
    done = run_hpc(tmp_path, "render", "./mine.yaml", *JOB[1:], IMAGE, "--helm", "chart")
    assert (done.returncode, done.stderr) == (0, "")
    names = ("Chart.yaml", "values.yaml", "values.schema.json", "templates/objects.yaml")
    assert done.stdout.splitlines() == [f"chart/{name}" for name in (*names, "files/campaign.yaml")]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*JOB, IMAGE, "--array"), "--array: Kubernetes has a work queue"),
        ((*JOB, IMAGE, "--array", "--into", "x"), "--into x: --array takes one script"),
        ((*JOB[:-1], "slurm", "--into", "x"), "--into x: Slurm takes one script"),
        ((*JOB[:-1], "slurm", "--helm", "x"), "--helm x: Slurm is no Kubernetes"),
        ((*JOB, IMAGE, "--helm", "x", "--into", "y"), "--helm: writes a chart and nothing else"),
        (JOB, "--directive=--image=NAME is missing"),
        ((*JOB, IMAGE, "--record-nothing"), "No such option"),
    ],
)
def test_what_is_not_rendered(tmp_path, words, said):
    done = run_hpc(tmp_path, "render", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert [*tmp_path.iterdir()] == []


def test_campaigns_that_need_what_pods_do_not_have(tmp_path):
    campaign = tmp_path / "mine.yaml"
    words = ("render", "./mine.yaml", *JOB[1:], IMAGE)
    campaign.write_text("campaign: mine\nview: record\nmatrix: {repeat: [0]}\n")
    one_line(run_hpc(tmp_path, *words), 2, "workers here share no disk with the conductor")
    shutil.copy(ROOT / "twin/vehicle/models/opencav.yaml", tmp_path / "car.yaml")
    scenario = "scenario: {vehicle: ./car.yaml}"
    campaign.write_text(f"campaign: mine\n{scenario}\nmatrix: {{repeat: [0]}}\n")
    one_line(run_hpc(tmp_path, *words), 2, "car.yaml, which pods do not see")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("submit", *JOB, IMAGE), "no cluster: "),
        (("status", "robots/dt-x@somewhere"), "no cluster: "),
        (("cancel", "robots/dt-x@somewhere"), "no cluster: "),
        (("status", "7robots/dt-x@somewhere"), "no cluster: "),
        (("status", "runs/nothing"), "no run folder with a job.id"),
    ],
)
def test_no_cluster(tmp_path, words, said):
    one_line(run_hpc(tmp_path, *words), 2, said)
    assert not (tmp_path / "runs").exists()
    assert not (tmp_path / "own" / "keys").exists()


def test_a_context_that_is_gone(tmp_path):
    context = {"name": "here", "context": {"cluster": "c", "user": "u"}}
    config = {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "here",
        "clusters": [{"name": "c", "cluster": {"server": "http://127.0.0.1:9"}}],
        "users": [{"name": "u", "user": {"token": "t"}}],
        "contexts": [context],
    }
    (tmp_path / "kubeconfig").write_text(yaml.safe_dump(config))
    done = run_hpc(tmp_path, "status", "robots/dt-x@there")
    one_line(done, 2, "context there: not in your kubeconfig, which has here")
    context["name"] = config["current-context"] = "my cluster"
    (tmp_path / "kubeconfig").write_text(yaml.safe_dump(config))
    one_line(run_hpc(tmp_path, "submit", *JOB, IMAGE), 2, "a name with white space cannot be kept")


@pytest.mark.parametrize(("given", "expected"), [("", "robots"), ("others", "others")])
def test_a_pod_uses_the_namespace_it_is_in(tmp_path, monkeypatch, given, expected):
    """The client believes files of a place that only pods have."""
    own = tmp_path / "namespace"
    own.write_text("robots\n")
    monkeypatch.setattr(hpc.kubernetes.api, "OWN_NAMESPACE", own)
    monkeypatch.setattr(kubernetes.config, "load_incluster_config", lambda **_: None)
    monkeypatch.setenv("KUBERNETES_SERVICE_HOST", "10.0.0.1")
    assert hpc.kubernetes.api.Namespace(name=given).name == expected


@pytest.mark.parametrize("labels", [None, {}, {"app.kubernetes.io/instance": "dt-x"}])
def test_a_pod_whose_labels_somebody_took(labels):
    pod = kubernetes.client.V1Pod(metadata=kubernetes.client.V1ObjectMeta(labels=labels))
    assert hpc.kubernetes.api.component_of(pod) == ""


def test_without_the_client(tmp_path):
    hidden = tmp_path / "hidden" / "kubernetes"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").write_text("raise ImportError('hidden')\n")
    done = run_hpc(tmp_path, "status", "robots/dt-x@here", PYTHONPATH=str(hidden.parent))
    one_line(done, 2, "pip install 'drivetwin[kubernetes]'")
