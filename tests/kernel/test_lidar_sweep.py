"""LiDAR motion, determinism, slots and the layout of the points."""

import numpy as np
import pytest
import warp as wp
from lidar_rigs import (
    CPU,
    INTENSITY,
    KIND,
    RANGE,
    SURFACE,
    TIME,
    X,
    Y,
    Z,
    directions,
    look,
    pose,
    profile,
    scan,
    sensor,
    wall,
    world,
    yawed,
)

from schemas.sections.lidar import POINT_COLUMNS, TRUTH_COLUMNS, Lidar
from twin.sensors.lidar import returns as lidar_return
from twin.sensors.lidar.lidar import LidarWeather, point_table
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.street.build import World

MOVING = Lidar(noise=False)
DESKEWED = Lidar(noise=False, deskew=True)


def swept(lidar, before, after, **changes):
    kind = profile(theta_min_deg=-60, theta_max_deg=60, range_10_percent_m=1000.0, **changes)
    eye = sensor(world(wall(40.0)), kind, lidar, position_m=(1.0, 0.2, 1.5))
    eye.reset(0, 1)
    scan(eye, before)
    return scan(eye, after)[0], kind


CASES = {
    "driving": (pose((0.0, 0.0, 0.0)), pose((2.0, 0.0, 0.0))),
    "turning": (pose(), pose((0.0, 0.0, 0.0), yawed(0.1))),
    "both": (
        pose((0.0, 0.0, 0.0), (0.01, 0.02, 0.0, 0.99975)),
        pose((1.5, 0.3, 0.05), (-0.01, 0.015, 0.05, 0.99858)),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_wall_is_bent_by_motion_and_flat_after_deskewing(name):
    before, after = (row.copy() for row in CASES[name])
    for row in (before, after):
        row[3:7] /= np.linalg.norm(row[3:7])

    def from_plane(points):
        """Distance of the points from the best plane [m]."""
        xyz = points[:, :3].astype(float)
        xyz -= xyz.mean(axis=0)
        normal = np.linalg.svd(xyz, full_matrices=False)[2][2]
        return np.abs(xyz @ normal).max()

    raw, _ = swept(MOVING, before, after)
    flat, _ = swept(DESKEWED, before, after)
    assert from_plane(raw) > 0.2
    assert from_plane(flat) < 0.01
    # In the axes at the tick: where the wall is now.
    x, y, z, w = after[3:7]
    forward = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    left = (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))
    up = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    rotation = np.array([forward, left, up])
    sensor_x = after[0] + (rotation @ (1.0, 0.2, 1.5))[0]
    world_x = sensor_x + (flat[:, :3] @ rotation.T)[:, 0]
    assert np.abs(world_x - 40.0).max() < 2e-3


def test_driving_shifts_a_point_by_speed_and_time():
    points, kind = swept(MOVING, pose((0.0, 0.0, 0.0)), pose((2.0, 0.0, 0.0)))
    assert points[:, TIME].max() == 0.0
    assert points[:, TIME].min() == pytest.approx(-0.1 * (1.0 - 1.0 / kind.columns), abs=1e-6)
    assert np.abs(points[:, X] - (40.0 - 3.0 - 20.0 * points[:, TIME])).max() < 1e-3


def test_the_first_sweep_and_one_without_motion_are_not_bent():
    for lidar, rows in ((MOVING, 1), (Lidar(noise=False, motion=False), 2)):
        eye = sensor(world(wall(40.0)), profile(), lidar)
        eye.reset(0, 1)
        for i in range(rows):
            points = scan(eye, pose((3.0 * i + 1.0, 0.0, 0.0)))[0]
        assert np.abs(points[:, X] - (40.0 - 3.0 * (rows - 1) - 1.0)).max() < 1e-3


def test_points_are_a_range_image_with_nan_where_nothing_came_back():
    kind = profile()
    near = [(20.0, 0.0, -50), (20.0, 50, -50), (20.0, 50, 50), (20.0, 0.0, 50)]  # left half
    eye = sensor(world(near), kind, Lidar(noise=False, motion=False, truth=True))
    points = look(eye)
    assert points.shape == (kind.channels * kind.columns, len(POINT_COLUMNS + TRUTH_COLUMNS))
    image = points.reshape(kind.channels, kind.columns, -1)
    left = np.array(kind.thetas_deg) > 0.01
    assert (image[:, left, KIND] == SURFACE).all()
    empty = image[:, np.array(kind.thetas_deg) < -0.01]
    assert np.isnan(empty[..., [X, Y, Z, RANGE]]).all()
    assert not empty[..., [INTENSITY, KIND]].any()
    assert (empty[..., -2:] == -1).all()
    assert image[0, -1, Z] > 0 > image[-1, -1, Z]  # channels from the top
    assert eye.pull()[1][0] == (points[:, KIND] > 0).sum()
    table = point_table(points, kind)
    assert len(table) == eye.pull()[1][0]
    rows = table["channel"].astype(int) * kind.columns + table["column"]
    assert np.array_equal(table["x_m"], points[rows, X])
    assert np.allclose(directions(kind)[rows, 2] * table["range_m"], table["z_m"], atol=1e-4)


FOGGY = LidarWeather(0.02, rain_mm_per_h=5.0, wetness=0.7)


def street(slots, lidar=None):
    """Ground, a wall and posts of several materials."""
    mesh = MeshBuilder()
    mesh.floor((-20, 180), (-40, 40), 0.0, materials.ASPHALT, (0.1, 0.1, 0.1))
    mesh.box((-20, 12, 0), (180, 16, 9), materials.FACADE, (0.5, 0.4, 0.3))
    for i, x in enumerate(range(30, 140, 9)):
        with mesh.place(float(x), -4.0 - i % 5, 0.3 * i, instance=i):
            mesh.box((-1, -0.6, 0), (1, 0.6, 1.6), materials.CAR_PAINT, (0.4, 0.1, 0.1))
    scene = World(mesh.build(), np.zeros((1, 5)), 13, (0.0, -5.0), (13.0, 8.0))
    kind = load_lidar_profile("spinning_16")
    return sensor(scene, kind, lidar or Lidar(truth=True), slots, position_m=(1.5, 0.0, 1.9))


def drive(eye, keys):
    """Two sweeps; slot s runs the case keys[s] (None: no case)."""
    rows = []
    for slot, key in enumerate(keys):
        if key is None:
            eye.clear(slot)
        else:
            eye.reset(slot, key, FOGGY if key % 2 else LidarWeather())
        x = 40.0 + 7.0 * (key or 0)
        rows.append((pose((x, 0.1, 0.0)), pose((x + 1.3, 0.2, 0.0), yawed(0.03))))
    scan(eye, *(r[0] for r in rows), tick=0)
    return scan(eye, *(r[1] for r in rows), tick=2), eye.pull()[1]


def test_the_same_bytes_in_any_slot_batch_and_company():
    four, count = drive(street(4), [1, 2, 3, 4])
    turned, turned_count = drive(street(4), [3, 1, 4, 2])
    gaps, _ = drive(street(5), [None, 4, None, 1, 7])
    alone, _ = drive(street(1), [3])
    order = [2, 0, 3, 1]
    assert four[order].tobytes() == turned.tobytes()
    assert count[order].tolist() == turned_count.tolist()
    assert gaps[1].tobytes() == four[3].tobytes()
    assert gaps[3].tobytes() == four[0].tobytes()
    assert alone[0].tobytes() == four[2].tobytes()
    assert four[0].tobytes() != four[1].tobytes()


def test_ticks_and_keys_give_new_noise_and_the_same_ones_the_same():
    eye = street(1)
    first = look(eye, FOGGY, key=5, tick=3)
    assert look(eye, FOGGY, key=5, tick=3).tobytes() == first.tobytes()
    assert look(eye, FOGGY, key=5, tick=4).tobytes() != first.tobytes()
    assert look(eye, FOGGY, key=6, tick=3).tobytes() != first.tobytes()


def test_a_cleared_slot_holds_zeros():
    eye = street(2)
    _, count = drive(eye, [1, 2])
    assert count.min() > 1000
    eye.clear(1)
    points = scan(eye, pose((50.0, 0.0, 0.0)))
    assert not points[1].any()
    assert eye.pull()[1].tolist()[1] == 0
    assert points[0].any()


def test_points_go_into_the_given_buffer():
    eye = street(1)
    buffer = np.zeros(eye.shape, np.float32)
    given = type(eye)(eye.profile, _mount(), eye.geometry, eye.lidar, buffer)
    given.reset(0, 3)
    scan(given, pose((60.0, 0.0, 0.0)))
    assert (buffer[0, :, KIND] == SURFACE).sum() == given.pull()[1][0]
    with pytest.raises(ValueError, match="points_out must be"):
        type(eye)(eye.profile, _mount(), eye.geometry, eye.lidar, buffer[:, 1:])


def _mount():
    from schemas.sections.lidar import LidarMount

    return LidarMount([1.5, 0.0, 1.9], profile="spinning_16")


def test_points_one_by_one_are_those_of_rows():
    """The kernel of GPUs against that of the CPU."""
    eye = street(2)
    points, count = drive(eye, [1, 4])
    again, number = wp.zeros_like(eye.points), wp.zeros_like(eye.count)
    constant = [eye._beams, eye._detector, eye._surfaces, eye._fog, eye._drops]
    state = [eye.air.device, eye._poses, eye._hits]
    wp.launch(
        lidar_return.return_kernel,
        eye.shape[:2],
        inputs=[eye.geometry.scene, *constant, *state],
        outputs=[again, number],
        device=CPU,
    )
    assert again.numpy().tobytes() == points.tobytes()
    assert number.numpy().tolist() == count.tolist()
