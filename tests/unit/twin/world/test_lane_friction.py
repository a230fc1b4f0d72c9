"""Friction of lanes: from the file to the wheels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import warp as wp

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import WIDTH, lane, road, section, xodr

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.road.opendrive.reading.read_lanes import FRICTION_MAX
from twin.road.opendrive.reading.reader import read_network
from twin.vehicle.columns import COLUMN
from twin.vehicle.ground import drivable
from twin.world.scene import load_scene
from twin.world.street.build import build_world


def material(start: float, friction: float) -> str:
    return f'<material sOffset="{start}" friction="{friction}" roughness="0.01" surface="a"/>'


def lane_file(*materials: str, length: float = 200.0) -> bytes:
    slippery = lane(-1, WIDTH + "".join(materials))
    return xodr(road(length, lanes=section(right=slippery + lane(-2, WIDTH, "sidewalk"))))


def test_faces_have_the_friction_of_the_lane_and_station(tmp_path):
    path = tmp_path / "f.xodr"
    path.write_bytes(lane_file(material(50, 0.5), material(120.5, 0.25)))
    world = build_world(load_scene(str(path)))
    mesh = world.mesh
    middle = mesh.points_m[mesh.faces].mean(axis=1)
    inside = (np.abs(middle[:, 1] + 1.75) < 1.75) & (mesh.semantic == 1)
    grip = mesh.grip[inside]
    x = middle[inside, 0]
    assert np.isnan(grip[x < 50]).all()
    assert (grip[(x > 50) & (x < 120.5)] == 0.5).all()
    assert (grip[x > 120.5] == 0.25).all()
    assert np.isnan(mesh.grip[~inside]).all()
    edges = mesh.points_m[np.unique(mesh.faces[inside])][:, 0]
    assert {50.0, 120.5} <= set(np.round(edges, 4).tolist()), "faces end where materials do"
    wheels = drivable(world, wp.get_device("cpu")).kernel.grip.numpy()
    assert sorted(set(wheels.tolist())) == [0.25, 0.5, 0.9, 1.0]


def test_roads_without_materials_have_no_frictions(tmp_path):
    path = tmp_path / "f.xodr"
    path.write_bytes(lane_file())
    assert build_world(load_scene(str(path))).mesh.grip is None


def test_a_friction_that_no_road_has_is_cut_and_said():
    network = read_network(lane_file(material(0, 80.0)), "f.xodr")
    assert network.roads["0"].sections[0].right[0].materials[0].friction == FRICTION_MAX
    assert any(f"friction=80 counts as {FRICTION_MAX:g}" in note for note in network.notes)
    with pytest.raises(ValueError, match="friction='-1'; at least 0"):
        read_network(lane_file(material(0, -1)), "f.xodr")
    with pytest.raises(ValueError, match="friction='nan'"):
        read_network(lane_file(material(0, float("nan"))), "f.xodr")


def speeds(folder: Path, data: bytes, slots: int) -> np.ndarray:
    """Speeds after 1.5 s of full braking from 15 m/s, of each slot."""
    path = folder / "brake.xodr"
    path.write_bytes(data)
    campaign, mistakes = parse_campaign(
        {
            "campaign": "road",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {"type": "lane_keeping", "scene": str(path), "distance_m": 150.0}
            | {"ego_speed_mps": 15.0},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    case = expand(campaign)[0]
    engine = Engine(case, slots)
    for slot in range(slots):
        engine.reset(slot, case)
    for tick in range(15):
        engine.sense()
        engine.step([Command(slot, 1, tick, 0.0, 1.0, 0.0) for slot in range(slots)])
    result = np.array(engine.state)[:, COLUMN["speed_mps"]]
    engine.close()
    return result


@pytest.mark.slow
def test_a_slippery_lane_takes_longer_to_stop_on_and_all_slots_alike(tmp_path):
    dry = speeds(tmp_path, lane_file(), 1)
    half = speeds(tmp_path, lane_file(material(0, 0.4)), 3)
    # Brakes need a moment to build up, and the drag of the air is the same.
    assert 0.38 < (15.0 - half[0]) / (15.0 - dry[0]) < 0.48
    assert half[0] == half[1] == half[2]
    again = speeds(tmp_path, lane_file(material(0, 1.0)), 1)
    assert again[0] == dry[0], "1 is asphalt"
