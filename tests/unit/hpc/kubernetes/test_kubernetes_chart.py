"""Charts of Helm: with the written values they are the objects that are printed otherwise.

Templates are filled here without Helm, since each value is one known expression; where ``helm`` is
installed, it fills them too.
"""

import copy
import json
import re
import shutil
import subprocess

import jsonschema
import kubernetes_validate
import pytest
import yaml
from kube_policy import violations
from test_kubernetes_objects import CAMPAIGN, REQUESTS, VERSIONS, objects

from hpc.kubernetes.chart import CAMPAIGN_FILE, EXPRESSIONS, chart_of
from hpc.kubernetes.objects import run_name
from hpc.kubernetes.options import options_of
from twin.base.errors import UsageError

NAMES = [name for name, request in REQUESTS.items() if not request.join]
CHANGED = {
    "image": "other:2",
    "workers": 7,
    "cpus": 3,
    "memory": "9Gi",
    "storage": "7Gi",
    "queue": "night",
    "gpuResource": "amd.com/gpu",
    "tolerations": [{"key": "a", "operator": "Exists"}],
    "nodeSelector": {"zone": "c"},
    "store": {"url": "s3://elsewhere/x/", "secret": "other"},
}


def chart(name):
    request = REQUESTS[name]
    return chart_of(request, options_of(request), CAMPAIGN.get(name, ""))


def filled(files, values, run):
    """Objects of a chart, filled without Helm."""
    store = values.get("store", {})
    known = {
        "image": json.dumps(values["image"]),
        "workers": str(values["workers"]),
        "failures": str(2 * values["workers"]),
        "suspend": str(values["queue"] != "").lower(),
        "queue": json.dumps(values["queue"]),
        "cpus": json.dumps(str(values["cpus"])),
        "memory": json.dumps(values["memory"]),
        "gpu": json.dumps(values.get("gpuResource")),
        "storage": json.dumps(values.get("storage")),
        "tolerations": json.dumps(values["tolerations"]),
        "nodeSelector": json.dumps(values["nodeSelector"]),
        "store": json.dumps(f"{store.get('url', '').removesuffix('/')}/{run}"),
        "storeSecret": json.dumps(store.get("secret")),
        "campaign": json.dumps(files.get(CAMPAIGN_FILE)),
    }
    assert {*known} == {*EXPRESSIONS}
    text = files["templates/objects.yaml"]
    kept = r"\1" if values["queue"] else ""
    text = re.sub(r"{{- if \.Values\.queue }}\n(.*\n){{- end }}\n", kept, text)
    for name, value in known.items():
        text = text.replace(EXPRESSIONS[name].replace('"RUN"', json.dumps(run)), value)
    assert "{{" not in text
    assert "@@" not in text
    return [*yaml.safe_load_all(text)]


def plain(found):
    """Objects without what means the same as nothing."""
    for each in found:
        if each["kind"] == "Job":
            pod = each["spec"]["template"]["spec"]
            for where, name in ((each["spec"], "suspend"), (pod, "tolerations")):
                if not where.get(name):
                    where.pop(name, None)
            if not pod.get("nodeSelector"):
                pod.pop("nodeSelector", None)
    return found


def values_of(files):
    return yaml.safe_load(files["values.yaml"])


@pytest.mark.parametrize("name", NAMES)
def test_the_written_values_make_the_printed_objects(name):
    files = chart(name)
    run = run_name(REQUESTS[name])
    assert plain(filled(files, values_of(files), run)) == plain(copy.deepcopy(objects(name)))
    assert yaml.safe_load(files["Chart.yaml"])["name"] == run


@pytest.mark.parametrize("name", NAMES)
def test_changed_values_are_everywhere(name):
    files = chart(name)
    values = values_of(files)
    new = {key: CHANGED[key] for key in values}
    found = filled(files, new, run_name(REQUESTS[name]))
    text = yaml.safe_dump_all(found)
    for old in (values["image"], *values.get("store", {}).values()):
        assert f" {old}" not in text
    conductor, worker = (each for each in found if each["kind"] == "Job")
    assert (worker["spec"]["parallelism"], worker["spec"]["backoffLimit"]) == (7, 14)
    pod = worker["spec"]["template"]["spec"]
    assert (pod["tolerations"], pod["nodeSelector"]) == (new["tolerations"], new["nodeSelector"])
    for job in (conductor, worker):
        assert job["spec"]["suspend"] is True
        assert job["metadata"]["labels"]["kueue.x-k8s.io/queue-name"] == "night"
        assert violations(job["spec"]["template"]["spec"]) == []
    if "gpuResource" in new:
        assert pod["containers"][0]["resources"]["limits"]["amd.com/gpu"] == "1"
    for each in found:
        for version in (VERSIONS[0], VERSIONS[-1]):
            assert kubernetes_validate.validate(each, version, strict=True) == version


@pytest.mark.parametrize(
    ("key", "bad"),
    [
        *(("image", "UP"), ("image", "a b"), ("workers", 0), ("workers", "2"), ("workers", 4097)),
        *(("cpus", 0), ("memory", "8GB"), ("queue", "Gpu"), ("queue", None), ("tolerations", {})),
        *(("nodeSelector", {"a": 1}), ("store", {"url": "s3://a"}), ("unknown", 1)),
        *(("store", {"url": "ftp://a", "secret": "b"}), ("store", {"url": "s3://a", "secret": ""})),
    ],
)
def test_bad_values_are_refused_by_the_schema(key, bad):
    files = chart("with_a_store")
    schema = json.loads(files["values.schema.json"])
    values = values_of(files)
    jsonschema.validate(values | {"global": {}}, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(values | {key: bad}, schema)


def test_a_campaign_file_is_no_template():
    request = REQUESTS["gpus_with_everything"]
    text = "campaign: night\n# {{ .Values.image }} @@image@@\n"
    files = chart_of(request, options_of(request), text)
    assert files[CAMPAIGN_FILE] == text
    assert ".Values.image }} @@" not in files["templates/objects.yaml"]


def test_keys_and_joining_workers_have_no_chart():
    assert "Secret" not in [each["kind"] for each in objects("with_a_store")]
    with pytest.raises(UsageError, match="have no chart"):
        chart("joining")


@pytest.mark.parametrize("name", NAMES)
def test_helm_fills_it_alike(name, tmp_path):
    if shutil.which("helm") is None:
        pytest.skip("no helm here")
    files = chart(name)
    for path, text in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    values = values_of(files)
    new = {key: CHANGED[key] for key in values}
    (tmp_path / "new.json").write_text(json.dumps(new))
    # Helm adds the keys of a map to those that are there.
    merged = new | {"nodeSelector": values["nodeSelector"] | new["nodeSelector"]}
    for given, words in ((values, ()), (merged, ("--values", str(tmp_path / "new.json")))):
        done = subprocess.run(
            ["helm", "template", "release", str(tmp_path), *words],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        key = lambda each: (each["kind"], each["metadata"]["name"])  # noqa: E731
        made = sorted((each for each in yaml.safe_load_all(done.stdout) if each), key=key)
        assert made == sorted(filled(files, given, run_name(REQUESTS[name])), key=key)
