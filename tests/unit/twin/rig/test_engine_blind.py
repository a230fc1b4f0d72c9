"""``render: off``: the engine without any camera."""

import numpy as np
from case_changes import changed

from schemas.identity import case_digest, rig_key
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.sensors.exteroceptive import frame_channels


def parsed(render, **more):
    return parse_campaign(
        {
            "schema": 1,
            "campaign": "c",
            "render": render,
            "scenario": {"ego_start_m": 20, "ego_speed_mps": 10, "duration_s": 0.5},
            "cameras": [{"name": "front_left"}],
            "lidars": [{"name": "roof"}],
            "autonomy": {"stack": "m:S"},
            "matrix": {"weather": ["clear"]},
            **more,
        }
    )


def case(render, **more):
    campaign, mistakes = parsed(render, **more)
    assert not mistakes
    return expand(campaign)[0]


def test_a_camera_that_does_not_see_may_have_any_rate():
    mistakes = parsed(True, control_hz=50)[1]
    assert [mistake.path for mistake in mistakes] == ["camera.hz", "cameras[0].hz"]
    blind = case(False, control_hz=50)
    engine = Engine(blind, 1)
    engine.reset(0, blind)
    for tick in range(5):
        assert "camera" not in engine.sense()
        engine.step([Command(0, 1, tick, 0.0, 1.0, 0.0)])
    assert engine.tick[0] == 5


def test_no_camera_sees_and_everything_else_goes_on():
    blind = case(False)
    engine = Engine(blind, 1)
    engine.reset(0, blind)
    assert engine.camera_sites == []
    assert [channel.name for channel in frame_channels(blind, 1)] == ["lidar.roof"]
    names, finished = set(), []
    while not finished:
        sensed = engine.sense()
        names |= set(sensed)
        command = Command(0, 1, int(engine.tick[0]), 0.0, 0.0, 0.0)
        finished = engine.step([command])
    assert {"vehicle", "environment", "lidar.roof"} <= names
    assert not {n for n in names if n.partition(".")[0] in ("camera", "boxes")}
    assert finished[0].outcome == "verdict"
    speeds = finished[0].table.columns["speed_mps"].values
    assert np.isfinite(speeds).all()
    assert speeds[0] == 10.0


def test_it_is_another_case_and_another_rig():
    seeing, blind = case(True), case(False)
    assert case_digest(seeing) != case_digest(blind)
    assert rig_key(seeing) != rig_key(blind)
    assert changed(blind, render=True) == seeing
