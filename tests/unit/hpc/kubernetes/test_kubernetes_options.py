"""Options of a job on Kubernetes: every bad value is one line."""

from dataclasses import replace

import pytest

from hpc.kubernetes.options import LABELS_MAX, TOLERATIONS_MAX, Toleration, options_of
from hpc.request import JobRequest
from twin.base.errors import UsageError

IMAGE = "--image=registry.example/drivetwin:1"
REQUEST = JobRequest(
    campaign="aeb-demo",
    out="/home/me/runs/x",
    folder="/work",
    bin_folder="/opt/drivetwin/bin",
    walltime_min=60,
    workers=2,
    directives=(IMAGE,),
)


def given(*directives, **values):
    return replace(REQUEST, directives=(IMAGE, *directives), **values)


BAD = {
    "--image=": "expected an image",
    "--image=UPPER/x": "expected an image",
    "--image=-v": "expected an image",
    "--image=x y": "expected an image",
    f"--image={'x' * 600}": "expected an image",
    "--namespace=Robots": "expected a namespace",
    "--namespace=a.b": "expected a namespace",
    "--namespace=": "expected a namespace",
    "--memory=8": "expected a quantity",
    "--memory=8GB": "expected a quantity",
    "--memory=-8Gi": "expected a quantity",
    "--memory=0Gi": "expected a quantity",
    "--storage=lots": "expected a quantity",
    "--storage-class=A": "expected a name",
    "--priority-class=a_b": "expected a name",
    "--pull-secret=../x": "expected a name",
    "--gpu-resource=gpu": "expected an extended resource",
    "--spot=aws": "expected one of gke, eks, aks, karpenter",
    "--port=80": "expected a port, 1024 to 65535",
    "--port=99999": "expected a port",
    "--port=x": "expected a port",
    "--toleration=": "expected KEY, KEY=VALUE or KEY=VALUE:EFFECT",
    "--toleration=a=b:Never": "an effect of NoSchedule, PreferNoSchedule, NoExecute",
    "--toleration=a b": "expected KEY",
    "--store=": "pods reach no other store than s3://BUCKET/PREFIX or gs://BUCKET/PREFIX",
    "--store=/a/folder": "pods reach no other store",
    "--store=sftp://host/path": "pods reach no other store",
    "--store=s3://key:hidden@bucket": "credentials in a URL",
    "--store=s3://bucket?secret=hidden": "options in a URL",
    "--store=s3://": "names no bucket",
    "--store=s3://b": "expected s3://BUCKET/PREFIX",
    "--store=s3://bucket/../x": "expected s3://BUCKET/PREFIX",
    "--store=s3://bucket/a b": "expected s3://BUCKET/PREFIX",
    f"--store=s3://bucket/{'x' * 600}": "expected s3://BUCKET/PREFIX",
    "--store=s3://bucket/runs": "also give --store-secret=NAME",
    "--store-secret=bucket": "belongs to --store=URL",
    "--store-secret=A_b": "expected a name",
    "--store-endpoint=minio:9000": "expected http://HOST:PORT or https://HOST:PORT",
    "--store-endpoint=https://key:hidden@minio": "credentials belong into the Secret",
    "--store-endpoint=https://minio/path": "expected http://HOST:PORT",
    "--store-endpoint=https://minio:99999": "expected http://HOST:PORT",
    "--store-endpoint=https://mi nio": "expected http://HOST:PORT",
    "--store-endpoint=ftp://minio:21": "expected http://HOST:PORT",
    "--store-endpoint=http://minio:0": "expected http://HOST:PORT",
    "--store-endpoint=https://[::1": "expected http://HOST:PORT",
    "--store-endpoint=https://minio": "belongs to --store=URL",
    "--store-network=10.1.0.1/16": "expected the network of the store's addresses",
    "--store-network=minio": "expected the network",
    "--durable=disk": "expected one of local, store",
    "--durable=store": "belongs to --store=URL",
    "--qos=long": "allowed are --durable=, --gpu-resource=, --image=, --memory=",
    "--image": "allowed are",
    "-l x": "allowed are",
}


@pytest.mark.parametrize(("directive", "said"), BAD.items())
def test_a_bad_directive(directive, said):
    with pytest.raises(UsageError) as caught:
        options_of(given(directive))
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert "hidden" not in str(caught.value)
    assert len(str(caught.value)) < 400 or "allowed are" in str(caught.value)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"container": "/images/x.sif"}, "--container: give --directive=--image=NAME"),
        ({"account": "proj"}, "--account: Kubernetes knows none"),
        ({"modules": ("cuda",)}, "modules (site file)"),
        ({"scratch": "$TMPDIR"}, "--scratch: pods have their own /tmp"),
        ({"interface": "ib0"}, "--interface: pods meet at a Service"),
        ({"address": "10.1.2.3"}, "--address: pods meet at a Service"),
        ({"nodes": 2}, "--nodes: the cluster places pods"),
        ({"remote_stacks": True}, "autonomy.placement: node"),
        (
            {"records": True},
            "recordings (view: record): workers here share no disk with the conduct",
        ),
        ({"records": True}, "give --directive=--store=URL, or take them out of the campaign"),
        ({"records": True, "drive_records": True}, "recording.drive: workers here share no disk"),
        ({"own_files": ("nets/mine.onnx",)}, "names nets/mine.onnx, which pods do not see"),
        ({"own_paths": ("/home/me/stack",)}, "/home/me/stack: a path of this machine"),
        ({"history": "/home/me/runs/old"}, "--history: pods see no run of this machine"),
        ({"container_binds": ("/data",)}, "--container-bind: pods see no folder"),
        ({"container_runtime": "podman"}, "--container-runtime: nodes have their own"),
        ({"partition": "Gpu_Queue"}, "--partition 'Gpu_Queue': expected a local queue of Kueue"),
        ({"constraint": "a100"}, "--constraint 'a100': expected labels of nodes"),
        ({"constraint": "a=b,c"}, "expected labels of nodes"),
        ({"constraint": "a=b!"}, "expected labels of nodes"),
    ],
)
def test_what_pods_have_no_use_for(values, said):
    with pytest.raises(UsageError) as caught:
        options_of(given(**values))
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("directives", "values", "said"),
    [
        (("--storage-class=fast",), {}, "--storage-class: with --store there is no claim"),
        (("--store=gs://bucket", "--store-endpoint=http://x"), {}, "is for s3:// alone"),
        ((), {"join": "/o/worker.key", "connect": "tls/a:1"}, "these workers is elsewhere"),
    ],
)
def test_what_does_not_go_with_a_store(directives, values, said):
    store = ("--store=s3://bucket/runs", "--store-secret=bucket")
    with pytest.raises(UsageError) as caught:
        options_of(given(*store, *directives, **values))
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_paths_that_an_image_may_have():
    paths = ("/opt/mine/stack", "/usr/bin/python3", "/bin/sh")
    assert options_of(given(own_paths=paths)).image
    with pytest.raises(UsageError, match="/optional/stack: a path"):
        options_of(given(own_paths=(*paths, "/optional/stack")))


def test_an_image_is_needed():
    with pytest.raises(UsageError, match=r"--image=NAME is missing"):
        options_of(replace(REQUEST, directives=()))


def test_the_last_one_wins():
    found = options_of(given("--memory=4Gi", "--memory=6Gi", "--image=other:2"))
    assert (found.memory, found.image) == ("6Gi", "other:2")


def test_tolerations_add_up_to_a_limit():
    many = [f"--toleration=key{n}=on:NoSchedule" for n in range(TOLERATIONS_MAX)]
    found = options_of(given(*many))
    assert found.tolerations[-1] == Toleration(f"key{TOLERATIONS_MAX - 1}", "on", "NoSchedule")
    with pytest.raises(UsageError, match=f"at most {TOLERATIONS_MAX}"):
        options_of(given(*many, "--toleration=one-more"))


def test_labels_have_a_limit():
    many = ",".join(f"l{n}=" for n in range(LABELS_MAX))
    assert len(options_of(given(constraint=many)).labels) == LABELS_MAX
    with pytest.raises(UsageError, match=f"at most {LABELS_MAX}"):
        options_of(given(constraint=f"{many},x=y"))


@pytest.mark.parametrize(
    "image",
    ["drivetwin", "host:5000/a/b:v1.2", f"reg.example/x@sha256:{'0' * 64}", "a/b_c-d.e:X_1"],
)
def test_images(image):
    assert options_of(replace(REQUEST, directives=(f"--image={image}",))).image == image


@pytest.mark.parametrize(
    ("directives", "store", "said"),
    [
        ((), "s3://bucket/runs", "also give --store-secret=NAME"),
        (("--store-secret=bucket",), "", "belongs to --store=URL"),
        (("--store-secret=bucket",), "sftp://host/runs", "pods reach no other store than"),
        (
            ("--store-secret=bucket", "--durable=store"),
            "s3://bucket/runs",
            "--durable: the conduct",
        ),
    ],
)
def test_workers_of_a_conductor_elsewhere_that_has_a_store(directives, store, said):
    joining = {"join": "/o/worker.key", "connect": "tls/a:1", "store": store}
    with pytest.raises(UsageError) as caught:
        options_of(given(*directives, **joining))
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_their_store_is_that_of_the_conductor():
    joining = {"join": "/o/worker.key", "connect": "tls/a:1", "store": "s3://bucket/runs/x"}
    found = options_of(given("--store-secret=bucket", **joining))
    assert (found.store, found.store_secret) == ("s3://bucket/runs/x", "bucket")
