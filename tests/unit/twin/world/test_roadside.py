"""What stands beside OpenDRIVE roads in a world: faces, hulls, names, signs and lights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import WIDTH, geometry, lane, section
from road_furniture import repeat, road_object, road_signal, with_furniture

from schemas.messages import OBJECT_CLASSES, SEMANTIC_CLASSES
from twin.road.opendrive.reading.reader import read_network
from twin.vehicle.ground import drivable
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL
from twin.world.roadside.plates import limit_text, picture_of
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world


@pytest.fixture
def world_of(tmp_path):
    def build(objects: str = "", signals: str = "", **more: object) -> World:
        path = tmp_path / "beside.xodr"
        path.write_bytes(with_furniture(objects, signals, **more))
        return build_world(load_scene(str(path)))

    return build


def points_of(world: World, semantic: str) -> np.ndarray:
    """Corners of the faces of a class [N, 3]."""
    faces = world.mesh.faces[world.mesh.semantic == SEMANTIC_CLASSES.index(semantic)]
    return world.mesh.points_m[np.unique(faces)]


def test_a_box_has_its_faces_and_its_hull_where_the_file_says(world_of):
    box = road_object("obstacle", 40, 5, length=4, width=2, height=3, hdg=0.5 * math.pi, name="hut")
    world = world_of(box)
    points = points_of(world, "unlabelled")
    assert points.min(axis=0) == pytest.approx((39.0, 3.0, 0.0), abs=1e-4)
    assert points.max(axis=0) == pytest.approx((41.0, 7.0, 3.0), abs=1e-4)
    assert world.colliders == pytest.approx(np.array([(40.0, 5.0, 0.5 * math.pi, 2.0, 1.0)]))
    assert [thing.words for thing in world.things] == ["'hut' (unlabelled)"]
    assert world.cars == world.instances == 0


def test_a_leaning_box_leans(world_of):
    box = road_object("obstacle", 40, 5, length=4, width=2, height=3, pitch=0.1)
    low, high = (f(points_of(world_of(box), "unlabelled"), axis=0) for f in (np.min, np.max))
    c, s = math.cos(0.1), math.sin(0.1)
    assert low == pytest.approx((40 - 2 * c, 4.0, -2 * s), abs=1e-4)
    assert high == pytest.approx((40 + 2 * c + 3 * s, 6.0, 2 * s + 3 * c), abs=1e-4)


def test_the_kind_decides_what_is_solid(world_of):
    kinds = ["pole", "tree", "building", "vegetation", "patch", "none", "trafficIsland"]
    text = "".join(
        road_object(kind, 10 + 10 * k, 6, id=k, length=2, width=2, height=3, name=kind)
        for k, kind in enumerate(kinds)
    )
    world = world_of(text)
    assert [thing.name for thing in world.things] == ["pole", "tree", "building"]
    high = road_object("gantry", 50, 0, length=0.5, width=12, height=6)
    over = road_object("obstacle", 50, 0, length=2, width=2, height=1, zOffset=4, id=2)
    island = road_object("trafficIsland", 20, 0, length=4, width=1, height=0.15, id=3)
    hulls = world_of(high + over + island).colliders
    assert hulls[:, 1] == pytest.approx([-5.75, 5.75]), "its posts alone"


def test_wheels_roll_on_an_island(world_of):
    world = world_of(road_object("trafficIsland", 20, 0, length=4, width=1, height=0.15))
    on_top = points_of(world, "sidewalk")
    assert on_top[:, 2].max() == pytest.approx(0.15, abs=1e-4)
    before = len(drivable(world_of(), wp.get_device("cpu")).kernel.grip)
    assert len(drivable(world, wp.get_device("cpu")).kernel.grip) > before


@pytest.mark.parametrize("subtype", ["guardRail", "jerseyBarrier", "wall", ""])
def test_a_barrier_is_as_high_and_wide_as_it_says(world_of, subtype):
    row = repeat(10, 40, 0, tStart=-5, tEnd=-5, heightStart=0.75, widthStart=0.3)
    world = world_of(road_object("barrier", 0, 0, row, subtype=subtype))
    points = points_of(world, "wall")
    assert points.min(axis=0)[:2] == pytest.approx((10.0, -5.15), abs=1e-4)
    assert points.max(axis=0) == pytest.approx((50.0, -4.85, 0.75), abs=1e-4)
    assert len(world.colliders) == 4, "pieces of at most 12 m"
    assert world.colliders[:, 1:3] == pytest.approx(np.array([(-5.0, 0.0)] * 4))
    assert world.colliders[:, 3].sum() * 2 == pytest.approx(40.0)
    assert world.colliders[:, 4] == pytest.approx(0.15)
    assert {(thing.hull, thing.hulls) for thing in world.things} == {(k, 4) for k in range(1, 5)}


def test_paint_is_seen_and_not_stood_on(world_of):
    world = world_of(road_object("crosswalk", 50, 0, length=4, width=7))
    mark = world.mesh.semantic == SEMANTIC_CLASSES.index("marking")
    assert (world.mesh.tag[mark] == DECAL).all()
    assert (world.mesh.material[mark] == materials.PAINT).all()
    assert points_of(world, "marking")[:, 2] == pytest.approx(0.006, abs=1e-4)
    assert not len(world.colliders)


def test_a_tree_is_as_tall_as_it_says_and_the_same_every_time(world_of):
    text = road_object("tree", 50, -9, height=8, radius=2)
    one, other = world_of(text), world_of(text)
    points = points_of(one, "vegetation")
    assert points[:, 2].max() == pytest.approx(8.0, abs=1.3)
    assert np.hypot(*(points[:, :2] - (50.0, -9.0)).T).max() < 3.5
    assert np.array_equal(one.mesh.points_m, other.mesh.points_m)
    assert one.colliders[0, :2] == pytest.approx((50.0, -9.0))


def test_street_lamps_reach_over_the_road_and_light_it(world_of):
    row = repeat(10, 60, 30, tStart=6, tEnd=6, heightStart=7)
    other = road_object("streetLamp", 20, -6, height=7, id=2)
    world = world_of(road_object("streetLamp", 0, 0, row) + other)
    assert world.lamps == pytest.approx(
        np.array([(10.0, 4.1), (40.0, 4.1), (70.0, 4.1), (20.0, -4.1)])
    )
    lamps = points_of(world, "lamp")
    assert np.abs(lamps[:, 1]).max() < 5.0
    assert len(world.colliders) == 4


def test_a_sign_faces_the_traffic_it_is_for(world_of):
    signs = road_signal("274", 30, -5, value=70, height=0.7, width=0.7)
    signs += road_signal("206", 60, 5, orientation="-", id=2)
    world = world_of(signals=signs)
    assert world.instances == 2
    assert [OBJECT_CLASSES[k] for k in world.static_classes] == ["traffic_sign"] * 2
    for instance, (x, y, facing) in enumerate(((30.0, -5.0, -1.0), (60.0, 5.0, 1.0))):
        corners = world.mesh.points_m[world.mesh.faces[world.mesh.instance == instance]]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        assert (low + high)[1] / 2 == pytest.approx(y, abs=1e-4)
        assert low[2] == pytest.approx(2.0, abs=1e-3)
        assert low[0] > x - 0.06
        assert high[0] < x + 0.06
        assert x == pytest.approx(low[0] if facing > 0 else high[0], abs=1e-4)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 0]
        sheets = world.mesh.material[world.mesh.instance == instance] == materials.SIGN
        assert sheets.any()
        assert (np.sign(normals[sheets]) == facing).all()
        assert (np.sign(normals[~sheets]) == -facing).all(), "its back"
    assert np.ptp(world.mesh.points_m[world.mesh.faces[world.mesh.instance == 0]], axis=(0, 1))[
        1:
    ] == pytest.approx((0.7, 0.7), abs=0.02)
    assert world.colliders[:, :2] == pytest.approx(np.array([(30.06, -5.0), (59.94, 5.0)])), (
        "posts are behind"
    )


def test_a_turned_sign_on_a_curve(world_of):
    bend = geometry('<arc curvature="0.02"/>', 100.0)
    world = world_of(
        signals=road_signal("306", 25 * math.pi, -4, hOffset=0.25 * math.pi), plan=bend
    )
    x, y, yaw = world.colliders[0, :3]
    behind = 0.06 * math.sqrt(0.5)
    assert (x, y) == pytest.approx((54.0 - behind, 50.0 + behind), abs=1e-6)
    assert yaw == pytest.approx(0.75 * math.pi, abs=1e-6)


def test_signs_on_one_post_share_it(world_of):
    pair = road_signal("274", 30, -5, value=50) + road_signal("276", 30, -5, id=2, zOffset=2.7)
    world = world_of(signals=pair)
    assert len(world.colliders) == 1
    assert points_of(world, "pole")[:, 2].max() == pytest.approx(3.3, abs=1e-3)


def test_a_light_has_a_lens_for_every_lamp(world_of):
    lights = road_signal("1000001", 50, -5, id="a", dynamic="yes", country="OpenDRIVE")
    lights += road_signal("1000002", 50, 5, id="b", dynamic="yes", orientation="-")
    world = world_of(signals=lights)
    assert world.signals == ("a", "b")
    assert world.instances == 0
    lens = world.mesh.material == materials.SIGNAL_LAMP
    assert np.unique(world.mesh.tag[lens]).tolist() == [0, 1, 2, 8, 10]
    height = []
    for tag in range(3):
        faces = world.mesh.faces[lens & (world.mesh.tag == tag)]
        rim = world.mesh.points_m[np.unique(faces)][:, 2]
        height.append(0.5 * (rim.min() + rim.max()))
    assert height[0] - height[1] == pytest.approx(0.32, abs=1e-3)
    assert height[1] - height[2] == pytest.approx(0.32, abs=1e-3)
    assert height[1] == pytest.approx(2.48, abs=1e-3)
    red = world.mesh.color[lens & (world.mesh.tag == 0)]
    assert (red[:, 0] > 5 * red[:, 1]).all()


def test_a_light_above_a_lane_hangs_from_a_mast_beside_the_road(world_of):
    wide = section(left=lane(1), right=lane(-1) + lane(-2, WIDTH, "shoulder"))
    light = road_signal("1000001", 50, -0.5, zOffset=5, dynamic="yes")
    world = world_of(signals=light, lanes=wide)
    assert world.colliders[0, :2] == pytest.approx((50.25, 4.0), abs=1e-6), "the nearer side"
    lens = world.mesh.points_m[world.mesh.faces[world.mesh.material == materials.SIGNAL_LAMP]]
    assert lens[..., 1].min() + lens[..., 1].max() == pytest.approx(-1.0, abs=1e-3)
    low = replace_z(light, 0.2)
    assert world_of(signals=low, lanes=wide).colliders[0, 1] == pytest.approx(-0.5)


def replace_z(text: str, z_m: float) -> str:
    return text.replace('zOffset="5"', f'zOffset="{z_m}"')


def test_stop_lines_and_arrows_have_no_post(world_of):
    world = world_of(signals=road_signal("294", 30, -2) + road_signal("297", 40, -2, id=2))
    assert not len(world.colliders)
    assert world.instances == 0


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"value": 80}, "80"),
        ({"value": 22.2222, "unit": "m/s"}, "80"),
        ({"value": -1, "subtype": "30"}, "30"),
        ({"value": -1, "subtype": "55"}, "50"),
        ({"value": -1, "subtype": "63"}, "130"),
        ({"value": -1, "subtype": "120"}, "120"),
        ({"value": -1, "text": "Tempo 60"}, "60"),
        ({"value": 1e9}, ""),
        ({"value": -1, "subtype": "x7"}, ""),
    ],
)
def test_numbers_of_speed_limits(more, text):
    network = read_network(with_furniture("", road_signal("274", 5, -5, **more)), "t.xodr")
    signal = network.roads["0"].signals[0]
    assert limit_text(signal) == text
    assert len(picture_of(signal).sheets) == (2 + bars_of(text) if text else 2)


def bars_of(text: str) -> int:
    counts = {"0": 6, "1": 2, "2": 5, "3": 5, "5": 5, "6": 6, "8": 7}
    return sum(counts[digit] for digit in text)


@pytest.mark.parametrize(
    ("kind", "sheets"), [("205", 2), ("R1-2", 2), ("306", 2), ("267", 3), ("274-70", 11), ("X", 2)]
)
def test_pictures_by_type(kind, sheets):
    network = read_network(with_furniture("", road_signal(kind, 5, -5)), "t.xodr")
    picture = picture_of(network.roads["0"].signals[0])
    assert len(picture.sheets) == sheets
    for sheet in picture.sheets:
        assert sheet.outline.shape[1] == 2


def test_a_plate_that_is_not_known_has_the_size_of_the_file():
    network = read_network(
        with_furniture("", road_signal("999", 5, -5, width=1.5, height=0.5)), "t.xodr"
    )
    signal = network.roads["0"].signals[0]
    assert picture_of(signal).size_m == pytest.approx((1.5, 0.5))
    assert picture_of(replace(signal, width_m=0.0)).size_m == pytest.approx((0.6, 0.6))


def test_the_shipped_junction_has_its_lights():
    world = build_world(load_scene("junction"))
    assert len(world.signals) == 8
    lens = world.mesh.points_m[world.mesh.faces[world.mesh.material == materials.SIGNAL_LAMP]]
    hanging = lens[lens[..., 2].min(axis=1) > 4.0]
    # The arm from the west ends 16 m before the middle; its lights are 1 m before that, at y 0.
    west = hanging[hanging[..., 0].mean(axis=1) < -16.0]
    assert west[..., 1].min() == pytest.approx(-west[..., 1].max(), abs=1e-3)
    assert west[..., 0].mean() == pytest.approx(-17.0 - 0.5 * 0.4 * 0.3 - 0.01, abs=1e-3)


def test_a_signal_that_is_too_far_away_is_one_line(world_of):
    with pytest.raises(ValueError, match=r"beside\.xodr:\d+: <signal>: it lies more than") as error:
        world_of(signals=road_signal("206", 5, 1e8))
    assert "\n" not in str(error.value)
