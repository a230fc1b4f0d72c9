"""Scenes of OpenDRIVE roads: what is in them, where their ego starts, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from schemas.files.assets import asset_digest, is_path
from schemas.messages import SEMANTIC_CLASSES, Command
from schemas.plan import expand, parse_campaign
from schemas.wire.control import Lease
from tests.road_files import LINE, WIDTH, geometry, lane, road, section, xodr
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.validate.scene_check import Variant, check_scenes
from twin.vehicle.columns import COLUMN
from twin.vehicle.ground import drivable, height_near
from twin.view.samples import stage_of
from twin.world.scene import load_scene
from twin.world.street.build import build_world

MARK = '<roadMark sOffset="0" type="solid" color="yellow" width="0.15"/>'
WALK = lane(-2, '<width sOffset="0" a="2.0" b="0" c="0" d="0"/>', "sidewalk")
STRAIGHT = xodr(road(120.0, lanes=section(right=lane(-1, WIDTH + MARK) + WALK)))


def write(folder: Path, data: bytes, name: str = "own.xodr") -> str:
    path = folder / name
    path.write_bytes(data)
    return str(path)


def lowest(path: str) -> float:
    return float(build_world(load_scene(path)).mesh.points_m[:, 2].min())


def test_lanes_marks_and_ground_have_their_classes(tmp_path):
    world = build_world(load_scene(write(tmp_path, STRAIGHT)))
    classes = {SEMANTIC_CLASSES[k] for k in np.unique(world.mesh.semantic).tolist()}
    assert classes == {"road", "sidewalk", "marking", "terrain"}
    paint = world.mesh.semantic == SEMANTIC_CLASSES.index("marking")
    assert (world.mesh.color[paint][:, 2] < 0.1).all(), "yellow"
    assert not len(world.colliders)
    assert not world.has_obstacle


def test_the_ground_under_wheels_is_the_road(tmp_path):
    hill = '<elevationProfile><elevation s="0" a="1" b="0.05" c="0" d="0"/></elevationProfile>'
    world = build_world(load_scene(write(tmp_path, xodr(road(more=hill)))))
    ground = drivable(world, wp.get_device("cpu"))
    assert ground.kernel.flat == 0
    tarmac = world.mesh.semantic == SEMANTIC_CLASSES.index("road")
    points = world.mesh.points_m[np.unique(world.mesh.faces[tarmac])]
    assert np.allclose(points[:, 2], 1.0 + 0.05 * points[:, 0], atol=1e-4)
    assert height_near(world, 80.0, -2.0, 0.0) == pytest.approx(5.0, abs=1e-4)
    assert height_near(world, 5000.0, 0.0, 7.0) == 7.0, "nothing is there"


def test_of_two_storeys_the_nearer_carries_a_car(tmp_path):
    """A bridge of 6 m over a road."""
    high = '<elevationProfile><elevation s="0" a="6" b="0" c="0" d="0"/></elevationProfile>'
    across = geometry(LINE, 80.0, at=(50.0, -40.0, 0.5 * np.pi))
    bridge = road(80.0, across, road_id="1", more=high)
    world = build_world(load_scene(write(tmp_path, xodr(road(100.0), bridge))))
    assert height_near(world, 50.0, -1.0, 0.3) == pytest.approx(0.0, abs=1e-3)
    assert height_near(world, 50.0, -1.0, 5.5) == pytest.approx(6.0, abs=1e-3)
    assert height_near(world, 20.0, -1.0, 5.5) == pytest.approx(0.0, abs=1e-3)


def test_an_ego_starts_in_the_rightmost_lane_and_keeps_it(tmp_path):
    lanes = section(left="", right=lane(-1) + lane(-2) + lane(-3, kind="shoulder"))
    name = write(tmp_path, xodr(road(200.0, geometry(LINE, 200.0, at=(5.0, 2.0, 0.0)), lanes)))
    campaign, mistakes = parse_campaign(
        {
            "campaign": "road",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {"type": "lane_keeping", "scene": name, "distance_m": 20.0}
            | {"ego_speed_mps": 10.0},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    engine = Engine(expand(campaign)[0], 1)
    engine.reset(0, expand(campaign)[0])
    engine.sense()
    assert engine.state[0, :3] == pytest.approx((5.0, 2.0 - 1.5 * 3.5, 0.0))
    finished: list[Finished] = []
    for tick in range(100):
        if finished:
            break
        engine.sense()
        finished = engine.step([Command(0, 1, tick, 0.3, 0.0, 0.0)])
    assert finished[0].verdict == "pass", finished[0].reasons
    engine.close()


def test_a_curved_lane_is_known_to_its_end(tmp_path):
    bend = geometry('<arc curvature="0.01"/>', 100.0)
    world = build_world(load_scene(write(tmp_path, xodr(road(100.0, bend)))))
    assert world.lane_known
    assert world.lane.at(0.0).y_m == pytest.approx(-1.75)
    middle = world.lane.at(101.75 * np.linspace(0.0, 1.0, 12))
    off_m = np.hypot(middle.x_m, middle.y_m - 100.0) - 101.75
    assert np.abs(off_m).max() < 0.002
    assert world.lane.length_m == pytest.approx(101.75, abs=0.01)


def test_an_ego_begins_at_the_height_of_its_lane(tmp_path):
    high = '<elevationProfile><elevation s="0" a="40" b="0.02" c="0" d="0"/></elevationProfile>'
    name = write(tmp_path, xodr(road(100.0, more=high)))
    campaign, mistakes = parse_campaign(
        {
            "campaign": "road",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {"type": "lane_keeping", "scene": name, "distance_m": 50.0},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    engine = Engine(expand(campaign)[0], 1)
    engine.reset(0, expand(campaign)[0])
    for tick in range(20):
        engine.sense()
        engine.step([Command(0, 1, tick, 0.0, 0.5, 0.0)])
    assert engine.state[0, COLUMN["z_m"]] == pytest.approx(40.0, abs=0.15)
    engine.close()


def test_views_see_the_lane_at_its_height(tmp_path):
    high = '<elevationProfile><elevation s="0" a="4" b="0.02" c="0" d="0"/></elevationProfile>'
    bend = geometry('<arc curvature="0.01"/>', 100.0)
    narrow = section(right=lane(-1, WIDTH.replace("3.5", "3.0")))
    file = write(tmp_path, xodr(road(100.0, bend, narrow, more=high)))
    campaign, mistakes = parse_campaign(
        {
            "campaign": "road",
            "scenario": {"type": "lane_keeping", "scene": file, "distance_m": 50.0},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    lease = Lease(1, 1, "", expand(campaign)[0])
    stage = stage_of(lease, np.zeros((0, 5)), 0, None)
    assert stage.lane_width_m == pytest.approx(3.0)
    assert len(stage.lane) == len(stage.lane_z_m) > 30
    for (x_m, y_m, _), z_m in zip(stage.lane, stage.lane_z_m, strict=True):
        angle = np.arctan2(x_m, 100.0 - y_m)
        assert z_m == pytest.approx(4.0 + 0.02 * 100.0 * angle, abs=0.01)
        assert np.hypot(x_m, 100.0 - y_m) == pytest.approx(101.5, abs=0.002)
    file = write(tmp_path, STRAIGHT)
    flat = stage_of(lease, np.zeros((0, 5)), 0, None)
    assert flat.lane_z_m == []


def test_left_hand_traffic_starts_on_the_other_side(tmp_path):
    name = write(tmp_path, xodr(road(100.0, attributes='rule="LHT"')))
    assert build_world(load_scene(name)).lane.at(0.0).y_m == pytest.approx(1.75)


def test_a_scene_file_has_roads_and_counts_their_content(tmp_path):
    write(tmp_path, STRAIGHT)
    path = tmp_path / "with-road.yaml"
    path.write_text("schema: 1\nscene: with-road\nstreet: false\nopendrive: own.xodr\n")
    assert lowest(str(path)) < 0.0
    before = asset_digest(path)
    write(tmp_path, xodr(road(90.0)))
    assert asset_digest(path) != before


def test_another_content_under_the_same_name_is_another_world(tmp_path):
    name = write(tmp_path, STRAIGHT)
    assert is_path("own.xodr")
    digest = asset_digest(Path(name))
    first = build_world(load_scene(name)).mesh.points_m[:, 0].max()
    write(tmp_path, xodr(road(300.0)))
    assert asset_digest(Path(name)) != digest
    assert build_world(load_scene(name)).mesh.points_m[:, 0].max() > first + 100.0


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"<OpenDRIVE>", "own.xodr"),
        (xodr(road(lanes=section(left="", right=lane(-1, kind="sidewalk")))), "no driving lane"),
        (xodr(road(plan=geometry(LINE, 100.0, at=(2e4, 0.0, 0.0)))), "from the origin"),
    ],
)
def test_a_road_that_cannot_be_a_scene_is_one_line(tmp_path, data, words):
    name = write(tmp_path, data)
    findings = check_scenes([Variant(name, {})])
    assert len(findings.mistakes) == 1
    assert words in findings.mistakes[0]
    assert "\n" not in findings.mistakes[0]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("opendrive: own.xodr\n", "street: false"),
        ("street: false\nopendrive: own.xodr\nobstacle: {x_m: 3}\n", "obstacle"),
        ("street: false\nopendrive: gone.xodr\n", "gone.xodr"),
    ],
)
def test_scene_files_with_roads_that_contradict_themselves(tmp_path, more, words):
    write(tmp_path, STRAIGHT)
    path = tmp_path / "scene.yaml"
    path.write_text(f"schema: 1\nscene: odd\n{more}")
    findings = check_scenes([Variant(str(path), {})])
    assert len(findings.mistakes) == 1
    assert words in findings.mistakes[0]
