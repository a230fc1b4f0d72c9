"""Holes in faces: every kind of ray passes them and meets what is behind, as NumPy has it."""

import numpy as np
import pytest
import warp as wp
from lidar_rigs import RANGE, directions, look, profile, sensor
from masks import first_hits, soup_with_holes
from pictures import (
    CPU,
    Script,
    camera_in,
    flat,
    joined,
    light_slot,
    mesh_of,
    quad,
    world_of,
)

from schemas.sections.lens import CameraMount, Lens
from schemas.sections.lidar import Lidar
from twin.actors.motion import ObjectKind
from twin.render.lens import ray_table
from twin.render.trace import bvh, traverse
from twin.render.trace.cutouts import Cutouts, mark_holes
from twin.render.trace.geometry import Geometry
from twin.world.meshes.details import FaceDetails, FaceLook, Mask

ORIGIN = (0.4, -0.2, 0.3)
_NONE = [np.zeros((0, 3, n), np.float32) for n in (3, 3, 4)]


@wp.kernel(module="unique", enable_backward=False)
def holes_kernel(
    nodes: wp.array(dtype=wp.float32),
    leaves: wp.array(dtype=wp.float32),
    scalar_nodes: wp.array(dtype=wp.float32),
    scalar_leaves: wp.array(dtype=wp.float32),
    corners: wp.array(dtype=wp.vec2),
    cuts: Cutouts,
    origin: wp.vec3,
    rays: wp.array(dtype=wp.vec3),
    t_out: wp.array2d(dtype=wp.float32),
    face_out: wp.array2d(dtype=wp.int32),
    blocked_out: wp.array2d(dtype=wp.int32),
):
    i = wp.tid()
    far = wp.float32(60.0)
    ray = rays[i]
    a = traverse.closest_there(nodes, leaves, corners, cuts, 0, 0, origin, ray, 0.0, far)
    b = traverse.closest_there_scalar(
        scalar_nodes, scalar_leaves, corners, cuts, 0, 0, origin, ray, 0.0, far
    )
    t_out[i, 0] = a[0]
    t_out[i, 1] = b[0]
    face_out[i, 0] = wp.cast(a[3], wp.int32)
    face_out[i, 1] = wp.cast(b[3], wp.int32)
    one = traverse.blocked_there(nodes, leaves, corners, cuts, 0, 0, origin, ray, 0.0, far)
    other = traverse.blocked_there_scalar(
        scalar_nodes, scalar_leaves, corners, cuts, 0, 0, origin, ray, 0.0, far
    )
    blocked_out[i, 0] = wp.where(one, 1, 0)
    blocked_out[i, 1] = wp.where(other, 1, 0)


@pytest.mark.parametrize("seed", range(3))
def test_rays_meet_what_numpy_meets(seed):
    world = soup_with_holes(seed)
    scene = Geometry(world, 1, CPU).scene
    words = []
    for shape in (bvh.CPU, bvh.CUDA):
        built = bvh.build_bvh(world.mesh.points_m, world.mesh.faces, shape)
        nodes, leaves = built.words(0, 0, shape)
        if not shape.packed:
            leaves = mark_holes(leaves, scene.cuts.of_face.numpy(), [0, len(world.mesh.faces)])
        words += [wp.array(w, dtype=wp.float32, device=CPU) for w in (nodes, leaves)]
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(4000, 3))
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    t = wp.zeros((len(rays), 2), dtype=wp.float32, device=CPU)
    face, blocked = (wp.zeros((len(rays), 2), dtype=wp.int32, device=CPU) for _ in range(2))
    inputs = [*words, scene.uv, scene.cuts, wp.vec3(*ORIGIN), wp.array(rays, dtype=wp.vec3)]
    wp.launch(holes_kernel, len(rays), inputs, [t, face, blocked], device=CPU)
    expected_t, expected, close = first_hits(world, np.array(ORIGIN), rays.astype(float))
    sure = close > 0.5  # of 255: float32 may decide otherwise nearer to the limit
    assert sure.mean() > 0.9
    for column in range(2):
        same = face.numpy()[:, column] == expected
        assert same[sure].mean() > 0.999  # edges of faces are decided in float32
        agreed = same & (expected >= 0)
        np.testing.assert_allclose(t.numpy()[agreed, column], expected_t[agreed], rtol=1e-4)
        assert (blocked.numpy()[:, column] == (face.numpy()[:, column] >= 0)).all()
    whole = first_hits(world_without_holes(world), np.array(ORIGIN), rays.astype(float))[1]
    assert (whole != expected).mean() > 0.1  # the holes do matter here


def world_without_holes(world):
    mesh = world.mesh
    bare = np.full(len(mesh.faces), -1, np.int32)
    details = FaceDetails(bare, np.zeros(0, np.int32), *_NONE)
    return world_of(
        mesh_of(mesh.points_m, mesh.faces, details=details), looks=world.looks, masks=world.masks
    )


@pytest.mark.parametrize("seed", range(2))
def test_drawn_and_traced_pictures_agree_with_numpy(seed, monkeypatch):
    world = soup_with_holes(seed)
    spec = {
        "size": (120, 70),
        "outputs": ["depth", "instance", "semantic"],
        "mount": CameraMount(position_m=list(ORIGIN), lens=Lens(near_m=0.01)),
    }
    drawn = camera_in(world, **spec)
    with monkeypatch.context() as patched:
        patched.setattr("twin.render.camera.raster_of", lambda *_: None)
        traced = camera_in(world, **spec)
    pictures = [c.render(flat((0, 0, 0))).copy() for c in (drawn, traced)]
    right, down, ahead = ray_table(Lens(), 120, 70, 90.0).reshape(-1, 3).T.astype(float)
    rays = np.stack([ahead, -right, -down], axis=1)
    _, expected, close = first_hits(world, np.array(ORIGIN), rays, 1e4)
    sure = (close > 0.5).reshape(70, 120)
    for camera in (drawn, traced):
        same = camera.outputs["instance"][0] == expected.reshape(70, 120)
        assert same[sure].mean() > 0.998
    same = drawn.outputs["instance"] == traced.outputs["instance"]
    assert same.mean() > 0.999
    apart = np.abs(pictures[0].astype(int) - pictures[1]).max(axis=-1)
    assert (apart <= 1).mean() > 0.998
    # A box is around what is seen of a face.
    boxes, seen = drawn.boxes.numpy()[0], drawn.outputs["instance"][0]
    for number in np.unique(seen[seen >= 0])[:20]:
        rows, columns = np.nonzero(seen == number)
        assert boxes[number, :4].tolist() == [
            columns.min(), rows.min(), columns.max(), rows.max()
        ]  # fmt: skip


def fence(x_m, half_m=4.0, z_m=0.0):
    """A square across the x axis: points, faces and uv."""
    corners = [(x_m, s * half_m, z_m + t * half_m) for t in (-1, 1) for s in (1, -1)]
    points, faces = quad(corners[0], corners[1], corners[3], corners[2])
    return points, faces, np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)


def halved(alpha_right):
    """A mask of two columns that changes at once in the middle: nothing on the left."""
    pixels = np.zeros((2, 2), np.uint8)
    pixels[:, 1] = alpha_right
    return Mask(pixels, 128.0, 1 | 1 << 2)


def masked(points, faces, uv, masked_faces, **values):
    """A mesh of which the first faces have the first mask."""
    row = np.full(len(faces), -1, np.int32)
    row[:masked_faces] = np.arange(masked_faces)
    details = FaceDetails(row, np.zeros(masked_faces, np.int32), *_NONE)
    return mesh_of(points, faces, uv=uv, details=details, **values)


def test_a_moving_thing_with_holes_is_seen_through():
    points, faces, uv = fence(0.0)
    kind = ObjectKind("fence", masked(points, faces, uv, 2), 0.1, 4.0)
    wall_points, wall_faces, _ = fence(20.0, 30.0)
    wall = mesh_of(wall_points, wall_faces)
    script = Script(position_m=np.array([[9.0, 0.0, 0.0]]), yaw_rad=np.array([0.0]))
    world = world_of(
        wall,
        kinds=(kind,),
        motion=script,
        mover_classes=(0,),
        masks=(halved(255),),
        looks=(FaceLook(mask=0),),
    )
    camera = camera_in(world, outputs=["depth"])
    camera.geometry.place(script.at(np.zeros(1)))
    camera.render(flat((0, 0, 0)))
    depth = camera.outputs["depth"][0, 18]
    assert depth[28] == pytest.approx(20.0)  # left, where nothing is
    assert depth[36] == pytest.approx(9.0)


def test_the_sun_shines_through_holes():
    """A roof with a hole on its left lets light onto the left of the floor."""
    floor = quad((-30, 30, -1.5), (-30, -30, -1.5), (30, -30, -1.5), (30, 30, -1.5))
    roof = quad((4, 3, 2), (4, -3, 2), (10, -3, 2), (10, 3, 2))
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)] + [(0, 0)] * 4, np.float32)
    points, faces = joined(roof, floor)
    world = world_of(masked(points, faces, uv, 2), masks=(halved(255),), looks=(FaceLook(mask=0),))
    camera = camera_in(world, size=(128, 72))
    light_slot(camera, 0, sun_direction=(0.0, 0.0, 1.0))
    picture = camera.render(flat((0, 0, 0)))[0].astype(int).sum(axis=-1)
    row = 36 + round(64 * 1.5 / 7.0)  # the floor 7 m ahead
    dark = picture[row, 64 + round(64 * 1.5 / 7.0)]
    assert picture[row, 64 - round(64 * 1.5 / 7.0)] > 1.5 * dark
    assert picture[row, 4] > 1.5 * dark  # beside the roof


def test_mirrors_show_what_is_behind_a_hole():
    """A pane mirrors a red wall behind a screen; with holes it is seen, without it is not."""
    pane = quad((6, 3, -3), (6, -3, -3), (6, -3, 3), (6, 3, 3))
    red = quad((-8, -30, -30), (-8, 30, -30), (-8, 30, 30), (-8, -30, 30))
    screen = quad((-4, -30, -30), (-4, 30, -30), (-4, 30, 30), (-4, -30, 30))
    points, faces = joined(screen, pane, red)
    uv = np.zeros((12, 2), np.float32)
    color = np.repeat([(0.4, 0.4, 0.4), (0.02, 0.02, 0.02), (0.9, 0.0, 0.0)], 2, axis=0)
    material = np.repeat([0, 7, 0], 2).astype(np.int32)
    shares = {}
    for alpha in (0, 255):
        mask = Mask(np.full((1, 1), alpha, np.uint8), 128.0)
        mesh = masked(points, faces, uv, 2, color=color.astype(np.float32), material=material)
        camera = camera_in(world_of(mesh, masks=(mask,), looks=(FaceLook(mask=0),)))
        light_slot(camera, 0, sun_direction=(0.6, 0.0, 0.8))
        shares[alpha] = camera.render(flat((0, 0, 0)))[0, 18, 32].astype(float)
    assert shares[0][0] > 1.3 * shares[0][1]
    assert shares[255][0] < 1.1 * shares[255][1]


@pytest.mark.parametrize("seed", range(2))
def test_lidar_beams_pass_holes(seed):
    world = soup_with_holes(seed)
    kind = profile(
        theta_min_deg=0, theta_max_deg=360, theta_res_deg=3.0, phi_min_deg=-40, phi_max_deg=40,
        phi_res_deg=2.0, range_min_m=0.01, range_max_m=60.0, range_10_percent_m=1e4,
    )  # fmt: skip
    eye = sensor(world, kind, Lidar(noise=False), position_m=ORIGIN)
    points = look(eye)
    expected_t, expected, close = first_hits(world, np.array(ORIGIN), directions(kind))
    found = np.isfinite(points[:, RANGE])
    sure = close > 0.5
    assert (found == (expected >= 0))[sure].mean() > 0.998
    apart = np.abs(points[:, RANGE] - expected_t)[sure & found]
    assert (apart < 1e-3 + 1e-4 * expected_t[sure & found]).mean() > 0.998
