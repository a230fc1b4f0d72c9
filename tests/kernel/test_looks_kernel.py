"""Materials from files as kernels see them, beside references of NumPy and closed forms."""

import numpy as np
import pytest
import warp as wp
from masks import alpha_at
from pictures import CPU, camera_in, flat, joined, light_slot, mesh_of, quad, world_of

from twin.render.look_surface import look_point, smooth_point
from twin.render.texture import Textures, pack_textures, sample
from twin.render.trace.geometry import Geometry, RayScene
from twin.world.meshes.details import (
    CLAMP,
    MIRRORED,
    NORMAL,
    REPEAT,
    SHINE,
    FaceDetails,
    FaceLook,
    Mask,
    texture_kind,
)
from twin.world.meshes.srgb import linear, srgb


@wp.kernel(module="unique", enable_backward=False)
def sample_kernel(
    textures: Textures,
    texture: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    footprint: wp.float32,
    out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    out[i] = sample(textures, texture[i], uv[i], footprint)


def sampled(packed, texture, uv, footprint=0.0):
    out = wp.zeros(len(uv), dtype=wp.vec3, device=CPU)
    numbers = wp.array(np.full(len(uv), texture), dtype=wp.int32, device=CPU)
    inputs = [packed, numbers, wp.array(uv, dtype=wp.vec2, device=CPU), footprint]
    wp.launch(sample_kernel, len(uv), inputs, [out], device=CPU)
    return out.numpy()


KINDS = [
    texture_kind(REPEAT, REPEAT),
    texture_kind(CLAMP, MIRRORED),
    texture_kind(MIRRORED, CLAMP, data=True),
    texture_kind(REPEAT, CLAMP, data=True),
]


@pytest.mark.parametrize("number", range(len(KINDS)))
def test_images_beyond_their_borders(number):
    rng = np.random.default_rng(number)
    image = rng.integers(0, 256, (5, 7, 3)).astype(np.uint8)
    packed = pack_textures([image] * len(KINDS), CPU, KINDS)
    uv = rng.uniform(-2.5, 3.5, (2000, 2)).astype(np.float32)
    found = sampled(packed, number, uv)
    values = image / 255.0 if KINDS[number] & 16 else linear(image / 255.0)
    for channel in range(3):
        expected = alpha_at(Mask(values[..., channel], 0.0, KINDS[number] & 15), uv)
        np.testing.assert_allclose(found[:, channel], expected, atol=2e-4)


def test_coarse_levels_are_means_of_light_or_of_numbers():
    image = np.zeros((4, 4, 3), np.uint8)
    image[::2] = 200
    kinds = [texture_kind(REPEAT, REPEAT), texture_kind(REPEAT, REPEAT, data=True)]
    packed = pack_textures([image, image], CPU, kinds)
    uv = np.array([(0.3, 0.6)], np.float32)
    light, number = (sampled(packed, n, uv, 1.0)[0, 0] for n in range(2))
    mean = np.rint(255 * srgb(linear(np.array(200 / 255)) / 2)) / 255
    assert light == pytest.approx(linear(mean), rel=1e-5)
    assert number == pytest.approx(100 / 255, rel=1e-5)


def test_images_that_differ_in_their_borders_share_their_texels():
    image = np.zeros((8, 8, 3), np.uint8)
    one = pack_textures([image], CPU, [0]).texels.size
    assert pack_textures([image, image], CPU, [0, CLAMP]).texels.size == one
    assert pack_textures([image, image], CPU, [0, KINDS[2]]).texels.size == 2 * one


@wp.kernel(module="unique", enable_backward=False)
def smooth_kernel(
    scene: RayScene,
    weights: wp.array(dtype=wp.vec2),
    flat_normal: wp.vec3,
    n_out: wp.array(dtype=wp.vec3),
    lift_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    point = smooth_point(scene, 0, 0, -1, weights[i][0], weights[i][1], flat_normal)
    n_out[i] = point.n
    lift_out[i] = point.lift


def empty(width):
    return np.zeros((0, 3, width), np.float32)


def detailed(points, faces, look, *, normal=None, corner=None, tangent=None, **values):
    """A world of one mesh all of whose faces have a look."""
    count = len(faces)
    details = FaceDetails(
        np.arange(count, dtype=np.int32),
        np.zeros(count, np.int32),
        empty(3) if normal is None else np.asarray(normal, np.float32),
        empty(3) if corner is None else np.asarray(corner, np.float32),
        empty(4) if tangent is None else np.asarray(tangent, np.float32),
    )
    more = {k: values.pop(k) for k in ("textures", "texture_kinds", "masks") if k in values}
    return world_of(mesh_of(points, faces, details=details, **values), looks=(look,), **more)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_smooth_points_lie_where_hanika_puts_them(side):
    """P' = sum w_i (P - min(0, (P - V_i) n_i) n_i), and Phong's normal, seen from either side."""
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0.3, 1.5, 0]])
    normals = np.array([[-0.3, -0.2, 1], [0.4, -0.1, 1], [0.0, 0.5, 1]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    world = detailed(corners, [[0, 1, 2]], FaceLook(smooth=True), normal=normals[None])
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), 200)
    n, lift = (wp.zeros(200, dtype=wp.vec3, device=CPU) for _ in range(2))
    two = wp.array(weights[:, :2], dtype=wp.vec2, device=CPU)
    inputs = [Geometry(world, 1, CPU).scene, two, wp.vec3(0.0, 0.0, side)]
    wp.launch(smooth_kernel, 200, inputs, [n, lift], device=CPU)
    mean = weights @ normals * side
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    np.testing.assert_allclose(n.numpy(), mean, atol=1e-5)
    points = weights @ corners
    expected = np.zeros_like(points)
    for k in range(3):
        below = np.minimum(0.0, (points - corners[k]) @ (side * normals[k]))
        expected -= weights[:, k : k + 1] * below[:, None] * side * normals[k]
    np.testing.assert_allclose(lift.numpy(), expected, atol=1e-5)
    assert (np.abs(expected).max() > 0.05) == (side > 0)  # convex: only before its front


def globe(lines):
    """Points, faces and corner normals of a ball of 20 m, 80 m before the camera: its facets lie
    farther below the sphere than the offset of shadow rays."""
    lon = np.linspace(0, 2 * np.pi, 2 * lines + 1)
    lat = np.linspace(-np.pi / 2, np.pi / 2, lines + 1)
    a, b = np.meshgrid(lon, lat)
    n = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], -1).reshape(-1, 3)
    i, j = (v.ravel() for v in np.meshgrid(range(lines), range(2 * lines), indexing="ij"))
    k = (2 * lines + 1) * i + j
    m = k + 2 * lines + 1
    faces = np.concatenate(
        [np.stack([k, k + 1, m + 1], 1)[i > 0], np.stack([k, m + 1, m], 1)[i < lines - 1]]
    )
    return 20.0 * n + np.array([80.0, 0, 0]), faces, n[faces]


def ball_picture(lines, *, smooth, way):
    points, faces, normals = globe(lines)
    world = detailed(points, faces, FaceLook(smooth=smooth), normal=normals if smooth else None)
    with pytest.MonkeyPatch.context() as patched:
        if way == "traced":
            patched.setattr("twin.render.camera.raster_of", lambda *_: None)
        camera = camera_in(world, size=(128, 72), hfov_deg=40.0)
    light_slot(camera, 0, sun_direction=(0.0, 0.8, 0.6), extinction=0.0)
    return camera.render(flat((0, 0, 0)))[0].astype(int)


@pytest.mark.parametrize("way", ["drawn", "traced"])
def test_a_smooth_ball_of_few_faces_looks_like_one_of_many(way):
    """Shaded as a sphere, also where the sun grazes it: no facet shadows another."""
    exact = ball_picture(64, smooth=False, way=way)
    smooth = ball_picture(9, smooth=True, way=way)
    facets = ball_picture(9, smooth=False, way=way)
    rows, columns = np.mgrid[0:72, 0:128]
    scale = 64 / np.tan(np.radians(20.0))
    y, z = (columns + 0.5 - 64) / scale, (rows + 0.5 - 36) / scale
    inside = np.hypot(y, z) < 0.9 * np.tan(np.arcsin(0.25))
    assert inside.sum() > 500
    apart, before = (np.abs(p - exact).max(axis=-1)[inside] for p in (smooth, facets))
    assert apart.mean() < 2.5
    assert apart.mean() < 0.4 * before.mean()
    assert apart.max() < 30  # steps of a shadow would be of 60 levels


def test_colours_between_corners():
    """A square between red and blue is mixed in linear light along its side."""
    points, faces = quad((5, 3, -3), (5, -3, -3), (5, -3, 3), (5, 3, 3))
    ends = np.array([(0.5, 0.02, 0.02), (0.02, 0.02, 0.5)] * 2)[[0, 1, 1, 0]]
    strips, strip_faces, colors = [], [], []
    for k in range(32):
        y0, y1 = 3 - 6 * k / 32, 3 - 6 * (k + 1) / 32
        strips.append(quad((5, y0, -3), (5, y1, -3), (5, y1, 3), (5, y0, 3)))
        share = (k + 0.5) / 32
        colors += [ends[0] * (1 - share) + ends[1] * share] * 2
    strip_points, strip_faces = joined(*strips)
    mixed = detailed(points, faces, FaceLook(colored=True), corner=ends[faces])
    cut = world_of(mesh_of(strip_points, strip_faces, color=np.array(colors, np.float32)))
    one, other = (
        camera_in(world).render(flat((0, 0, 0)))[0].astype(int)[8:28, 16:48]
        for world in (mixed, cut)
    )
    assert np.abs(one - other).max() <= 6  # half a strip
    assert one[10, 2, 0] > one[10, 29, 0] + 40


@pytest.mark.parametrize("minute", [720, 1380])
def test_own_light_is_a_luminance(minute):
    """A black wall that emits what a matt one reflects looks the same, by day and by night."""
    points, faces = quad((5, 9, -9), (5, -9, -9), (5, -9, 9), (5, 9, 9))
    sky = (300.0, 600.0, 900.0) if minute == 720 else (3.0, 6.0, 9.0)
    lit = {"sky_rgb": sky, "sun_rgb": (0.0, 0.0, 0.0), "lamps_on": 0.0, "extinction": 0.0}
    exposure = 1e-3 if minute == 720 else 1e-1
    pictures = []
    for albedo, emission in ((0.5, 0.0), (0.0, 1.0)):
        # An upright wall in the open: sky times 0.78 / 4 + 0.05, over pi.
        glow = tuple(emission * 0.5 * s * (0.78 * 0.25 + 0.05) / np.pi for s in sky)
        color = np.full((2, 3), albedo, np.float32)
        camera = camera_in(detailed(points, faces, FaceLook(emission=glow), color=color))
        light_slot(camera, 0, minute=minute, exposure=exposure, **lit)
        pictures.append(camera.render(flat((0, 0, 0)))[0].astype(int))
    matt, own = pictures
    assert np.abs(matt[10:26, 20:44] - own[10:26, 20:44]).max() <= 1
    assert 20 < matt[18, 32].min() < matt[18, 32].max() < 250


def test_a_normal_map_bends_normals_along_u_and_v():
    """The same picture as with normals at the corners that are bent as the map says."""
    points, faces = quad((5, 3, -3), (5, -3, -3), (5, -3, 3), (5, 3, 3))
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    tangent = np.tile([0.0, -1.0, 0.0, 1.0], (2, 3, 1))
    texel = np.array([190, 90, 230])
    x, y, z = 2.0 * texel / 255.0 - 1.0
    image = np.tile(texel.astype(np.uint8), (1, 1, 1))
    kind = texture_kind(REPEAT, REPEAT, data=True)
    bent = np.array([-z, -x, y])  # u runs to -y, v up, the front looks to -x
    maps = [-1, -1, -1]
    maps[NORMAL] = 0
    mapped = detailed(
        points,
        faces,
        FaceLook(maps=tuple(maps)),
        tangent=tangent,
        uv=uv,
        textures=(image,),
        texture_kinds=(kind,),
    )
    normal = np.tile(bent / np.linalg.norm(bent), (2, 3, 1))
    smooth = detailed(points, faces, FaceLook(smooth=True), normal=normal)
    plain = world_of(mesh_of(points, faces))
    one, other, third = (camera_in(w).render(flat((0, 0, 0)))[0] for w in (mapped, smooth, plain))
    middle = (slice(12, 24), slice(24, 40))
    apart = np.abs(one[middle].astype(int) - other[middle])
    assert apart.max() <= 1
    assert np.abs(one[middle].astype(int) - third[middle]).max() > 5


@wp.kernel(module="unique", enable_backward=False)
def shine_kernel(scene: RayScene, uv: wp.array(dtype=wp.vec2), out: wp.array2d(dtype=wp.float32)):
    i = wp.tid()
    found = look_point(scene, 0, 0.3, 0.3, uv[i], 0.0)
    out[i, 3] = found.mirror
    for k in range(3):
        out[i, k] = found.albedo[k]
        out[i, 4 + k] = found.tint[k]


def test_metal_and_roughness_divide_the_light():
    base = np.array([0.8, 0.5, 0.2])
    texels = np.array([(0, 0, 0), (0, 0, 255), (0, 128, 255), (0, 255, 255), (0, 64, 128)])
    image = texels[None].astype(np.uint8)
    look = FaceLook(metallic=0.9, roughness=0.8, maps=(-1, -1, 0))
    assert look.maps[SHINE] == 0
    world = detailed(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        [[0, 1, 2]],
        look,
        color=np.array([base], np.float32),
        textures=(image,),
        texture_kinds=(texture_kind(CLAMP, CLAMP, data=True),),
    )
    uv = np.stack([(np.arange(5) + 0.5) / 5, np.full(5, 0.5)], axis=1)
    out = wp.zeros((5, 7), dtype=wp.float32, device=CPU)
    inputs = [Geometry(world, 1, CPU).scene, wp.array(uv, dtype=wp.vec2)]
    wp.launch(shine_kernel, 5, inputs, [out], device=CPU)
    for row, (_, green, blue) in zip(out.numpy(), texels / 255.0, strict=True):
        rough, metal = 0.8 * green, 0.9 * blue
        sharp = np.clip((0.6 - rough) / 0.5, 0, 1) ** 2
        color = (metal * base + 0.04 * (1 - metal)) * sharp
        np.testing.assert_allclose(row[:3], base * (1 - metal * sharp), atol=1e-4)
        assert row[3] == pytest.approx(color.max(), abs=1e-4)
        if color.max() > 0:
            np.testing.assert_allclose(row[4:], color / color.max(), atol=1e-3)


@pytest.mark.parametrize("way", ["followed", "sky alone"])
def test_polished_metal_mirrors_and_rough_metal_does_not(way):
    """Copper before the camera, a white wall behind it in the sun."""
    plate = quad((6, 3, -3), (6, -3, -3), (6, -3, 3), (6, 3, 3))
    wall = quad((-8, -30, -30), (-8, 30, -30), (-8, 30, 30), (-8, -30, 30))
    points, faces = joined(plate, wall)
    color = np.repeat([(0.9, 0.4, 0.2), (0.9, 0.9, 0.9)], 2, axis=0).astype(np.float32)
    seen = {}
    for roughness in (0.0, 1.0):
        details = FaceDetails(
            np.array([0, 1, -1, -1], np.int32), np.zeros(2, np.int32), empty(3), empty(3), empty(4)
        )
        look = FaceLook(metallic=1.0, roughness=roughness, mirrors=roughness < 0.5)
        world = world_of(mesh_of(points, faces, color=color, details=details), looks=(look,))
        camera = camera_in(world, reflections=way == "followed")
        light_slot(camera, 0, sun_direction=(0.8, 0.0, 0.6))
        seen[roughness] = camera.render(flat((0, 0, 0)))[0, 18, 32].astype(int)
    # The plate itself is in the shade, what it mirrors is not.
    if way == "followed":
        assert seen[0.0][0] > seen[1.0][0] + 40
    assert seen[0.0][0] > seen[0.0][2] + 10
    assert (seen[0.0] != seen[1.0]).any()
