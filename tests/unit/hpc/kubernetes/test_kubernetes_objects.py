"""Objects of a run. Goldens are written anew by ``UPDATE_GOLDEN=1 pytest`` on this file."""

import os
import subprocess
from dataclasses import replace
from pathlib import Path

import kubernetes_validate
import pytest
import yaml
from kube_policy import violations

from hpc.kubernetes.commands import Kubernetes
from hpc.kubernetes.objects import (
    CAMPAIGN_BYTES_MAX,
    objects_of,
    reader_of,
    run_name,
    secrets_of,
)
from hpc.kubernetes.options import SPOT, options_of
from hpc.request import JobRequest
from twin.base.errors import UsageError

GOLDEN = Path(__file__).parent
VERSIONS = [f"1.{minor}" for minor in range(25, 38)]
PLACE = {"folder": "/work", "bin_folder": "/opt/drivetwin/bin", "walltime_min": 60}
IMAGE = "--image=registry.example/drivetwin:1"
REQUESTS = {
    "two_cpu_workers": JobRequest(
        campaign="aeb-demo", out="/home/me/runs/aeb-demo", workers=2, directives=(IMAGE,), **PLACE
    ),
    "gpus_with_everything": JobRequest(
        campaign="/home/me/night campaign.yaml",
        out="/home/me/runs/it's night",
        gpus=8,
        partition="gpu-queue",
        constraint="nvidia.com/gpu.product=A100,zone=b",
        slots=64,
        cpus_per_worker=8,
        signal_lead_s=120,
        restarts_max=3,
        directives=(
            *(IMAGE, "--namespace=robots", "--memory=32Gi", "--storage=1Ti"),
            *("--storage-class=fast.ssd", "--priority-class=low", "--pull-secret=registry"),
            *("--gpu-resource=nvidia.com/mig-1g.10gb", "--spot=aks", "--port=7500"),
            *("--toleration=nvidia.com/gpu", "--toleration=team=robots:NoExecute"),
        ),
        **PLACE,
    ),
    "with_a_store": JobRequest(
        campaign="aeb-demo",
        out="/home/me/runs/aeb-demo",
        workers=2,
        directives=(
            *(IMAGE, "--store=s3://results/runs/", "--store-secret=bucket", "--durable=store"),
            *("--store-endpoint=http://minio.robots:9000", "--store-network=10.9.0.0/16"),
        ),
        **PLACE,
    ),
    "joining": JobRequest(
        campaign="aeb-demo",
        out="/home/me/runs/aeb-demo/sites/pool-3",
        gpus=4,
        directives=(IMAGE, "--namespace=robots"),
        join="/home/me/runs/aeb-demo/sites/pool-3/worker.key",
        connect="tls/10.1.2.3:7447",
        site="pool",
        allocation="pool-3",
        **PLACE,
    ),
    "joining_by_name": JobRequest(
        campaign="aeb-demo",
        out="/home/me/runs/aeb-demo/sites/pool-4",
        workers=1,
        directives=(IMAGE,),
        join="/home/me/runs/aeb-demo/sites/pool-4/worker.key",
        connect="tls/login.example:7447",
        site="pool",
        allocation="pool-4",
        **PLACE,
    ),
    "joining_with_a_store": JobRequest(
        campaign="aeb-demo",
        out="/home/me/runs/aeb-demo/sites/pool-5",
        workers=1,
        directives=(IMAGE, "--store-secret=bucket", "--store-network=10.9.0.0/16"),
        join="/home/me/runs/aeb-demo/sites/pool-5/worker.key",
        connect="tls/10.1.2.3:7447",
        store="s3://results/night/aeb-demo-0a1b2c3d",
        site="pool",
        allocation="pool-5",
        **PLACE,
    ),
}
CAMPAIGN = {"gpus_with_everything": "campaign: night\nmatrix: {repeat: [0, 1]}\n"}


def objects(name):
    request = REQUESTS[name]
    return objects_of(request, options_of(request), CAMPAIGN.get(name, ""))


def everything():
    """All objects that any of the requests makes, with keys and the reader of a claim."""
    found = [each for name in REQUESTS for each in objects(name)]
    found += secrets_of("dt-x", "robots", {"conductor": "eA==", "worker": "eQ=="})
    return [*found, reader_of("dt-x", "registry.example/drivetwin:1", "registry", 60)]


def pod_specs():
    specs = {}
    for found in everything():
        if found["kind"] == "Job":
            specs[found["metadata"]["name"]] = found["spec"]["template"]["spec"]
        elif found["kind"] == "Pod":
            specs["reader"] = found["spec"]
    return specs


@pytest.mark.parametrize("name", REQUESTS)
def test_golden(name, tmp_path):
    request = REQUESTS[name]
    if name in CAMPAIGN:
        path = tmp_path / "night campaign.yaml"
        path.write_text(CAMPAIGN[name])
        request = replace(request, campaign=str(path))
    text = Kubernetes().render(request)
    golden = GOLDEN / f"{name}.yaml"
    if os.environ.get("UPDATE_GOLDEN"):
        golden.write_text(text)
    assert text == golden.read_text()
    assert [*yaml.safe_load_all(text)] == objects(name)


@pytest.mark.parametrize("version", VERSIONS)
def test_strict_schemas(version):
    for found in everything():
        assert kubernetes_validate.validate(found, version, strict=True) == version


def test_schemas_notice_a_field_that_is_none():
    found = objects("two_cpu_workers")[-1]
    found["spec"]["template"]["spec"]["hostNetwrok"] = False
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(found, VERSIONS[-1], strict=True)


def test_policy():
    specs = pod_specs()
    assert len(specs) == 8
    assert {name: violations(spec) for name, spec in specs.items() if violations(spec)} == {}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pod: pod["securityContext"].pop("runAsNonRoot"), "may be root"),
        (lambda pod: pod["securityContext"].update(runAsUser=0), "is root"),
        (lambda pod: pod["securityContext"].pop("seccompProfile"), "no seccomp profile"),
        (lambda pod: pod.pop("automountServiceAccountToken"), "a token of the API"),
        (lambda pod: pod.pop("activeDeadlineSeconds"), "for ever"),
        (lambda pod: pod.update(hostNetwork=True), "the host's"),
        (lambda pod: _first(pod).pop("securityContext"), "writes its root"),
        (lambda pod: _first(pod)["resources"].pop("limits"), "no limits"),
        (lambda pod: _first(pod).update(env=[{"name": "K", "valueFrom": {}}]), "hold a secret"),
        (lambda pod: pod["volumes"].append({"name": "h", "hostPath": {}}), "not allowed"),
    ],
)
def test_the_policy_notices(change, said):
    pod = objects("two_cpu_workers")[-1]["spec"]["template"]["spec"]
    pod = yaml.safe_load(yaml.safe_dump(pod))
    change(pod)
    assert said in " ".join(violations(pod))


def _first(pod):
    return pod["containers"][0]


def test_a_key_reaches_its_own_component_and_no_other():
    for name, spec in pod_specs().items():
        mounted = [v["secret"]["secretName"] for v in spec["volumes"] if "secret" in v]
        own = [each for each in mounted if each != "bucket"]
        assert own == ([] if name == "reader" else [name])
    kinds = {found["kind"] for name in REQUESTS for found in objects(name)}
    assert "Secret" not in kinds, "what is printed holds no key"


def test_the_network_lets_workers_talk_to_their_conductor_alone():
    policies = {
        found["metadata"]["name"].rpartition("-")[2]: found["spec"]
        for found in objects("two_cpu_workers")
        if found["kind"] == "NetworkPolicy"
    }
    for spec in policies.values():
        assert spec["policyTypes"] == ["Ingress", "Egress"]
    assert policies["worker"]["ingress"] == policies["conductor"]["egress"] == []
    run = run_name(REQUESTS["two_cpu_workers"])
    (entrance,) = policies["conductor"]["ingress"]
    (who,) = entrance["from"]
    assert who["podSelector"]["matchLabels"] == {
        "app.kubernetes.io/instance": run,
        "app.kubernetes.io/component": "worker",
    }
    ports = [port["port"] for way in policies["worker"]["egress"] for port in way["ports"]]
    assert ports == [7447, 53, 53]


def test_a_store_takes_the_place_of_the_claim():
    found = objects("with_a_store")
    run = run_name(REQUESTS["with_a_store"])
    assert "PersistentVolumeClaim" not in [each["kind"] for each in found]
    conductor, worker = (each["spec"]["template"]["spec"] for each in found[-2:])
    assert found[-2]["metadata"]["annotations"] == {"drivetwin/store": f"s3://results/runs/{run}"}
    command = conductor["containers"][0]["command"]
    assert command[-4:] == ["--store", f"s3://results/runs/{run}", "--durable", "store"]
    disks = {volume["name"]: volume for volume in conductor["volumes"]}
    assert disks["work"] == {"name": "work", "emptyDir": {"sizeLimit": "10Gi"}}
    limits = conductor["containers"][0]["resources"]["limits"]
    assert limits["ephemeral-storage"] == f"{20 << 10}Mi", "of /tmp and of the run folder"
    for pod in (conductor, worker):
        (container,) = pod["containers"]
        variables = {each["name"]: each["value"] for each in container["env"]}
        assert variables["AWS_SHARED_CREDENTIALS_FILE"] == "/store/credentials"
        assert variables["AWS_ENDPOINT_URL"] == "http://minio.robots:9000"
        mounts = {mount["name"]: mount for mount in container["volumeMounts"]}
        assert mounts["store"]["readOnly"]
        assert pod["volumes"][-1]["secret"]["secretName"] == "bucket"
    # The way to the store and to the name service, and for workers to the conductor: no other.
    policies = [each["spec"]["egress"] for each in found if each["kind"] == "NetworkPolicy"]
    ports = [[port["port"] for way in ways for port in way["ports"]] for ways in policies]
    assert ports == [[9000, 53, 53], [7447, 9000, 53, 53]]
    assert policies[0][0]["to"] == [{"ipBlock": {"cidr": "10.9.0.0/16"}}]


@pytest.mark.parametrize(
    ("endpoint", "port"),
    [("", 443), ("https://a.b", 443), ("http://a.b/", 80), ("https://a.b:9443", 9443)],
)
def test_the_port_of_a_store(endpoint, port):
    given = [word for word in REQUESTS["with_a_store"].directives if "endpoint" not in word]
    given += [f"--store-endpoint={endpoint}"] if endpoint else []
    request = replace(REQUESTS["with_a_store"], directives=tuple(given))
    policies = [o for o in objects_of(request, options_of(request)) if o["kind"] == "NetworkPolicy"]
    assert policies[0]["spec"]["egress"][0]["ports"] == [{"protocol": "TCP", "port": port}]


def test_a_worker_leaves_before_it_is_killed():
    worker = objects("gpus_with_everything")[-1]["spec"]["template"]["spec"]
    command = worker["containers"][0]["command"]
    drain_s = int(command[command.index("--drain-s") + 1])
    walltime_s = int(worker["containers"][0]["env"][-1]["value"])
    assert drain_s + 30 == worker["terminationGracePeriodSeconds"] == 120
    assert walltime_s + 120 == worker["activeDeadlineSeconds"] == 3600


@pytest.mark.parametrize("provider", SPOT)
def test_spot_nodes_are_for_workers(provider):
    request = replace(REQUESTS["two_cpu_workers"], directives=(IMAGE, f"--spot={provider}"))
    conductor, worker = objects_of(request, options_of(request))[-2:]
    key, value = SPOT[provider].label
    assert worker["spec"]["template"]["spec"]["nodeSelector"] == {key: value}
    assert "nodeSelector" not in conductor["spec"]["template"]["spec"]


def test_names_of_runs():
    first = REQUESTS["two_cpu_workers"]
    assert run_name(first) == run_name(replace(first, workers=3)), "more workers, the same run"
    assert run_name(first) != run_name(replace(first, out="/home/you/runs/aeb-demo"))
    for campaign in ("x" * 200, "...", "Ünïcode_.yaml", "/a/B.C.yaml", "1-2"):
        name = run_name(replace(first, campaign=campaign))
        assert len(f"{name}-conductor") <= 63
        assert name[0].isalpha()
        assert name == name.lower()


def test_a_campaign_that_no_config_map_holds():
    request = replace(REQUESTS["gpus_with_everything"])
    with pytest.raises(UsageError, match=f"at most {CAMPAIGN_BYTES_MAX}"):
        objects_of(request, options_of(request), "#" * (CAMPAIGN_BYTES_MAX + 1))


def test_a_kustomize_base(tmp_path):
    files = Kubernetes().files(REQUESTS["two_cpu_workers"])
    assert [*files] == ["objects.yaml", "kustomization.yaml"]
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    content = yaml.safe_load(files["kustomization.yaml"])
    assert content["resources"] == ["objects.yaml"]
    (tmp_path / "keys").mkdir()
    for role in ("conductor", "worker"):
        (tmp_path / "keys" / f"{role}.key").write_text(role)
    try:
        done = subprocess.run(
            ["kubectl", "kustomize", str(tmp_path)], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        pytest.skip("no kubectl here")
    assert done.returncode == 0, done.stderr
    built = {
        (found["kind"], found["metadata"]["name"]) for found in yaml.safe_load_all(done.stdout)
    }
    given = {(found["kind"], found["metadata"]["name"]) for found in objects("two_cpu_workers")}
    run = run_name(REQUESTS["two_cpu_workers"])
    assert built - given == {("Secret", f"{run}-conductor"), ("Secret", f"{run}-worker")}
    assert given <= built
