"""Scene and vehicle files: shipped ones load, mistakes are one clear line."""

import numpy as np
import pytest
from msgspec.structs import replace

from twin.vehicle.vehicle_file import load_vehicle
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import load_scene
from twin.world.street.build import build_world
from twin.world.street.layout import lay_out
from twin.world.street.sidewalks import add_lamps


def one_line(error):
    text = str(error.value)
    assert "\n" not in text
    return text


def test_shipped_files_load():
    assert load_scene("downtown").scene == "downtown"
    vehicle = load_vehicle("opencav")
    assert (vehicle.wheelbase_m, vehicle.track_m) == (3.09, 1.734)
    assert vehicle.front_offset_m == pytest.approx(vehicle.length_m - vehicle.rear_overhang_m)


@pytest.mark.parametrize("load", [load_scene, load_vehicle])
def test_unknown_names_list_what_is_shipped(load):
    with pytest.raises(ValueError, match="not shipped; give one of") as error:
        load("nowhere")
    one_line(error)
    with pytest.raises(ValueError, match="No such file"):
        load("no/such.yaml")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("schema: 1\nobstacle: {x_m: 250}\n", "scene: missing"),
        ("schema: 1\nscene: a\nobstacle: {x_m: 250}\nroads: {}\n", "roads: unknown key"),
        ("schema: 1\nscene: a\nobstacle: {x_m: far}\n", "obstacle.x_m"),
        ("schema: 1\nscene: a\nobstacle: {x_m: 10}\n", "200 m of street"),
        ("schema: 2\nscene: a\nobstacle: {x_m: 250}\n", "schema"),
        ("schema: [1\n", "scene.yaml:2:1"),
        (
            "schema: 1\nscene: a\nobstacle: {x_m: 250}\nbuildings: {height_m: [9, 5]}\n",
            "smallest 9 above largest 5",
        ),
        (
            "schema: 1\nscene: a\nobstacle: {x_m: 250}\nroad: {start_m: 50, end_m: 50}\n",
            "end_m 50 must lie behind start_m 50",
        ),
    ],
)
def test_mistakes_in_a_scene_file(tmp_path, text, expected):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        load_scene(str(path))
    assert expected in one_line(error)
    assert "scene.yaml" in str(error.value)


def test_mistakes_in_a_vehicle_file(tmp_path):
    path = tmp_path / "car.yaml"
    shipped = load_vehicle.__globals__["_MODELS"] / "opencav.yaml"
    text = shipped.read_text()
    path.write_text(text.replace("mass_kg: 42.0", "mass_kg: -1"))
    with pytest.raises(ValueError, match=r"mass_kg: given -1, allowed: a number > 0"):
        load_vehicle(str(path))
    path.write_text(text.replace("length_m: 5.17", "length_m: 3.0"))
    with pytest.raises(ValueError, match="longer than length_m"):
        load_vehicle(str(path))


def test_the_street_is_what_the_scene_says():
    scene = load_scene("downtown")
    world = build_world(scene)
    mesh = world.mesh
    assert world.obstacle_rear_m == scene.obstacle.x_m
    assert world.obstacle_rear_m - 180.0 - 5.0 > scene.road.start_m
    assert set(mesh.instance.tolist()) == set(range(-1, world.instances))
    obstacle = mesh.points_m[mesh.faces[mesh.instance == 0]].reshape(-1, 3)
    body = obstacle[obstacle[:, 2] > 0.1]  # without the shade below the car
    assert body[:, 0].min() == pytest.approx(scene.obstacle.x_m, abs=0.02)
    again = build_world(scene)
    assert again.mesh.points_m.tobytes() == mesh.points_m.tobytes()
    assert again.colliders.tobytes() == world.colliders.tobytes()
    # Nothing but the obstacle stands in the ego's lane.
    lane = 1.0
    in_lane = abs(world.colliders[:, 1]) - world.colliders[:, 4] < lane
    x = world.colliders[:, 0]
    before_end = (x > scene.road.start_m) & (x < scene.road.end_m)
    assert (in_lane & before_end).sum() == 1


@pytest.mark.parametrize(("spacing_m", "counts"), [(28.0, (15, 14)), (900.0, (1, 0))])
def test_rows_of_lamps_may_be_empty(spacing_m, counts):
    scene = load_scene("downtown")
    scene = replace(scene, bake=False, furniture=replace(scene.furniture, lamp_spacing_m=spacing_m))
    rows, posts = add_lamps(MeshBuilder(), scene, lay_out(scene))
    assert [row.shape for row in rows] == [(count, 2) for count in counts]
    assert len(posts) <= sum(counts)
    world = build_world(scene)
    assert np.isfinite(world.mesh.points_m).all()
    near = [abs(y_m) < 20.0 for _, y_m in (world.lamps_right, world.lamps_left)]
    assert near == [count > 0 for count in counts]
