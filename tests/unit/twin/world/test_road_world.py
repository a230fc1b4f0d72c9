"""A road network as a world: classes and materials of its surface."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import WIDTH, lane, road, section, xodr

from schemas.messages import SEMANTIC_CLASSES
from twin.vehicle.ground import drivable
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL
from twin.world.scene import load_scene
from twin.world.street.build import build_world


@pytest.fixture
def world(tmp_path):
    marked = WIDTH + '<roadMark sOffset="0" type="solid" color="red" width="0.2"/>'
    raised = WIDTH + '<height sOffset="0" inner="0.1" outer="0.1"/>'
    lanes = section(right=lane(-1, marked) + lane(-2, raised, "sidewalk") + lane(-3, WIDTH, "none"))
    path = tmp_path / "t.xodr"
    path.write_bytes(xodr(road(lanes=lanes)))
    return build_world(load_scene(str(path)))


def test_every_class_has_its_material(world):
    mesh = world.mesh
    looks = {
        (SEMANTIC_CLASSES[semantic], material, tag == DECAL)
        for semantic, material, tag in zip(
            mesh.semantic.tolist(), mesh.material.tolist(), mesh.tag.tolist(), strict=True
        )
    }
    assert looks == {
        ("road", materials.ASPHALT, False),
        ("sidewalk", materials.PAVING, False),
        ("sidewalk", materials.PLAIN, False),
        ("terrain", materials.GRASS, False),
        ("marking", materials.PAINT, True),
    }
    red = mesh.color[mesh.material == materials.PAINT]
    assert (red[:, 0] > 5.0 * red[:, 1]).all()


def test_wheels_stand_on_it_and_nothing_else_is_there(world):
    assert len(world.colliders) == world.instances == len(world.things) == 0
    assert world.obstacle is None
    drivable(world, wp.get_device("cpu"))
    assert np.isfinite(world.mesh.points_m).all()
