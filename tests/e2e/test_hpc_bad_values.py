"""A bad value of every option of jobs on Kubernetes and at several sites: one line, exit code 2."""

import dataclasses
import inspect
import re

import pytest
from checked_once import CAMPAIGN
from many_commands import run_many

from hpc.kubernetes.options import _CHECKS
from hpc.options import Options
from hpc.sites.cli import scale

IMAGE = "--directive=--image=a:1"
SITES = """\
sites:
  north: {scheduler: slurm, bin: /opt/bin}
  pool: {scheduler: kubernetes, directives: [--image=a:1]}
"""
KUBERNETES = {
    "time": (["--time", "1h"], "--time '1h': expected HH:MM"),
    "scheduler": (["--scheduler", "lsf"], "'lsf' is not one of"),
    "gpus": (["--gpus", "5000"], "--gpus 5000: allowed are 0 to 4096"),
    "workers": (["--workers", "-1"], "--workers -1: allowed are 0 to 4096"),
    "nodes": (["--nodes", "1"], "--nodes: the cluster places pods"),
    "partition": (["--partition", "Gpu"], "--partition 'Gpu': expected a local queue of Kueue"),
    "account": (["--account", "proj"], "--account: Kubernetes knows none"),
    "constraint": (["--constraint", "a100"], "--constraint 'a100': expected labels of nodes"),
    "out": (["--out", "a\nb"], "a name with a line break"),
    "slots": (["--slots", "0"], "--slots 0: allowed are 1 to 4096"),
    "cpus_per_worker": (["--cpus-per-worker", "0"], "--cpus-per-worker 0: allowed are 1 to 1024"),
    "signal_lead": (["--signal-lead", "5"], "--signal-lead 5 s: allowed are 30 to 3600 s"),
    "restarts_max": (["--restarts-max", "-1"], "--restarts-max -1: allowed are 0 to 1000"),
    "address": (["--address", "10.1.2.3"], "--address: pods meet at a Service"),
    "interface": (["--interface", "ib0"], "--interface: pods meet at a Service"),
    "scratch": (["--scratch", "/tmp"], "--scratch: pods have their own /tmp"),
    "directive": (["--directive=--qos=long"], "directive '--qos=long': allowed are"),
    "bin_folder": (["--bin", "/home/me/bin"], "/home/me/bin: a path of this machine"),
    "container": (["--container", "/x.sif"], "--container: give --directive=--image=NAME"),
    "container_runtime": (["--container-runtime", "podman"], "--container-runtime: nodes have"),
    "container_bind": (["--container-bind", "/data"], "--container-bind: pods see no folder"),
    "history": (["--history", "/nowhere"], "--history /nowhere: no outcomes.json there"),
    "site": (["--site", "/nowhere/site.yaml"], "/nowhere/site.yaml"),
}
"""By the name of an option: words, and what is said of them."""
DIRECTIVES = {
    "image": "UPPER",
    "namespace": "a.b",
    "memory": "8GB",
    "storage": "0Gi",
    "storage-class": "A",
    "priority-class": "a_b",
    "pull-secret": "../x",
    "gpu-resource": "gpu",
    "spot": "aws",
    "port": "80",
    "store": "ftp://x",
    "store-secret": "A",
    "store-endpoint": "minio",
    "store-network": "10.1",
    "durable": "disk",
}
AT_SITES = {
    **{name: (words, "differs from site to site") for name, (words, _) in KUBERNETES.items()},
    "time": KUBERNETES["time"],
    "scheduler": (["--scheduler", "slurm"], "--scheduler: differs from site to site"),
    "gpus": KUBERNETES["gpus"],
    "workers": KUBERNETES["workers"],
    "slots": KUBERNETES["slots"],
    "out": KUBERNETES["out"],
    "history": KUBERNETES["history"],
    "restarts_max": (["--restarts-max", "3"], "--restarts-max: differs from site to site"),
}
SCALE = {
    "run": (["a\nb"], "a name with a line break"),
    "target": (["--target", "5:1"], "--target '5:1': expected MIN:MAX"),
    "on": (["--on", "lsf:north"], "--on lsf:north: expected KIND:SITE"),
    "sites": (["--sites", "/nowhere"], "/nowhere: No such file"),
    "key": (["--key", "/nowhere/key"], "no such key"),
    "time": (["--time", "1h"], "site north: --time '1h': expected HH:MM"),
    "workers": (["--workers", "5000"], "site north: --workers 5000: allowed are 0 to 4096"),
    "gpus": (["--workers", "0", "--gpus", "-1"], "site north: --gpus -1: allowed are"),
    "slots": (["--slots", "0"], "site north: --slots 0: allowed are 1 to 4096"),
    "worker_hours": (["--worker-hours", "-1"], "'--worker-hours'"),
    "worthwhile_s": (["--worthwhile-s", "0"], "'--worthwhile-s'"),
    "period_s": (["--period-s", "nan"], "'--period-s'"),
}
SWITCHES = {"once", "dry_run"}
"""Options of ``hpc scale`` without a value."""


def the_line(done):
    """What a user is told; click shows its usage above."""
    assert (done.returncode, done.stdout) == (2, ""), (done.args, done.stderr)
    lines = done.stderr.splitlines()
    if lines[0].startswith("Usage:"):
        lines = lines[3:]
    assert len(lines) == 1, (done.args, done.stderr)
    return lines[0]


def all_said(commands, expected, folder):
    """Each command says its line, and none leaves anything behind."""
    before = {*folder.rglob("*")}
    done = run_many("hpc", commands, ["tests.e2e.checked_once"])
    for each, said in zip(done, expected, strict=True):
        assert re.search(re.escape(said), the_line(each)), (each.args, each.stderr)
    assert {*folder.rglob("*")} == before


@pytest.fixture
def sites(tmp_path):
    path = tmp_path / "sites.yaml"
    path.write_text(SITES)
    path.chmod(0o600)
    return path


@pytest.mark.parametrize("verb", ["render", "submit"])
def test_jobs_on_kubernetes(verb, tmp_path):
    assert {*KUBERNETES} == {field.name for field in dataclasses.fields(Options)}
    assert {*DIRECTIVES} == {*_CHECKS}
    common = [verb, CAMPAIGN, "--scheduler", "kubernetes", "--time", "00:30", IMAGE]
    common += ["--out", str(tmp_path / "run")]
    commands, expected = [], []
    for name, (words, said) in KUBERNETES.items():
        workers = [] if name in ("gpus", "workers") else ["--workers", "2"]
        commands.append([*common, *workers, *words])
        expected.append(said)
    for name, value in DIRECTIVES.items():
        commands.append([*common, "--workers", "2", f"--directive=--{name}={value}"])
        expected.append(f"--{name}")
    commands.append([verb, "no-such-campaign", *common[2:], "--workers", "2"])
    expected.append("no-such-campaign")
    all_said(commands, expected, tmp_path)


def test_submission_at_several_sites(sites):
    assert {*AT_SITES} == {field.name for field in dataclasses.fields(Options)}
    common = ["submit", CAMPAIGN, "--on", "slurm:north", "--sites", str(sites)]
    common += ["--time", "00:30", "--out", str(sites.parent / "run")]
    commands, expected = [], []
    for name, (words, said) in AT_SITES.items():
        workers = [] if name in ("gpus", "workers") else ["--workers", "2"]
        commands.append([*common, *workers, *words])
        expected.append(said)
    all_said(commands, expected, sites.parent)


def test_scaling(sites):
    assert {*SCALE} == {*inspect.signature(scale).parameters} - SWITCHES
    common = ["--target", "0:2", "--on", "slurm:north", "--sites", str(sites), "--workers", "2"]
    common += ["--time", "00:30"]
    commands, expected = [], []
    for name, (words, said) in SCALE.items():
        run = [] if name == "run" else [str(sites.parent)]
        commands.append(["scale", *run, *common, *words])
        expected.append(said)
    all_said(commands, expected, sites.parent)
