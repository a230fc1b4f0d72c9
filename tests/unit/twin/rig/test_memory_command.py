"""``twin memory``: the plan as text and JSON, and one line for what cannot be."""

import json

import pytest

from twin.base.errors import UsageError
from twin.rig.memory import show_memory, show_memory_of

RIG = {
    "slots": 256,
    "cameras": ["front_left", "front_right"],
    "size": (640, 360),
    "effects": ["all"],
    "outputs": [],
    "lidars": ["roof"],
    "scene": "crossing",
    "vehicle": "opencav",
    "device": "cpu",
}


def test_two_cameras_and_a_lidar_of_256_slots_stay_below_12_gb(capsys):
    show_memory(**RIG, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["bytes"] < 12e9
    assert found["bytes"] == sum(found["rows"].values())
    assert {"front_left: effects", "lidar.roof: rays"} <= set(found["rows"])
    assert found["free_bytes"] is None
    show_memory(**RIG, as_json=False)
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("for 256 slots")
    assert f"{found['bytes'] / 1e6:,.1f} MB" in last


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"effects": ["blom"]}, r"effects\[0\]: given 'blom', allowed: bloom"),
        ({"cameras": ["rear"]}, "no camera 'rear'; .*front_right"),
        ({"lidars": ["rof"]}, "no lidar 'rof'; did you mean 'roof'"),
        ({"scene": "nowhere"}, "scene 'nowhere': not shipped"),
        ({"size": (5, 5)}, "given 5, allowed: .*>= 16"),
        ({"device": "tpu"}, "device 'tpu': not here; allowed: cpu"),
    ],
)
def test_what_cannot_be_is_one_line(change, expected):
    with pytest.raises(UsageError, match=expected):
        show_memory(**{**RIG, **change}, as_json=False)


def write_campaign(folder, **changes):
    (folder / "net.onnx").write_bytes(bytes(10_000_000))
    data = {
        "campaign": "m",
        "scenario": {"scene": "crossing"},
        "camera": {"width": 640, "height": 360},
        "autonomy": {
            "perception": {
                "a": {"type": "network", "model": str(folder / "net.onnx")},
                "b": {"type": "ground_truth"},
            }
        },
        "matrix": {"model": ["a", "b"]},
        **changes,
    }
    path = folder / "m.yaml"
    path.write_text(json.dumps(data))
    return str(path)


def test_the_rigs_of_a_campaign_with_their_networks(capsys, tmp_path):
    show_memory_of(write_campaign(tmp_path), 256, "cpu", 12.0, as_json=True)
    found = json.loads(capsys.readouterr().out)
    network = found["rows"][f"network {tmp_path / 'net.onnx'}"]
    assert network > 20_000_000
    assert found["rows"]["stack: CUDA and its libraries"] > 1e9
    assert found["free_bytes"] == 12_000_000_000
    most = found["slots_max"]
    assert most > 256
    show_memory_of(write_campaign(tmp_path), most, "cpu", 12.0, as_json=True)
    assert json.loads(capsys.readouterr().out)["bytes"] <= 12e9
    show_memory_of(write_campaign(tmp_path), most + 1, "cpu", 12.0, as_json=True)
    assert json.loads(capsys.readouterr().out)["bytes"] > 12e9
    only = {"matrix": {"model": ["b"]}}
    show_memory_of(write_campaign(tmp_path, **only), 256, "cpu", None, as_json=True)
    without = json.loads(capsys.readouterr().out)
    assert without["slots_max"] is None
    assert not any(name.startswith(("network", "stack")) for name in without["rows"])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"camera": {"width": 5}}, "m.yaml: camera.width: given 5"),
        ({"camera": {"name": "rear"}}, "no camera 'rear'"),
    ],
)
def test_a_campaign_that_cannot_be_is_one_line(change, expected, tmp_path):
    with pytest.raises(UsageError, match=expected):
        show_memory_of(write_campaign(tmp_path, **change), 4, "cpu", 1.0, as_json=False)
