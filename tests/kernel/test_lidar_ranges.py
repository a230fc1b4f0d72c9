"""LiDAR ranges against closed forms and against an independent ray caster."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
import warp as wp
from lidar_rigs import (
    CPU,
    INSTANCE,
    KIND,
    QUIET,
    RANGE,
    SURFACE,
    TIME,
    X,
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

from schemas.sections.lidar import Lidar, LidarMount
from twin.actors.motion import ObjectKind, Placement
from twin.render.trace import bvh
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar import cast as lidar_cast
from twin.sensors.lidar.lidar import LidarSensor
from twin.world.meshes import materials
from twin.world.meshes.details import FaceDetails, FaceLook, Mask
from twin.world.meshes.mesh import MeshBuilder
from twin.world.street.build import World


def test_a_wall_is_at_its_distance_over_the_cosine():
    kind = profile()
    points = look(sensor(world(wall(30.0)), kind))
    expected = 30.0 / directions(kind)[:, 0]
    assert np.abs(points[:, RANGE] - expected).max() < 1e-4
    assert np.abs(points[:, X] - 30.0).max() < 1e-4
    assert np.allclose(points[:, :3], directions(kind) * expected[:, None], atol=1e-4)


def test_the_ground_is_at_the_height_over_the_sine_whatever_the_mount():
    floor = [(-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0)]
    kind = profile(
        phi_min_deg=2.0, phi_max_deg=30.0, theta_min_deg=-180, theta_max_deg=180,
        range_10_percent_m=1000.0,
    )  # fmt: skip
    eye = sensor(world(floor), kind, position_m=(1.5, 0.3, 1.9))
    points = look(eye)
    expected = -1.9 / directions(kind)[:, 2]
    assert np.abs(points[:, RANGE] - expected).max() < 1e-3
    assert np.abs(points[:, Z] + 1.9).max() < 1e-4


def test_roll_pitch_and_yaw_of_mount_and_vehicle():
    """A sensor turned by yaw 90, pitch 10, roll 5 degrees sees the ray where the matrix says."""
    kind = profile()
    eye = sensor(world(wall(40.0)), kind, rotation_deg=(5.0, 10.0, 90.0))
    eye.reset(0, 1)
    points = scan(eye, pose((2.0, 1.0, 0.5), yawed(np.radians(-80.0))))[0]
    roll, pitch, yaw = np.radians([5.0, 10.0, 90.0 - 80.0])
    about_z = trimesh.transformations.rotation_matrix(yaw, [0, 0, 1])[:3, :3]
    about_y = trimesh.transformations.rotation_matrix(pitch, [0, 1, 0])[:3, :3]
    about_x = trimesh.transformations.rotation_matrix(roll, [1, 0, 0])[:3, :3]
    rays = directions(kind) @ (about_z @ about_y @ about_x).T
    assert np.abs(points[:, RANGE] - 38.0 / rays[:, 0]).max() < 1e-3


def test_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    mesh = MeshBuilder()
    mesh.add(
        ball.vertices + np.array([20.0, 0.5, -0.2]), ball.faces, materials.PLAIN, (0.5, 0.5, 0.5)
    )
    eye = sensor(World(mesh.build(), np.zeros((1, 5)), 0, (0, 0), (0, 0)), profile())
    points = look(eye)
    rays = directions(eye.profile)
    along = rays @ np.array([20.0, 0.5, -0.2])
    square = 9.0 - (20.0**2 + 0.5**2 + 0.2**2 - along**2)
    inside = square > 0.6  # away from the rim, where facets matter
    expected = along[inside] - np.sqrt(square[inside])
    assert inside.sum() > 150
    assert np.abs(points[inside, RANGE] - expected).max() < 6e-3  # sagitta of the facets
    assert np.isnan(points[square < -0.1, RANGE]).all()


def soup(seed: int, triangles: int = 3000) -> trimesh.Trimesh:
    """Random triangles of all sizes around the origin."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-60, 60, (triangles, 1, 3))
    size = 10 ** rng.uniform(-1.5, 1.0, (triangles, 1, 1))
    points = centre + size * rng.normal(size=(triangles, 3, 3))
    return trimesh.Trimesh(
        points.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3), process=False
    )


@pytest.mark.parametrize("seed", range(4))
def test_random_scenes_as_embree_sees_them(seed):
    scene = soup(seed)
    mesh = MeshBuilder()
    mesh.add(scene.vertices, scene.faces, materials.PLAIN, (0.9, 0.9, 0.9))
    kind = profile(
        theta_min_deg=0, theta_max_deg=360, theta_res_deg=0.5, phi_min_deg=-45, phi_max_deg=45,
        phi_res_deg=1.3, range_min_m=0.05, range_max_m=90.0, range_10_percent_m=1000.0,
    )  # fmt: skip
    eye = sensor(World(mesh.build(), np.zeros((1, 5)), 0, (0, 0), (0, 0)), kind)
    eye.reset(0, 1)
    at = np.random.default_rng(seed + 99).uniform(-5, 5, 3)
    scan(eye, pose(at))
    hits = eye._hits.numpy()[0]
    rays = directions(kind)
    origins = np.broadcast_to(np.float32(at), rays.shape)
    truth = np.full(len(rays), kind.range_max_m)
    places, index, _ = scene.ray.intersects_location(origins, rays, multiple_hits=False)
    truth[index] = np.minimum(np.linalg.norm(places - origins[index], axis=1), kind.range_max_m)
    error = np.abs(hits["t"] - truth)
    assert (hits["face"] >= 0).mean() > 0.3
    # Rays along a rim may fall on either side of it.
    assert (error > np.maximum(1e-3, 1e-4 * truth)).mean() < 5e-4


class Script:
    """Objects at given poses and speeds."""

    def __init__(self, position_m, velocity_mps, yaw_rad, yaw_rate_radps, tilt_rad=None):
        """``tilt_rad``: pitches and rolls [M] each; None: all stand level."""
        self.count = len(position_m)
        self._tilt = tilt_rad
        self._rows = position_m, velocity_mps, yaw_rad, yaw_rate_radps

    def at(self, time_s):
        slots, m = len(time_s), self.count

        def spread(values, dtype=float):
            return np.broadcast_to(np.asarray(values, dtype), (slots, *np.shape(values))).copy()

        position, velocity, yaw, rate = (spread(v) for v in self._rows)
        flags = np.zeros((slots, m), np.float32)
        kind = np.zeros((slots, m), np.int32)
        placement = Placement(kind, position, yaw, velocity, rate, flags, flags)
        if self._tilt is None:
            return placement
        pitch, roll = (spread(v) for v in self._tilt)
        return replace(placement, pitch_rad=pitch, roll_rad=roll)


def box_kind() -> ObjectKind:
    mesh = MeshBuilder()
    mesh.box((-2.0, -1.0, 0.0), (2.0, 1.0, 1.5), materials.CAR_PAINT, (0.5, 0.5, 0.5))
    return ObjectKind("box", mesh.build(), 2.0, 1.0)


def moving(script: Script, lidar: Lidar, kind, *, holes=False, **mounted) -> LidarSensor:
    """``holes``: the boxes are full of them."""
    box, more = box_kind(), {}
    if holes:
        count = len(box.mesh.faces)
        none = [np.zeros((0, 3, width), np.float32) for width in (3, 3, 4)]
        details = FaceDetails(np.arange(count, dtype=np.int32), np.zeros(count, np.int32), *none)
        uv = 3.0 * box.mesh.points_m[:, :2] + box.mesh.points_m[:, 2:]
        mesh = replace(box.mesh, uv=uv, details=details)
        box = replace(box, mesh=mesh)
        checks = np.array([(0, 255), (255, 0)], np.uint8)
        more = {"masks": (Mask(checks, 128.0),), "looks": (FaceLook(mask=0),)}
    movers = (0,) * script.count
    scene = world(wall(150.0), kinds=(box,), motion=script, mover_classes=movers, **more)
    eye = sensor(scene, kind, lidar, **mounted)
    eye.geometry.place(script.at(np.zeros(1)))
    return eye


def test_an_object_is_seen_where_it_was_when_the_column_was_fired():
    script = Script([(30.0, 0.0, -0.5)], [(-20.0, 0.0, 0.0)], [0.0], [0.0])
    kind = profile(theta_min_deg=-1.5, theta_max_deg=1.5, theta_res_deg=0.1, phi_min_deg=0.0,
                   phi_max_deg=0.0)  # fmt: skip
    eye = moving(script, Lidar(noise=False, truth=True), kind)
    points = look(eye)
    expected = 28.0 - 20.0 * points[:, TIME]  # its rear came from farther away
    assert (points[:, INSTANCE] == 0).all()
    assert np.abs(points[:, X] - expected).max() < 2e-3
    still = look(moving(script, QUIET, kind))
    assert np.abs(still[:, X] - 28.0).max() < 1e-3


@pytest.mark.parametrize(("holes", "lean"), [(False, 0.0), (True, 0.0), (False, 0.2)])
def test_packets_and_single_rays_meet_the_same(holes, lean):
    """The kernel of GPUs against that of the CPU, with many moving, turning and leaning objects."""
    rng = np.random.default_rng(3)
    m = 45
    places = np.stack([rng.uniform(5, 70, m), rng.uniform(-40, 40, m), np.full(m, -1.0)], 1)
    moves = rng.normal(0, 12, (m, 3)) * (1, 1, 0), rng.uniform(-3, 3, m), rng.normal(0, 0.8, m)
    script = Script(places, *moves, lean * rng.normal(size=(2, m)) if lean else None)
    kind = profile(theta_min_deg=0, theta_max_deg=360, theta_res_deg=0.7, divergence_mrad=[3, 2],
                   sub_rays=5, phi_res_deg=1.1)  # fmt: skip
    eye = moving(script, Lidar(noise=False), kind, holes=holes, position_m=(0.0, 0.0, 1.0))
    other = Geometry(eye.geometry.world, 1, CPU, bvh.CUDA)
    other.place(script.at(np.zeros(1)))
    eye.reset(0, 3)
    scan(eye, pose((0.0, 0.0, 0.0)))
    scan(eye, pose((1.5, 0.4, 0.1), yawed(0.2)))
    packets = eye._hits.numpy()[0].copy()
    eye._hits.zero_()
    tiles = eye._tiles_x * eye._tiles_y * kind.sub_rays
    inputs = [other.scene, eye._beams, eye.air.device, eye._poses, eye._mask]
    kernel = lidar_cast.cast_kernel_of(eye.geometry.features)
    wp.launch(kernel, tiles * 32, inputs=inputs, outputs=[eye._hits], device=CPU)
    single = eye._hits.numpy()[0]
    assert len(np.unique(packets["owner"])) > 20
    assert packets.tobytes() == single.tobytes()


def test_masks_hide_no_object():
    """With all bits of the tiles' masks set, the same hits."""
    rng = np.random.default_rng(5)
    m = 40
    places = np.stack([rng.uniform(-60, 60, m), rng.uniform(-60, 60, m), np.full(m, -1.0)], 1)
    script = Script(places, rng.normal(0, 9, (m, 3)), rng.uniform(-3, 3, m), rng.normal(0, 1, m))
    kind = profile(theta_min_deg=0, theta_max_deg=360, phi_min_deg=-40, phi_max_deg=40,
                   phi_res_deg=2.0)  # fmt: skip
    eye = moving(script, Lidar(noise=False), kind, rotation_deg=(8.0, -20.0, 30.0))
    eye.reset(0, 3)
    scan(eye)
    scan(eye, pose((2.0, -0.5, 0.2), yawed(-0.15)))
    masked = eye._hits.numpy()[0].copy()
    full = eye._mask.numpy()
    assert 0 < np.unpackbits(full.view(np.uint8)).mean() < 0.4
    eye._mask.assign(np.full_like(full, (1 << 32) - 1) & np.array([2**32 - 1, 2**8 - 1], np.uint32))
    eye._cast()
    assert (eye._hits.numpy()[0] == masked).all()


@pytest.mark.parametrize("tile", [(16, 2), (32, 8)])
def test_the_shape_of_tiles_changes_no_hit(tile):
    mesh = MeshBuilder()
    scene = soup(8, 400)
    mesh.add(scene.vertices, scene.faces, materials.PLAIN, (0.9, 0.9, 0.9))
    street = World(mesh.build(), np.zeros((1, 5)), 0, (0, 0), (0, 0))
    kind = profile(theta_min_deg=0, theta_max_deg=359, theta_res_deg=0.9, phi_res_deg=0.45)
    usual = sensor(street, kind)
    shaped = LidarSensor(kind, LidarMount([0, 0, 0], inline=kind), usual.geometry, QUIET, tile=tile)
    points = look(usual)
    assert kind.columns % tile[0]
    assert kind.channels % tile[1]
    assert (points[:, KIND] == SURFACE).any()
    assert look(shaped).tobytes() == points.tobytes()


def test_nearest_and_farthest_range():
    kind = profile(range_min_m=5.0, range_max_m=60.0, range_10_percent_m=1000.0)
    for distance, seen in ((4.9, False), (5.1, True), (55.0, True), (60.1, False)):
        points = look(sensor(world(wall(distance)), kind))
        middle = len(points) // 2
        assert (points[middle, KIND] == SURFACE) == seen
        assert np.isnan(points[middle, RANGE]) != seen
