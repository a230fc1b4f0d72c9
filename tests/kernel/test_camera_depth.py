"""Depth of pictures against closed forms and an independent ray caster."""

import math

import numpy as np
import pytest
import warp as wp
from pictures import CPU, camera_in, flat, mesh_of, quad, states, world_of

from schemas.sections.lens import CameraMount, Lens
from twin.render.trace import bvh, traverse

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("embreex")

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def directions(camera):
    return camera._rays.numpy().astype(float)


def test_depth_of_a_plane():
    ground = quad((-50, -800, -1.5), (900, -800, -1.5), (900, 800, -1.5), (-50, 800, -1.5))
    camera = camera_in(world_of(mesh_of(*ground)), outputs=["depth"])
    camera.render(flat((0, 0, 0)))
    depth = camera.outputs["depth"][0]
    rays = directions(camera)
    down = rays[..., 1]  # y is down
    with np.errstate(divide="ignore"):
        expected = np.where(down > 0.0, 1.5 / down * rays[..., 2], np.inf)
    expected[expected > 800.0] = np.inf
    assert np.isinf(depth[:18]).all()
    seen = np.isfinite(expected) & np.isfinite(depth)
    assert seen[20:].all()
    np.testing.assert_allclose(depth[seen], expected[seen], rtol=2e-5)


def test_depth_of_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=2.0)
    points = ball.vertices + np.array([9.0, 0.7, 0.3])
    camera = camera_in(world_of(mesh_of(points, ball.faces)), outputs=["depth"], size=(160, 90))
    camera.render(flat((0, 0, 0)))
    depth = camera.outputs["depth"][0]
    rays = directions(camera)
    centre = np.array([-0.7, -0.3, 9.0])  # right, down, forward
    along = rays @ centre
    square = along**2 - (centre @ centre - 4.0)
    inside = square > 0.1  # away from the rim, where facets and sphere differ most
    expected = (along - np.sqrt(np.maximum(square, 0.0))) * rays[..., 2]
    assert inside.sum() > 500
    # Facets of 64 to the quarter circle lie up to 2 (1 - cos(0.6 deg)) = 0.3 mm inside.
    np.testing.assert_allclose(depth[inside], expected[inside], atol=4e-3)
    assert np.isinf(depth[square < -0.1]).all()


def test_depth_follows_the_body_that_pitches_and_rolls():
    wall = quad((10, -90, -90), (10, 90, -90), (10, 90, 90), (10, -90, 90))
    camera = camera_in(world_of(mesh_of(*wall)), outputs=["depth"], mount=(2.0, 0.0, 0.0))
    pitch = 0.2  # nose down
    camera.render(states([(1.0, 0.0, 0.0)], [(0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))]))
    depth = camera.outputs["depth"][0]
    rays = directions(camera)
    forward = rays[..., 2] * math.cos(pitch) - rays[..., 1] * math.sin(pitch)
    distance = (10.0 - 1.0 - 2.0 * math.cos(pitch)) / forward
    np.testing.assert_allclose(depth, distance * rays[..., 2], rtol=1e-5)
    # And a camera that is mounted so sees the same from the same place.
    mount = CameraMount(position_m=[0.0, 0.0, 0.0], rotation_deg=[0.0, math.degrees(pitch), 0.0])
    other = camera_in(world_of(mesh_of(*wall)), outputs=["depth"], mount=mount)
    other.render(flat((1.0 + 2.0 * math.cos(pitch), 0.0, 0.0)))
    np.testing.assert_allclose(other.outputs["depth"][0], depth, rtol=1e-5)


def test_near_and_far_planes_clip():
    near = quad((1, -9, -9), (1, 9, -9), (1, 9, 0), (1, -9, 0))
    far = quad((50, -90, -90), (50, 90, -90), (50, 90, 90), (50, -90, 90))
    points = np.concatenate([near[0], far[0]])
    faces = np.concatenate([near[1], far[1] + 4])
    world = world_of(mesh_of(points, faces))
    for near_m, far_m, expected in ((0.5, 80.0, {1.0, 50.0}), (2.0, 80.0, {50.0})):
        lens = Lens(near_m=near_m, far_m=far_m)
        camera = camera_in(
            world, outputs=["depth"], mount=CameraMount(position_m=[0.0, 0.0, 0.0], lens=lens)
        )
        camera.render(flat((0, 0, 0)))
        assert set(np.round(camera.outputs["depth"][0], 3).ravel().tolist()) == expected
    camera = camera_in(
        world,
        outputs=["depth"],
        mount=CameraMount(position_m=[0.0, 0.0, 0.0], lens=Lens(near_m=2.0, far_m=49.0)),
    )
    camera.render(flat((0, 0, 0)))
    assert np.isinf(camera.outputs["depth"][0]).all()


def soup(seed, count=1500):
    """Triangles of very different sizes all around the origin."""
    rng = np.random.default_rng(seed)
    middle = rng.normal(size=(count, 1, 3)) * 25.0
    size = 10.0 ** rng.uniform(-1.5, 1.2, (count, 1, 1))
    points = (middle + rng.normal(size=(count, 3, 3)) * size).reshape(-1, 3)
    return points.astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(4))
def test_depth_against_an_independent_ray_caster(seed):
    points, faces = soup(seed)
    camera = camera_in(
        world_of(mesh_of(points, faces)),
        outputs=["depth"],
        size=(160, 90),
        mount=CameraMount(position_m=[0.0, 0.0, 0.0], lens=Lens(near_m=0.001)),
    )
    camera.render(flat((0, 0, 0)))
    depth = camera.outputs["depth"][0].ravel()
    rays = directions(camera).reshape(-1, 3)
    world = np.stack([rays[:, 2], -rays[:, 0], -rays[:, 1]], axis=1)
    caster = trimesh.ray.ray_pyembree.RayMeshIntersector(
        trimesh.Trimesh(points, faces, process=False), scale_to_box=False
    )
    face = caster.intersects_first(np.zeros_like(world), world)
    corners = points[np.maximum(face, 0)[:, None] * 3 + np.arange(3)].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (corners[:, 0] * normal).sum(axis=1) / (world * normal).sum(axis=1)
    expected = np.where(face >= 0, t * rays[:, 2], np.inf)
    with np.errstate(invalid="ignore"):
        error = np.abs(depth - expected)
    close = (depth == expected) | (error <= np.maximum(1e-3, 1e-4 * expected))
    # Rays through an edge may pass on either side.
    assert close.mean() > 0.999
    assert (face >= 0).mean() > 0.5


@wp.kernel
def cast_kernel(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    scalar_nodes: wp.array(dtype=wp.float32),
    scalar_leaves: wp.array(dtype=wp.float32),
    origin: wp.vec3,
    rays: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.float32),
    faces: wp.array2d(dtype=wp.int32),
    blocked: wp.array2d(dtype=wp.int32),
):
    i = wp.tid()
    far = wp.float32(60.0)
    a = traverse.closest(nodes, leaves, 0, origin, rays[i], 0.0, far)
    b = traverse.closest_scalar(scalar_nodes, scalar_leaves, 0, origin, rays[i], 0.0, far)
    for k in range(3):
        out[i, k] = a[k]
        out[i, 3 + k] = b[k]
    faces[i, 0] = wp.cast(a[3], wp.int32)
    faces[i, 1] = wp.cast(b[3], wp.int32)
    hit = traverse.blocked(nodes, leaves, 0, origin, rays[i], 0.0, far)
    blocked[i, 0] = wp.where(hit, 1, 0)
    other = traverse.blocked_scalar(scalar_nodes, scalar_leaves, 0, origin, rays[i], 0.0, far)
    blocked[i, 1] = wp.where(other, 1, 0)


@pytest.mark.parametrize(("seed", "count"), [(7, 3000), (8, 9), (14, 1)])
def test_the_code_of_a_gpu_finds_the_same_faces(seed, count):
    points, faces = soup(seed, count)
    words = []
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(points, faces, shape)
        words += [wp.array(w, dtype=wp.float32, device=CPU) for w in built.words(0, 0, shape)]
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(20_000, 3))
    rays[:50, 0] = 0.0  # along the axes' planes, where slopes are infinite
    rays[50:100, :2] = 0.0
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    out = wp.zeros((len(rays), 6), dtype=wp.float32, device=CPU)
    found = wp.zeros((len(rays), 2), dtype=wp.int32, device=CPU)
    blocked = wp.zeros((len(rays), 2), dtype=wp.int32, device=CPU)
    origin = wp.vec3(0.5, -0.3, 0.2)
    inputs = [*words, origin, wp.array(rays, dtype=wp.vec3, device=CPU)]
    wp.launch(cast_kernel, len(rays), inputs, [out, found, blocked], device=CPU)
    a, b = found.numpy().T
    assert (a == b).all()
    assert ((a >= 0) == (blocked.numpy()[:, 0] == 1)).all()
    assert (blocked.numpy()[:, 0] == blocked.numpy()[:, 1]).all()
    hit = a >= 0
    assert hit.any()
    values = out.numpy()
    np.testing.assert_array_equal(values[:, :3], values[:, 3:])
    u, v = values[hit, 1:3].T.astype(float)
    p, q, r = points[faces[a[hit]]].astype(float).transpose(1, 0, 2)
    point = u[:, None] * p + v[:, None] * q + (1 - u - v)[:, None] * r
    reached = np.array([0.5, -0.3, 0.2]) + rays[hit] * values[hit, :1]
    assert np.abs(point - reached).max() < 5e-3


def test_faces_in_one_place_are_halved():
    points = np.tile(np.array([(5, -1, -1), (5, 1, -1), (5, 0, 1)], np.float32), (300, 1))
    faces = np.arange(900).reshape(-1, 3)
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(points, faces, shape)
        links = built.nodes.view(np.int32)[:, 6]
        assert ((links >= 0).sum() + 1) == len(built.nodes)


def test_no_ray_slips_between_faces():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    # Through vertices and middles of edges, from inside: every ray must meet something.
    edges = ball.vertices[ball.edges_unique].mean(axis=1)
    rays = np.concatenate([ball.vertices, edges])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    words = []
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(ball.vertices.astype(np.float32), ball.faces, shape)
        words += [wp.array(w, dtype=wp.float32, device=CPU) for w in built.words(0, 0, shape)]
    out = wp.zeros((len(rays), 6), dtype=wp.float32, device=CPU)
    found = wp.zeros((len(rays), 2), dtype=wp.int32, device=CPU)
    blocked = wp.zeros((len(rays), 2), dtype=wp.int32, device=CPU)
    inputs = [*words, wp.vec3(0.1, 0.2, 0.3), wp.array(rays, dtype=wp.vec3, device=CPU)]
    wp.launch(cast_kernel, len(rays), inputs, [out, found, blocked], device=CPU)
    assert (found.numpy() >= 0).all()
