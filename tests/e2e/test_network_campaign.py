"""Neural perception in campaigns: real networks, the same verdicts, bad files before any lease."""

from __future__ import annotations

import json
import math

import msgspec
import onnx
import pytest
from darknet_oracle import random_weights
from onnx import helper
from processes import outcomes, wait_for
from test_bad_input import one_line
from tiny_networks import write_dark_spot_detector

from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import architecture_network
from devkit.detector.description import METADATA_KEY, decode_description

CAMPAIGN = {
    "campaign": "networks",
    "scenario": {
        "ego_start_m": 14,
        "ego_speed_mps": 10,
        "duration_s": 3,
        "standstill_s": 0.2,
    },
    "camera": {"width": 96, "height": 54, "hz": 10},
    "attempts_max": 1,
}


@pytest.fixture
def campaign(tmp_path):
    """Writes a campaign with the given perception variants beside two real networks."""
    write_dark_spot_detector(tmp_path / "dark.onnx")
    network = architecture_network("yolov3-tiny-w25", classes=4, width=96, height=64)
    names = ["car", "truck", "pedestrian", "traffic_sign"]
    onnx.save(write_onnx(network, random_weights(network, 3), names), tmp_path / "tiny.onnx")

    def write(variants):
        variants = {name: {"type": "network", **each} for name, each in variants.items()}
        data = {
            **CAMPAIGN,
            "autonomy": {"parameters": {"frames_min": 1}, "perception": variants},
            "matrix": {"model": list(variants)},
        }
        path = tmp_path / "networks.yaml"
        path.write_text(json.dumps(data))  # JSON is YAML
        return path

    return write


def test_real_networks_drive_and_slots_do_not_matter(marked, campaign, tmp_path):
    path = campaign({"dark": {"model": "dark.onnx"}, "tiny": {"model": "tiny.onnx"}})
    found = []
    for slots in ("1", "2"):
        done = marked.run(
            *("conductor", "run", str(path), "--workers", "1", "--slots", slots),
            *("--out", str(tmp_path / f"slots-{slots}"), "--output", "json"),
        )
        assert done.returncode == 1, done.stderr
        found.append(json.loads(done.stdout))
    assert found[0]["fingerprint"] == found[1]["fingerprint"]
    # One network sees the car ahead and the stack brakes for it, the other has never learned to.
    rows = outcomes(tmp_path / "slots-2")
    assert {name: row["verdict"] for name, row in rows.items()} == {
        "dark": "pass",
        "tiny": "collision",
    }
    for row in rows.values():  # a frame every other tick
        assert row["perception"]["frames"] == math.ceil(row["scalars"]["ticks"] / 2)
    assert all(0 < row["perception"]["wall_s"] < row["rig_wall_s"] for row in rows.values())
    page = (tmp_path / "slots-2" / "report.html").read_text()
    table = page.split('id="perception-costs"')[1].split("</table>")[0]
    assert "model tiny.onnx" in table
    assert table.count("opencv cpu") == 2


def test_what_cannot_be_loaded_is_said_before_anything_runs(marked, campaign, tmp_path):
    whole = (tmp_path / "tiny.onnx").read_bytes()
    (tmp_path / "half.onnx").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "half.weights").write_bytes(bytes(5000))
    model = onnx.load_model_from_string(whole)
    text = next(entry.value for entry in model.metadata_props if entry.key == METADATA_KEY)
    shaped = msgspec.structs.replace(decode_description(text, ""), width=320, height=192)
    helper.set_model_props(model, {METADATA_KEY: shaped.encode()})
    onnx.save(model, tmp_path / "shape.onnx")
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "plain.onnx")
    model = onnx.load(tmp_path / "dark.onnx")
    model.graph.node[0].op_type, model.graph.node[0].domain = "Wobble", "strange.ops"
    model.opset_import.append(helper.make_opsetid("strange.ops", 1))
    onnx.save(model, tmp_path / "wobble.onnx")
    path = campaign(
        {
            "fine": {"model": "dark.onnx"},
            "half": {"model": "half.onnx"},
            "shape": {"model": "shape.onnx"},
            "plain": {"model": "plain.onnx"},
            "wobble": {"model": "wobble.onnx"},
            "bare": {"model": "yolov3"},
            "unknown": {"model": "yolov9-w25"},
            "weights": {"model": "yolov2-tiny", "weights": "half.weights"},
        }
    )
    expected = {
        "half": ("half.onnx: not an ONNX file, or damaged",),
        "shape": ("shape.onnx: input 'images' is [batch, 3, 64, 96], expected",),
        "plain": ("plain.onnx: no metadata", "as a description"),
        "wobble": ("wobble.onnx: OpenCV cannot run it: operator Wobble",),
        "bare": ("the published weights are not shipped", "import-darknet"),
        "unknown": ("no such model is shipped",),
        "weights": ("half.weights: ends in layer 2 [convolutional]",),
    }
    out = tmp_path / "out"
    for command in (
        ("validate",),
        ("run", "--out", str(out)),
        ("submit", "--connect", "tcp/127.0.0.1:1"),
    ):
        done = marked.run("conductor", command[0], str(path), *command[1:])
        assert (done.returncode, done.stdout) == (2, "")
        lines = done.stderr.strip().splitlines()
        assert len(lines) == len(expected), done.stderr
        for line, (name, words) in zip(lines, expected.items(), strict=True):
            assert f"networks.yaml: autonomy.perception.{name}: " in line
            assert all(word in line for word in words), line
    assert not out.exists()
    (tmp_path / "half.onnx").unlink()
    one_line(marked.run("conductor", "validate", str(path)), 2, "perception.half.model", "no such")


def test_a_worker_without_the_file_is_no_verdict(marked, campaign, tmp_path):
    path = campaign({"dark": {"model": "dark.onnx"}})
    state = tmp_path / "state"
    server = marked.start("conductor", "serve", "--state", str(state))
    wait_for((state / "conductor.json").exists, "the conductor")
    done = marked.run("conductor", "submit", str(path), "--state", str(state))
    assert done.returncode == 0, done.stderr
    (tmp_path / "dark.onnx").unlink()
    worker = marked.start("twin", "worker", "--state", str(state))

    def notes():
        status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
        return json.loads(status.stdout)["notes"]

    (line,) = wait_for(notes, "the refusal")
    assert f"{tmp_path}/dark.onnx" in line
    assert "gets no case of campaign 'networks'" in line
    worker.terminate()
    _, said = worker.communicate()
    assert "Traceback" not in said
    assert marked.run("conductor", "stop", "--state", str(state)).returncode == 0
    server.communicate()
    (row,) = outcomes(state / "networks").values()
    assert (row["outcome"], row["passed"], row["charges"]) == ("", False, [])
