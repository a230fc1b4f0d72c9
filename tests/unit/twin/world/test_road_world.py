"""twin.world.roads: a road network as a world."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import WIDTH, lane, road, section, xodr

from schemas.messages import SEMANTIC_CLASSES
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.vehicle.ground import drivable
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL
from twin.world.roads import road_world


def world():
    marked = WIDTH + '<roadMark sOffset="0" type="solid" color="red" width="0.2"/>'
    raised = WIDTH + '<height sOffset="0" inner="0.1" outer="0.1"/>'
    lanes = section(right=lane(-1, marked) + lane(-2, raised, "sidewalk") + lane(-3, WIDTH, "none"))
    return road_world(RoadMap(read_network(xodr(road(lanes=lanes)), "t")))


def test_every_class_has_its_material():
    mesh = world().mesh
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


def test_wheels_stand_on_it_and_nothing_else_is_there():
    built = world()
    assert len(built.colliders) == built.instances == len(built.things) == 0
    assert built.obstacle is None
    drivable(built, wp.get_device("cpu"))
    assert np.isfinite(built.mesh.points_m).all()
