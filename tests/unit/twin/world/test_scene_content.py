"""The shipped district, and scenes of one's own: terrain, meshes, objects."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from road_files import xodr

from schemas.files.assets import asset_files
from schemas.messages import OBJECT_CLASSES, SEMANTIC_CLASSES
from twin.world.circuit import Arc, Segment
from twin.world.content import DRIVABLE, MaterialName, MeshFile, SceneObject, Terrain
from twin.world.meshes import materials
from twin.world.meshes.terrain import SAMPLES_MAX
from twin.world.scene import (
    Buildings,
    Furniture,
    Obstacle,
    Origin,
    Road,
    Scene,
    load_scene,
)
from twin.world.scenery import HouseRow, RoadScenery, TreeRow
from twin.world.street.build import build_world

BARE = "schema: 1\nscene: own\nstreet: false\nbake: false\nobstacle: {x_m: 60}\n"
HILL = "terrain: {heightmap: hill.npy, size_m: [200, 100], position_m: [10, 0, -1]}\n"


@pytest.fixture
def own(tmp_path):
    """Write a scene file and what it names; returns its path."""
    np.save(tmp_path / "hill.npy", np.ones((11, 21)))

    def write(text):
        path = tmp_path / "own.yaml"
        path.write_text(text)
        return str(path)

    return write


def mistake(path, expected):
    with pytest.raises(ValueError) as error:
        build_world(load_scene(path))
    assert expected in str(error.value), str(error.value)
    assert "\n" not in str(error.value)


def test_downtown_is_a_district():
    world = build_world(load_scene("downtown"))
    mesh = world.mesh
    assert 45_000 <= len(mesh.faces) <= 75_000
    names = {SEMANTIC_CLASSES[i] for i in np.unique(mesh.semantic)}
    assert names >= {"road", "marking", "sidewalk", "building", "vegetation", "pole", "lamp"}
    assert names >= {"traffic_sign", "car", "truck"}
    classes = [OBJECT_CLASSES[i] for i in world.static_classes]
    assert len(classes) == world.instances
    assert classes[0] == "car"
    assert set(classes[: world.cars]) == {"car", "truck"}
    assert set(classes[world.cars :]) == {"traffic_sign"}
    assert {OBJECT_CLASSES[i] for i in world.mover_classes} >= {"pedestrian", "bus", "bicycle"}
    assert world.motion.count == len(world.mover_classes) >= 9
    # Every object's pixels are of its class; collider i stands where instance i does.
    for instance, name in enumerate(classes):
        own = mesh.instance == instance
        assert {SEMANTIC_CLASSES[i] for i in mesh.semantic[own]} == {name}
    for instance, (x, y, *_, length, width) in enumerate(world.colliders[: world.cars]):
        points = mesh.points_m[mesh.faces[mesh.instance == instance]].reshape(-1, 3)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        np.testing.assert_allclose(centre[:2], [x, y], atol=0.12)
        assert np.ptp(points[:, 0]) == pytest.approx(2 * length, abs=0.25)
        assert np.ptp(points[:, 1]) == pytest.approx(2 * width, abs=0.42)  # mirrors


def test_faces_have_area_and_moderate_shape():
    mesh = build_world(load_scene("downtown")).mesh
    corners = mesh.points_m[mesh.faces].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.linalg.norm(cross, axis=1) > 1e-9).mean() > 0.999
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert np.quantile(longest, 0.95) < 12.0
    assert np.quantile(longest, 0.99) < 26.0
    assert longest.max() < 60.0


@pytest.mark.slow
def test_the_seed_changes_the_street_and_the_bake_only_the_light():
    scene = replace(load_scene("downtown"), bake=False)
    plain, other = build_world(scene), build_world(replace(scene, seed=12))
    baked = build_world(replace(scene, bake=True))
    assert plain.mesh.points_m.tobytes() == baked.mesh.points_m.tobytes()
    assert plain.mesh.points_m.shape != other.mesh.points_m.shape
    assert plain.mesh.ambient.min() == 1.0
    assert baked.mesh.ambient.min() == 0.0
    assert plain.obstacle_rear_m == other.obstacle_rear_m


def test_a_world_of_terrain_and_meshes(own, tmp_path):
    trimesh.creation.box((2.0, 4.0, 6.0)).export(tmp_path / "box.stl")
    text = BARE + HILL + "meshes:\n  - {file: box.stl, position_m: [30, 5, 3], solid: true, "
    text += "rotation_deg: [0, 0, 90], semantic: wall, material: brick, color: [0.4, 0.2, 0.1], "
    text += "object_class: traffic_sign}\n"
    path = own(text)
    world = build_world(load_scene(path))
    mesh = world.mesh
    ground = mesh.semantic == SEMANTIC_CLASSES.index("terrain")
    assert ground.sum() == 2 * 10 * 20
    corners = mesh.points_m[mesh.faces[ground]]
    np.testing.assert_allclose(corners[..., 2], 0.0)
    np.testing.assert_allclose(corners.reshape(-1, 3).max(axis=0), [110, 50, 0])
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (up > 0).all()
    np.testing.assert_allclose(world.colliders[1], [30, 5, np.pi / 2, 1.0, 2.0], atol=1e-6)
    box = mesh.instance == 1
    points = mesh.points_m[mesh.faces[box]].reshape(-1, 3)
    np.testing.assert_allclose(points.min(axis=0), [28, 4, 0], atol=1e-6)
    assert set(mesh.material[box]) == {materials.BRICK}
    assert world.instances == 2
    assert world.cars == 1
    assert {p.name for p in asset_files(Path(path))} == {"own.yaml", "box.stl", "hill.npy"}


def test_gltf_is_y_up_unless_the_scene_says_otherwise(own, tmp_path):
    trimesh.creation.box((1.0, 8.0, 2.0)).export(tmp_path / "tower.glb")
    for up, tall in (("", 2), (", up: z", 1)):
        path = own(BARE + HILL + "meshes: [{file: tower.glb, semantic: pole" + up + "}]\n")
        mesh = build_world(load_scene(path)).mesh
        own_faces = mesh.semantic == SEMANTIC_CLASSES.index("pole")
        size = np.ptp(mesh.points_m[mesh.faces[own_faces]].reshape(-1, 3), axis=0)
        assert size[tall] == pytest.approx(8.0)


def test_heights_of_a_picture(own, tmp_path):
    picture = np.zeros((3, 5), np.uint16)
    picture[0, 4] = 65535  # upper right: largest x, largest y
    cv2.imwrite(str(tmp_path / "hill.png"), picture)
    line = "terrain: {heightmap: hill.png, size_m: [8, 4], height_m: 12, position_m: [0, 0, 1]}\n"
    mesh = build_world(load_scene(own(BARE + line))).mesh
    top = mesh.points_m[mesh.points_m[:, 2].argmax()]
    np.testing.assert_allclose(top, [4, 2, 13])


def test_textured_meshes_bring_images(own, tmp_path):
    image = np.full((8, 8, 3), (10, 120, 240), np.uint8)
    cv2.imwrite(str(tmp_path / "t.png"), image[..., ::-1])
    (tmp_path / "t.mtl").write_text("newmtl t\nmap_Kd t.png\n")
    obj = (
        "mtllib t.mtl\nv 0 0 0\nv 2 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl t\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "t.obj").write_text(obj)
    path = own(BARE + HILL + "meshes: [{file: t.obj}, {file: t.obj, color: [1, 0, 0]}]\n")
    world = build_world(load_scene(path))
    assert len(world.textures) == 1
    assert (world.textures[0] == (10, 120, 240)).all()
    textured = world.mesh.texture == 0
    assert textured.sum() == 1
    assert (world.mesh.color[textured] == 1.0).all()  # what the image is multiplied with
    np.testing.assert_allclose(
        world.mesh.uv[world.mesh.faces[textured][0]], [[0, 0], [1, 0], [0, 1]]
    )
    wanted = {"own.yaml", "t.obj", "t.mtl", "t.png", "hill.npy"}
    assert {p.name for p in asset_files(Path(path))} == wanted


def test_mistakes_in_own_scenes(own, tmp_path):
    mistake(own(BARE), "street: false needs other ground: terrain, or a mesh with semantic road")
    mistake(own(BARE + HILL.replace("hill", "gone")), "gone.npy: No such file")
    mistake(own(BARE + HILL.replace("size_m", "size")), "terrain.size: unknown key")
    mistake(own(BARE + HILL + "meshes: [{file: gone.glb}]\n"), "meshes[0]: ")
    mistake(own(BARE + HILL + "meshes: [{file: a.glb, semantic: tree}]\n"), "meshes[0].semantic")
    mistake(own(BARE + HILL + "objects: [{kind: horse, waypoints: [[0, 0]]}]\n"), "objects[0].kind")
    twice = "objects: [{kind: car, waypoints: [[0, 0], [0, 0]], speed_mps: 1}]\n"
    mistake(own(BARE + HILL + twice), "objects[0] (car): waypoints 1 and 2 are at the same place")
    np.save(tmp_path / "hill.npy", np.array([[0.0, np.nan], [0.0, 0.0]]))
    mistake(own(BARE + HILL), "holds NaN")
    np.save(tmp_path / "hill.npy", np.zeros((2, SAMPLES_MAX + 1), np.float32))
    mistake(own(BARE + HILL), f"allowed 2 to {SAMPLES_MAX} each way")
    np.save(tmp_path / "hill.npy", np.zeros(5))
    mistake(own(BARE + HILL), "needed two axes of numbers")
    (tmp_path / "hill.npy").write_bytes(b"noise")
    mistake(own(BARE + HILL), "not an NPY file")
    (tmp_path / "hill.png").write_bytes(b"noise")
    mistake(own(BARE + HILL.replace("npy", "png")), "not a PNG file")
    trimesh.creation.box((2.0, 1.0, 1.0)).export(tmp_path / "far.stl")
    np.save(tmp_path / "hill.npy", np.ones((2, 2)))
    mistake(own(BARE + HILL + "meshes: [{file: far.stl, scale: 10000}]\n"), "set scale")


def test_names_in_scene_files_are_those_of_the_tables():
    assert set(MaterialName.__args__) == set(materials.NAMES)
    assert set(DRIVABLE) <= set(SEMANTIC_CLASSES)


def test_the_examples_of_the_page_work(tmp_path):
    page = Path(__file__).parents[4] / "docs/scene.md"
    town, around, example = re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
    (tmp_path / "around.yaml").write_text(around)
    lane = load_scene(str(tmp_path / "around.yaml")).road.lane()
    assert lane.closed
    assert lane.length_m == pytest.approx(333.397 + np.pi * (25 + 100 / 3 + 40), abs=1e-6)
    (tmp_path / "scan").mkdir()
    for name in ("road.glb", "hall.glb", "scan/yard.ply"):
        trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / name)
    cv2.imwrite(str(tmp_path / "hills.png"), np.zeros((16, 16), np.uint16))
    (tmp_path / "town.xodr").write_bytes(xodr())
    (tmp_path / "town.yaml").write_text(town)
    names = [thing.name for thing in build_world(load_scene(str(tmp_path / "town.yaml"))).things]
    assert {"house 1", "tree 16", "hall"} <= set(names)
    path = tmp_path / "yard.yaml"
    path.write_text(example)
    world = build_world(load_scene(str(path)))
    assert world.instances == 1
    assert len(world.colliders) == 2
    walker = world.motion.at(np.array([2.5, 3.0, 6.0, 8.0])).position_m[:, 0, 1]
    assert walker[0] == walker[1] == -3.5
    assert -1.0 < walker[2] < 1.0 < walker[3]


def test_the_page_names_every_key():
    page = (Path(__file__).parents[4] / "docs/scene.md").read_text()
    for type_ in (
        Scene,
        Obstacle,
        Road,
        Segment,
        Arc,
        Buildings,
        Furniture,
        Origin,
        SceneObject,
        MeshFile,
        Terrain,
        RoadScenery,
        HouseRow,
        TreeRow,
    ):
        for key in type_.__struct_fields__:
            assert f"`{key}`" in page or f"{key}:" in page, key


def test_a_scene_without_ground_is_one_line(own):
    text = BARE + HILL.replace("}\n", ", semantic: building}\n")
    mistake(own(text), "street: false needs other ground")
