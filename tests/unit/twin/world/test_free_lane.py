"""Scenes without an obstacle: nothing to collide with ahead, so distances to it are missing."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.wire.control import Lease
from twin.rig.engine import Engine
from twin.view.samples import stage_of
from twin.world.scene import load_scene
from twin.world.street.build import build_world

STREET = {"schema": 1, "scene": "free", "bake": False}
YARD = {**STREET, "street": False, "terrain": {"heightmap": "flat.npy", "size_m": [400, 200]}}


@pytest.fixture(params=[STREET, YARD], ids=["street", "yard"])
def scene(request, tmp_path):
    """Path of a scene file without an obstacle."""
    np.save(tmp_path / "flat.npy", np.zeros((8, 8)))
    path = tmp_path / "free.yaml"
    path.write_text(yaml.safe_dump(request.param))
    return str(path)


def case_of(scene, **scenario):
    campaign, mistakes = parse_campaign(
        {
            "campaign": "free",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {"scene": scene, "ego_speed_mps": 8.0, "duration_s": 1.0, **scenario},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


def driven(one):
    """How the case ends for an ego that rolls."""
    engine = Engine(one, 1)
    engine.reset(0, one)
    while True:
        engine.sense()
        for ended in engine.step([Command(0, 0, int(engine.tick[0]), 0.0, 0.0, 0.0)]):
            return ended


def test_distances_to_nothing_are_missing_and_never_zero(scene):
    ended = driven(case_of(scene))
    rows = ended.table.to_lists()
    assert len(rows["tick"]) == 21
    assert set(rows["dtc_m"]) == set(rows["ttc_s"]) == {None}
    missing = ("dtc_min_m", "dtc_end_m", "aeb_dtc_m", "aeb_ttc_s", "impact_speed_mps")
    assert [ended.scalars[name] for name in missing] == [None] * len(missing)
    assert ended.scalars["speed_max_mps"] == pytest.approx(8.0, abs=0.1)
    assert (rows["x_m"][0], rows["y_m"][0]) == (-70.0, 0.0), "it starts where the lane begins"


def test_a_lane_without_an_obstacle_can_be_kept(tmp_path):
    path = tmp_path / "free.yaml"
    path.write_text(yaml.safe_dump(STREET))
    ended = driven(case_of(str(path), type="lane_keeping", distance_m=5))
    assert (ended.verdict, ended.scalars["dtc_end_m"]) == ("pass", None)


def test_objects_are_numbered_from_the_first_parked_car(tmp_path):
    path = tmp_path / "free.yaml"
    path.write_text(yaml.safe_dump({**STREET, "furniture": {"parked_cars": 1.0}}))
    world = build_world(load_scene(str(path)))
    assert world.obstacle is None
    assert world.cars > 10
    for instance, (x_m, y_m, *_) in enumerate(world.colliders[: world.cars]):
        points = world.mesh.points_m[world.mesh.faces[world.mesh.instance == instance]]
        centre = (points.min(axis=(0, 1)) + points.max(axis=(0, 1))) / 2
        np.testing.assert_allclose(centre[:2], [x_m, y_m], atol=0.12)


def test_the_street_of_a_recording_has_no_obstacle(tmp_path):
    path = tmp_path / "free.yaml"
    path.write_text(yaml.safe_dump(STREET))
    one = case_of(str(path))
    world = build_world(load_scene(str(path)))
    stage = stage_of(Lease(1, 1, "", one), world.colliders, world.cars, world.obstacle)
    assert stage.obstacle_center_m == []
    assert len(stage.hulls) == len(world.colliders)
    assert stage.cars == world.cars
