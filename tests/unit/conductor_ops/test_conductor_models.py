"""Networks of a campaign are loaded by a process of devkit, once, before anything is leased."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from tiny_networks import write_dark_spot_detector
from waiting import PATIENCE_S

from conductor import models
from conductor.models import check_models
from schemas.campaign import Campaign, parse_campaign
from twin.fabric.errors import InfrastructureError, UsageError


def campaign(perception: dict[str, dict[str, object]], used: list[str]) -> Campaign:
    data = {"campaign": "c", "autonomy": {"perception": perception}, "matrix": {"model": used}}
    found, mistakes = parse_campaign(data)
    assert found is not None, mistakes
    return found


def network(path: object, **more: object) -> dict[str, object]:
    return {"type": "network", "model": str(path), **more}


@pytest.fixture
def asked(monkeypatch):
    """What devkit was asked for, each time."""
    found: list[list[str]] = []
    real = models._ask

    def ask(variants, camera, device):
        found.append(sorted(variants))
        return real(variants, camera, device)

    monkeypatch.setattr(models, "_ask", ask)
    return found


def test_only_what_cases_use_is_loaded_each_network_once(asked, tmp_path):
    path = write_dark_spot_detector(tmp_path / "a.onnx")
    truth = {"type": "ground_truth"}
    variants = {
        "a": network(path),
        "b": network(path, confidence_min=0.4),
        "c": network(path, runtime="onnxruntime"),
        "gone": network(tmp_path / "gone.onnx"),
        "truth": truth,
    }
    check_models(campaign(variants, ["a", "b", "c", "truth"]), "c.yaml")
    assert asked == [["a", "c"]]
    check_models(campaign(variants, ["truth"]), "c.yaml")
    check_models(campaign({"truth": truth}, ["truth"]), "c.yaml")
    assert len(asked) == 1
    with pytest.raises(UsageError) as caught:
        check_models(campaign(variants, ["a", "gone"]), "c.yaml")
    assert str(caught.value) == (
        f"c.yaml: autonomy.perception.gone: {tmp_path}/gone.onnx: No such file or directory"
    )


def test_a_worker_with_a_gpu_needs_its_runtime(asked, tmp_path):
    import onnxruntime

    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("ONNX Runtime can use GPUs here")
    path = write_dark_spot_detector(tmp_path / "a.onnx")
    with pytest.raises(UsageError, match=r"a\.onnx: this onnxruntime has no CUDAExecutionProvid"):
        check_models(campaign({"a": network(path)}, ["a"]), "c.yaml", "cuda:0")
    check_models(campaign({"a": network(path, runtime="opencv")}, ["a"]), "c.yaml", "cuda:0")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("import sys; print('out of sorts', file=sys.stderr); sys.exit(3)", "exit code 3): out of"),
        ("print('nothing of the kind')", "without an answer (exit code 0): it said nothing"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "killed by SIGKILL"),
    ],
)
def test_a_check_that_breaks_down_is_no_mistake_of_the_campaign(monkeypatch, tmp_path, code, words):
    """A network may take down the process that loads it."""
    real = subprocess.Popen
    monkeypatch.setattr(
        models.subprocess, "Popen", lambda _, **how: real([sys.executable, "-c", code], **how)
    )
    given = campaign({"a": network(tmp_path / "a.onnx")}, ["a"])
    with pytest.raises(InfrastructureError) as caught:
        check_models(given, "c.yaml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_devkit_says_what_it_ships_and_what_it_was_given():
    listed = devkit("models", "--output", "json")
    assert listed.returncode == 0
    assert isinstance(json.loads(listed.stdout), dict)
    refused = devkit("check-models", given="[]")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("devkit: standard input: Expected `object`")


def devkit(*arguments: str, given: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "devkit", *arguments],
        input=given,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
