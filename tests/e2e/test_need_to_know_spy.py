"""A stack that listens to everything finds nothing that its campaign does not give it."""

import json
import struct
import sys
from pathlib import Path

import msgpack
import numpy as np
import pyarrow.parquet as parquet
import pytest
from processes import outcomes
from tiny_networks import write_dark_spot_detector

SPY = Path(__file__).parent / "spying_stack.py"
SEED = 736_251_980_417


def spied(folder, autonomy):
    """A campaign with the spy for a stack, and where it puts its notes."""
    notes = folder / "notes"
    write_dark_spot_detector(folder / "dark.onnx")
    content = {
        "campaign": "spied_upon",
        "seed": SEED,
        "scenario": {"ego_start_m": 24, "ego_speed_mps": 7, "duration_s": 1},
        "camera": {"width": 64, "height": 36, "hz": 10},
        "autonomy": {
            "command": [sys.executable, str(SPY), str(notes)],
            "perception": {"net": {"type": "network", "model": "dark.onnx"}},
            "sandbox": "off",  # its notes have to stay
            **autonomy,
        },
        "matrix": {"weather": ["heavy_fog"], "time_of_day": ["21:37"]},
    }
    path = folder / "spied.yaml"
    path.write_text(json.dumps(content))  # JSON is YAML
    return path, notes


def read(notes):
    data, entries = notes.read_bytes(), []
    while data:
        (size,) = struct.unpack_from("<I", data)
        entries.append(msgpack.unpackb(data[4 : 4 + size]))
        data = data[4 + size :]
    return entries


def run(marked, tmp_path, autonomy):
    path, notes = spied(tmp_path, autonomy)
    out = tmp_path / "out"
    done = marked.run("conductor", "run", str(path), "--workers", "1", "--out", str(out))
    assert done.returncode in (0, 1), done.stderr
    return out, read(notes)


def test_nothing_that_a_network_must_not_know(marked, tmp_path):
    out, entries = run(marked, tmp_path, {})
    ((name, case),) = outcomes(out).items()
    assert "heavy_fog" in name
    kinds = {entry["key"].rpartition("/")[2] for entry in entries}
    assert {"episode", "tick", "boxes", "camera", "environment", "vehicle"} <= kinds
    assert "pose" not in kinds
    assert "reply" not in kinds, "nobody answers what a stack asks"
    started, *messages = entries
    for entry in messages:
        words = entry["payload"] + entry["attachment"]
        if entry["key"].rpartition("/")[2] == "camera":
            words = entry["attachment"]
        for secret in (name, "heavy_fog", "21:37", "2137", "spied_upon", str(SEED)):
            assert secret.encode() not in words, entry["key"]
        for form in ("<q", "<d", ">q"):
            assert struct.pack(form, SEED) not in words, entry["key"]
    command_line = json.loads(started["payload"])
    assert not any(str(SEED) in json.dumps(part) for part in command_line)
    assert not any(name in json.dumps(part) for part in command_line)
    for entry in entries:
        if entry["key"].endswith("/boxes"):
            assert not any(entry["payload"]), "a true distance"
    true = parquet.read_table(out / case["attempt_dir"] / "kpi.parquet").to_pydict()
    assert min(true["dtc_m"]) < 30, "there was something to be seen"
    environments = {e["payload"] for e in entries if e["key"].endswith("/environment")}
    steps = {tuple(np.frombuffer(payload)) for payload in environments}
    assert all(lux > 0 and extinction > 0.006 for lux, extinction in steps), "it is foggy"


@pytest.mark.parametrize("tell", [["case", "seed", "truth"]])
def test_what_a_campaign_tells_is_told_and_reported(marked, tmp_path, tell):
    out, entries = run(marked, tmp_path, {"tell": tell})
    (name,) = outcomes(out)
    episode = next(e["payload"] for e in entries if e["key"].endswith("/episode"))
    said = msgpack.unpackb(episode)
    assert (said["case"], said["seed"]) == (name, SEED)
    assert any(any(e["payload"]) for e in entries if e["key"].endswith("/boxes"))
    assert json.loads((out / "outcomes.json").read_text())["tell"] == ["case", "seed", "truth"]
    assert (
        "The stack was told more than it needs: case, seed, truth"
        in (out / "report.html").read_text()
    )
