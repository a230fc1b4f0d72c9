"""Wheels on terrain and on a mesh road of a scene of one's own, above the height of a kerb."""

import numpy as np
import pytest
import trimesh
import warp as wp

from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import drivable
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street.build import build_world

prepare_kernels()
CPU = wp.get_device("cpu")
HEAD = "schema: 1\nscene: own\nstreet: false\nbake: false\nobstacle: {x_m: 300, y_m: 0}\n"
HEIGHT_M = 2.0


def terrain(folder):
    """Level up to x = 20 m, a ramp of 20 m, level again at 2 m."""
    x = np.linspace(-50, 110, 161)
    row = HEIGHT_M * np.clip((x - 20.0) / 20.0, 0.0, 1.0)
    np.save(folder / "ramp.npy", np.tile(row, (9, 1)))
    return "terrain: {heightmap: ramp.npy, size_m: [160, 40], position_m: [30, 0, 0]}\n"


def mesh_road(folder):
    """The same as a road from a PLY file, with a roof above that is no ground."""
    x, z = np.array([-50.0, 20.0, 40.0, 110.0]), np.array([0.0, 0.0, HEIGHT_M, HEIGHT_M])
    points = np.array([(a, y, b) for a, b in zip(x, z, strict=True) for y in (-20.0, 20.0)])
    faces = [f for i in (0, 2, 4) for f in ((i, i + 2, i + 3), (i, i + 3, i + 1))]
    trimesh.Trimesh(points, faces, process=False).export(folder / "road.ply")
    roof = trimesh.creation.box((200.0, 40.0, 0.2))
    roof.apply_translation((0.0, 0.0, HEIGHT_M + 0.22))
    roof.export(folder / "roof.ply")
    return "meshes:\n  - {file: road.ply, semantic: road}\n  - {file: roof.ply, semantic: wall}\n"


@pytest.mark.parametrize("ground", [terrain, mesh_road])
def test_the_car_climbs_a_hill(tmp_path, ground):
    path = tmp_path / "own.yaml"
    path.write_text(HEAD + ground(tmp_path))
    world = build_world(load_scene(str(path)))
    fleet = Fleet([load_vehicle("opencav")], 1, CPU, ground=drivable(world, CPU))
    fleet.place(0, 0.0, 10.0, 0.85)
    fleet.active[0] = 1
    rows = []
    for k in range(80):
        fleet.commands[0, 0] = (0.6, 0.0, 0.0, 0.0, 1.0)
        fleet.first_step[0] = 50 * k
        fleet.advance(50)
        rows.append(fleet.state[0, 0].copy())
    rows = np.array(rows)
    x, z = rows[:, COLUMN["x_m"]], rows[:, COLUMN["z_m"]]
    assert x.max() > 60.0
    assert rows[:, COLUMN["fault"]].max() == 0.0
    np.testing.assert_allclose(z[x < 12.0], 0.0, atol=0.03)
    top = z[(x > 48.0) & (x < 100.0)]
    assert len(top) > 3
    np.testing.assert_allclose(top, HEIGHT_M, atol=0.1)
