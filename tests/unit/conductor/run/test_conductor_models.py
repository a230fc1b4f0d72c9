"""Networks of a campaign are loaded by a process of devkit, once, before anything is leased."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from msgspec import structs
from tiny_networks import write_dark_spot_detector
from waiting import PATIENCE_S

from conductor.run import models
from conductor.run.known_good import BYTES_MAX, KEPT_MAX, remember, remembered
from conductor.run.models import FILE, check_models, models_checked, unchanged
from conductor.run.source import load
from schemas.files.assets import file_digest
from schemas.plan import Plan, parse_plan
from schemas.sections.perception import NetworkPerception
from twin.base.errors import InfrastructureError, UsageError


def plan_of(perception: dict[str, dict[str, object]], used: list[str]) -> Plan:
    data = {"campaign": "c", "autonomy": {"perception": perception}, "matrix": {"model": used}}
    found, mistakes = parse_plan(data)
    assert found is not None, mistakes
    return found


def network(path: object, **more: object) -> dict[str, object]:
    return {"type": "network", "model": str(path), **more}


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """A cache folder that nothing is in."""
    folder = tmp_path / "cache"
    monkeypatch.delenv("WARP_CACHE_PATH", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


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
    check_models(plan_of(variants, ["a", "b", "c", "truth"]), "c.yaml")
    assert asked == [["a", "c"]]
    check_models(plan_of(variants, ["truth"]), "c.yaml")
    check_models(plan_of({"truth": truth}, ["truth"]), "c.yaml")
    assert len(asked) == 1
    with pytest.raises(UsageError) as caught:
        check_models(plan_of(variants, ["a", "gone"]), "c.yaml")
    assert str(caught.value) == (
        f"c.yaml: autonomy.perception.gone: {tmp_path}/gone.onnx: No such file or directory"
    )


@pytest.mark.slow
def test_what_was_good_once_is_not_loaded_again(asked, cache, monkeypatch, tmp_path):
    path = write_dark_spot_detector(tmp_path / "a.onnx")
    variants = {
        "a": {"type": "network", "model": "a.onnx"},
        "b": {"type": "network", "model": "b.onnx"},
    }
    given = {"campaign": "c", "autonomy": {"perception": variants}}
    file = tmp_path / "c.yaml"

    def check(*names, width=640, device="cpu"):
        camera = {"camera": {"width": width}, "matrix": {"model": list(names)}}
        file.write_text(json.dumps(given | camera))
        asked.clear()
        check_models(load(str(file)), "c.yaml", device)
        return asked

    (tmp_path / "b.onnx").write_bytes(path.read_bytes()[:-40])
    for _ in range(2):
        with pytest.raises(UsageError, match=r"perception\.b: .*b\.onnx: not an ONNX file"):
            check("a", "b")
    assert asked == [["b"]], "only what was good is remembered"
    assert check("a") == []
    # Where it lies does not matter; what is in it, the pictures' size and the device do.
    (tmp_path / "b.onnx").write_bytes(path.read_bytes())
    assert check("a", "b") == []
    assert check("a", width=320) == [["a"]]
    assert check("a", width=320) == []
    write_dark_spot_detector(path, label="truck")
    assert check("a", "b") == [["a"]]
    assert check("a") == []
    monkeypatch.setattr(models, "device_class", lambda device: "cpu:another")
    assert check("a") == [["a"]]


def test_a_memory_that_is_damaged_or_cannot_be_written_is_as_none(cache):
    first, second = "1" * 64, "2" * 64
    remember(FILE, [first])
    remember(FILE, [second, first])
    assert remembered(FILE) == [second, first]
    (file,) = (cache / "drivetwin").iterdir()
    for damaged in (b"", b"[", b"{}", b"[1]", b'["short"]', b"\xff", b"[" * 100_000):
        file.write_bytes(damaged)
        assert remembered(FILE) == []
    remember(FILE, [first])
    assert remembered(FILE) == [first]
    remember(FILE, [f"{number:064x}" for number in range(KEPT_MAX + 5)])
    assert len(remembered(FILE)) == KEPT_MAX
    assert file.stat().st_size < BYTES_MAX
    file.unlink()
    os.mkfifo(file)  # nobody writes to it
    assert remembered(FILE) == []
    file.unlink()
    file.parent.rmdir()
    file.parent.write_text("no folder")
    remember(FILE, [first])
    assert remembered(FILE) == []


def test_what_changed_while_it_was_loaded_is_not_remembered(tmp_path):
    path = write_dark_spot_detector(tmp_path / "a.onnx")
    files = {str(path): file_digest(path)}
    plan = plan_of({"a": network(path)}, ["a"])
    given = plan.amended(structs.replace(plan.campaign, files=files))
    with models_checked(given, "c.yaml"):
        write_dark_spot_detector(path, label="truck")
    assert remembered(FILE) == []
    path.unlink()
    assert not unchanged(NetworkPerception(model=str(path)), files)


def test_a_worker_with_a_gpu_needs_its_runtime(asked, tmp_path):
    import onnxruntime

    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("ONNX Runtime can use GPUs here")
    path = write_dark_spot_detector(tmp_path / "a.onnx")
    with pytest.raises(UsageError, match=r"a\.onnx: this onnxruntime has no CUDAExecutionProvid"):
        check_models(plan_of({"a": network(path)}, ["a"]), "c.yaml", "cuda:0")
    check_models(plan_of({"a": network(path, runtime="opencv")}, ["a"]), "c.yaml", "cuda:0")


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
    given = plan_of({"a": network(tmp_path / "a.onnx")}, ["a"])
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
