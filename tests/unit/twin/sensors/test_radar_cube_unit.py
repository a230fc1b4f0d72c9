"""The sensor radar_cube in an engine: beside the radar it is made of, at a rate of its own."""

from __future__ import annotations

import numpy as np
import pytest

from schemas.identity import rig_key
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.sensors.exteroceptive import frame_channels
from twin.sensors.radar.profile import load_radar_profile
from twin.sensors.rig_memory import rig_memory
from twin.vehicle.vehicle_file import load_vehicle

CAMPAIGN = {
    "schema": 1,
    "campaign": "cubes",
    "control_hz": 20,
    "render": False,
    "autonomy": {"stack": "devkit.idle:IdleStack"},
    "scenario": {"duration_s": 2, "ego_speed_mps": 10},
    "sensors": {"radar": {"hz": 20}, "radar_cube": {"hz": 10}},
    "matrix": {"sensors.radar.profile": ["long_range", "corner"]},
}
TICKS = 3


def cases(**changes):
    campaign, mistakes = parse_campaign({**CAMPAIGN, **changes})
    assert campaign is not None, mistakes
    return expand(campaign)


def drive(cases, buffers=None):
    """Readings of all slots at each tick."""
    engine = Engine(cases[0], len(cases), buffers=buffers or {})
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    found = []
    for _ in range(TICKS):
        sensed = engine.sense()
        found.append({n: d.values.copy() for n, d in sensed.items() if n.startswith("radar")})
        engine.step([Command(s, 0, int(engine.tick[s]), 0.0, 0.0, 0.0) for s in range(len(cases))])
    return found


@pytest.mark.slow
def test_slots_with_other_radars_have_the_cubes_that_each_has_alone():
    both = cases()
    assert len({rig_key(case) for case in both}) == 1
    channel = next(c for c in frame_channels(both[0], 2) if c.name == "radar_cube")
    buffers = {channel.name: np.zeros(channel.shape, channel.dtype)}
    together = drive(both, buffers)
    due = ["radar", "radar_cube"]
    assert [sorted(tick) for tick in together] == [due, ["radar"], due]
    assert (buffers["radar_cube"] == together[2]["radar_cube"]).all(), "where stacks look"
    for slot, case in enumerate(both):
        profile = load_radar_profile(case.variation.sensors.radar.profile)
        alone = drive([case])
        for tick in (0, 2):
            cube = together[tick]["radar_cube"][slot]
            assert cube.tobytes() == alone[tick]["radar_cube"][0].tobytes()
            assert cube[: profile.samples, : profile.chirps].min() > 0.0, "noise is everywhere"
            assert not cube[profile.samples :].any()
            assert not cube[:, profile.chirps :].any()


@pytest.mark.slow
def test_a_cube_changes_no_detection():
    with_cube = drive(cases())
    without = drive(cases(sensors={"radar": {"hz": 20}}))
    for one, two in zip(with_cube, without, strict=True):
        assert "radar_cube" not in two
        assert one["radar"].tobytes() == two["radar"].tobytes()


def test_the_memory_estimate_has_the_cube():
    case, plain = cases()[0], cases(sensors={"radar": {"hz": 20}})[0]
    vehicle = load_vehicle(case.rig.vehicle)
    engine = Engine(plain, 1)
    rows = {row.name: row for row in rig_memory(case, vehicle, engine.world, 1).rows}
    assert "radar_cube: grid" in rows
    assert "radar_cube: grid" not in {
        row.name for row in rig_memory(plain, vehicle, engine.world, 1).rows
    }
    sizes = [rig_memory(c, vehicle, engine.world, 4).bytes_total for c in (case, plain)]
    assert sizes[0] - sizes[1] == 4 * 400 * 160 * 32 * 4
