"""Several cameras on one vehicle: names, rates, noise of their own, buffers."""

import msgspec
import numpy as np
import pytest
from case_changes import changed

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.sensors.exteroceptive import frame_channels


def case(**more):
    data = {
        "campaign": "eyes",
        "seed": 4,
        "camera": {"width": 48, "height": 27, "hz": 20},
        "cameras": [{"name": "front_left", "width": 32, "height": 18, "hz": 5}],
        "scenario": {"duration_s": 2.0, "ego_speed_mps": 8.0},
        "matrix": {"weather": ["clear"]},
        **more,
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return expand(campaign)[0]


def ticks(engine, one, count):
    seen = []
    engine.reset(0, one)
    for tick in range(count):
        sensed = engine.sense()
        seen.append({name: data.values.copy() for name, data in sensed.items()})
        engine.step([Command(0, 0, tick, 0.0, 0.0, 0.0)])
    return seen


def test_each_camera_has_its_own_rate_and_size():
    one = case()
    engine = Engine(one, 1)
    seen = ticks(engine, one, 6)
    assert [("camera.front_left" in s, "boxes.front_left" in s) for s in seen] == [
        (t % 4 == 0, t % 4 == 0) for t in range(6)
    ]
    assert all(s["camera"].shape == (1, 27, 48, 3) for s in seen)
    assert seen[0]["camera.front_left"].shape == (1, 18, 32, 3)
    assert engine.refill_every == 4


def test_the_main_camera_does_not_change_beside_another():
    alone, both = case(cameras=[]), case()
    first, second = (ticks(Engine(c, 1), c, 3) for c in (alone, both))
    for a, b in zip(first, second, strict=True):
        assert a["camera"].tobytes() == b["camera"].tobytes()


def test_cameras_see_from_their_own_place_with_noise_of_their_own():
    size = {"width": 48, "height": 27}
    one = case(camera={**size, "noise": False}, cameras=[{**size, "name": "front_left"}])
    quiet = case(camera={**size, "noise": False}, cameras=[])
    quiet = changed(quiet, camera=msgspec.structs.replace(quiet.rig.camera, name="front_left"))
    left = ticks(Engine(one, 1), one, 1)[0]["camera.front_left"].astype(int)
    true = ticks(Engine(quiet, 1), quiet, 1)[0]["camera"].astype(int)
    right = ticks(Engine(one, 1), one, 1)[0]["camera"].astype(int)
    assert 0 < np.abs(left - true).mean() < 6  # only noise
    assert np.abs(right - true).mean() > 2 * np.abs(left - true).mean()


def test_channels_name_what_is_shared_and_engines_write_there():
    one = case()
    channels = frame_channels(one, 2)
    assert [c.name for c in channels] == ["camera", "camera.front_left"]
    buffers = {c.name: np.zeros(c.shape, c.dtype) for c in channels}
    engine = Engine(one, 2, buffers=buffers)
    engine.reset(1, one)
    sensed = engine.sense()
    for channel in channels:
        assert sensed[channel.name].values.shape == channel.shape
        assert buffers[channel.name][1].any()
        assert not buffers[channel.name][0].any()


def test_mistakes_are_one_line():
    _, mistakes = parse_campaign(
        {
            "campaign": "eyes",
            "cameras": [{"name": "front_right"}, {"name": "rear", "hz": 3}],
            "matrix": {"weather": ["clear"]},
        }
    )
    lines = [m.line("file") for m in mistakes]
    assert lines == [
        "file: cameras: 'front_right' appears twice; name each once",
        "file: cameras[1].hz: given 3, allowed: a divisor of control_hz 20",
    ]
    _, mistakes = parse_campaign(
        {
            "campaign": "eyes",
            "cameras": [{"name": "rear", "hz": 3}],
            "matrix": {"weather": ["clear"]},
        }
    )
    assert "cameras[0].hz: given 3, allowed: a divisor of control_hz 20" in mistakes[0].line("f")
    with pytest.raises(ValueError, match=r"no camera 'rear'; .*front_right"):
        Engine(case(cameras=[{"name": "rear"}]), 1)


@pytest.mark.parametrize(("camera_hz", "gnss_hz", "ticks"), [(10, 4, 10), (4, 10, 10), (5, 2, 20)])
def test_slots_are_refilled_when_cameras_and_other_sensors_are_due_together(
    camera_hz, gnss_hz, ticks
):
    """At 20 Hz of control: the least common multiple of both periods, not the longer one."""
    one = case(
        camera={"width": 32, "height": 18, "hz": camera_hz},
        cameras=[],
        sensors={"gnss": {"hz": gnss_hz}},
    )
    assert Engine(one, 1).refill_every == ticks
