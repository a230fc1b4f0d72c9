"""``twin memory``: the plan as text and JSON, and one line for what cannot be."""

import json

import pytest

from twin.fabric.errors import UsageError
from twin.memory import show_memory

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
