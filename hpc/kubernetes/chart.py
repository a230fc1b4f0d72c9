"""A Helm chart of one run: our objects as templates, and values for what may change later. Pure.

What shapes the objects (claim or store, CPU or GPU, own campaign file) is decided when the chart
is written. Every value stands in a template as one expression in the place of one scalar, so a
template with the written values is what ``hpc render`` prints. Keys are no part of a chart: Helm
would keep copies of them with every release.
"""

from __future__ import annotations

import json
import re
from typing import Any

import yaml

from hpc.kubernetes import object_store
from hpc.kubernetes.objects import (
    COMPONENT,
    IMAGE,
    QUEUE,
    WORKER_FAILURES,
    Object,
    as_yaml,
    objects_of,
    run_name,
)
from hpc.kubernetes.options import IMAGE_PATTERN, QUANTITY_PATTERN, KubernetesOptions
from hpc.request import CPUS_MAX, WORKERS_MAX, JobRequest
from twin.base.errors import UsageError

CAMPAIGN_FILE = "files/campaign.yaml"
"""Where a chart keeps the campaign file; it is no template."""

EXPRESSIONS = {
    "image": "{{ .Values.image | quote }}",
    "workers": "{{ .Values.workers }}",
    "failures": f"{{{{ mul {WORKER_FAILURES} .Values.workers }}}}",
    "suspend": '{{ ne .Values.queue "" }}',
    "queue": "{{ .Values.queue | quote }}",
    "cpus": "{{ .Values.cpus | quote }}",
    "memory": "{{ .Values.memory | quote }}",
    "gpu": "{{ .Values.gpuResource | quote }}",
    "storage": "{{ .Values.storage | quote }}",
    "tolerations": "{{ toJson .Values.tolerations }}",
    "nodeSelector": "{{ toJson .Values.nodeSelector }}",
    "store": '{{ printf "%s/%s" (trimSuffix "/" .Values.store.url) "RUN" | quote }}',
    "storeSecret": "{{ .Values.store.secret | quote }}",
    "campaign": f'{{{{ .Files.Get "{CAMPAIGN_FILE}" | quote }}}}',
}
"""What stands in a template, by the mark in whose place it stands; ``RUN``: the run's name."""

_IF_QUEUE = "{{- if .Values.queue }}"
_END = "{{- end }}"


def chart_of(request: JobRequest, options: KubernetesOptions, campaign: str) -> dict[str, str]:
    """Texts of a chart by file name.

    Args:
        request: what is asked for.
        options: what is asked of Kubernetes.
        campaign: text of the campaign file; empty: a shipped campaign, by its name.

    Raises:
        UsageError: the workers join a conductor elsewhere, or a name looks like a template.
    """
    if request.join:
        raise UsageError("--helm: workers that join a conductor elsewhere have no chart")
    run = run_name(request)
    objects = objects_of(request, options, campaign)
    values = _values(request, options)
    for found in objects:
        _mark(found, bool(options.store))
    text = as_yaml(request, objects)
    if "{{" in text:
        raise UsageError(f"--helm: {request.campaign}: a name with {{{{ would be a template")
    version = {"apiVersion": "v2", "name": run, "version": "1.0.0", "type": "application"}
    described = {"description": f"A run of drivetwin: {request.worker_count} workers at first"}
    files = {
        "Chart.yaml": _dumped({**version, **described}),
        "values.yaml": "# Values of one run, written by `hpc render --helm`.\n" + _dumped(values),
        "values.schema.json": json.dumps(_schema(values), indent=1) + "\n",
        "templates/objects.yaml": _template(text, run),
    }
    return files | ({CAMPAIGN_FILE: campaign} if campaign else {})


def _values(request: JobRequest, options: KubernetesOptions) -> Object:
    """What is in the objects of the request, by the name of its value."""
    values: Object = {
        "image": options.image,
        "workers": request.worker_count,
        "cpus": request.cpus,
        "memory": options.memory,
        "queue": options.queue,
        "tolerations": [],
        "nodeSelector": {},
    }
    pod = objects_of(request, options)[-1]["spec"]["template"]["spec"]
    values |= {name: pod[name] for name in ("tolerations", "nodeSelector") if name in pod}
    if request.gpus:
        values["gpuResource"] = options.gpu_resource
    if options.store:
        values["store"] = {"url": options.store, "secret": options.store_secret}
    else:
        values["storage"] = options.storage
    return values


def _mark(found: Object, has_store: bool) -> None:
    """Put marks in the place of what values say."""
    if found["kind"] == "PersistentVolumeClaim":
        found["spec"]["resources"]["requests"]["storage"] = _at("storage")
        found["metadata"]["annotations"][IMAGE] = _at("image")
    if found["kind"] == "ConfigMap":
        found["data"]["campaign.yaml"] = _at("campaign")
    if found["kind"] != "Job":
        return
    found["spec"] |= {"suspend": _at("suspend")}
    found["metadata"]["labels"][QUEUE] = _at("queue")
    pod = found["spec"]["template"]["spec"]
    for container in (*pod["initContainers"], *pod["containers"]):
        container["image"] = _at("image")
    if has_store:
        _mark_store(found, pod)
    if found["metadata"]["labels"][COMPONENT] != "worker":
        return
    found["spec"] |= {"parallelism": _at("workers"), "backoffLimit": _at("failures")}
    pod |= {name: _at(name) for name in ("tolerations", "nodeSelector")}
    for wanted in pod["containers"][0]["resources"].values():
        wanted |= {"cpu": _at("cpus"), "memory": _at("memory")}
        for name in [name for name in wanted if "/" in name]:
            wanted[_at("gpu")] = wanted.pop(name)


def _mark_store(found: Object, pod: Object) -> None:
    if object_store.STORE in found["metadata"].get("annotations", {}):
        found["metadata"]["annotations"][object_store.STORE] = _at("store")
        command = pod["containers"][0]["command"]
        command[command.index("--store") + 1] = _at("store")
    for volume in pod["volumes"]:
        if volume["name"] == "store":
            volume["secret"]["secretName"] = _at("storeSecret")


def _at(name: str) -> str:
    """The mark of a value."""
    assert name in EXPRESSIONS
    return f"@@{name}@@"


def _template(text: str, run: str) -> str:
    """The text with expressions in the place of marks."""
    label = re.compile(rf"^( *{re.escape(QUEUE)}: )'@@queue@@'\n", re.MULTILINE)
    text = label.sub(rf"{_IF_QUEUE}\n\1'@@queue@@'\n{_END}\n", text)
    for name, expression in EXPRESSIONS.items():
        text = text.replace(f"'{_at(name)}'", expression.replace('"RUN"', f'"{run}"'))
    return text


def _schema(values: Object) -> Object:
    """JSON schema by which Helm refuses bad values before it sends anything."""
    words: Object = {"type": "object", "additionalProperties": {"type": "string"}}
    quantity = {"type": "string", "pattern": f"^({QUANTITY_PATTERN})$"}
    known: dict[str, Any] = {
        "image": {"type": "string", "pattern": f"^({IMAGE_PATTERN})$"},
        "workers": {"type": "integer", "minimum": 1, "maximum": WORKERS_MAX},
        "cpus": {"type": "integer", "minimum": 1, "maximum": CPUS_MAX},
        "memory": quantity,
        "storage": quantity,
        "queue": {"type": "string", "pattern": "^([a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?)?$"},
        "gpuResource": {"type": "string", "pattern": "^[a-z0-9.-]+/[A-Za-z0-9_.-]+$"},
        "tolerations": {"type": "array", "items": words},
        "nodeSelector": words,
        "store": {
            "type": "object",
            "properties": {
                "url": {"type": "string", "pattern": "^(s3|gs)://[A-Za-z0-9._/-]+$"},
                "secret": {"type": "string", "pattern": "^[a-z0-9]([-a-z0-9.]*[a-z0-9])?$"},
            },
            "required": ["url", "secret"],
            "additionalProperties": False,
        },
    }
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "type": "object",
        # Helm adds `global`.
        "properties": {**{name: known[name] for name in values}, "global": {"type": "object"}},
        "required": [*values],
        "additionalProperties": False,
    }


def _dumped(content: Object) -> str:
    return yaml.safe_dump(content, sort_keys=False, width=100)
