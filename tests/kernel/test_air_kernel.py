"""Fog through the camera: contrast falls as Koschmieder says, and the sky drowns in it."""

import math

import numpy as np
import pytest
import warp as wp

from schemas.campaign import Camera
from schemas.sections.environment import Conditions
from twin.render.camera import RayCamera
from twin.render.light.air import sky_path
from twin.render.light.light import begin_sky, fill_light, fill_sky
from twin.render.tone import tone_table
from twin.render.trace.geometry import Geometry
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import Furniture
from twin.world.sky.sun import daylight
from twin.world.sky.weather import parameters
from twin.world.street.build import World

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})
CPU = wp.get_device("cpu")
DISTANCES_M = (15.0, 40.0, 90.0, 160.0, 260.0)


def luminance_table():
    """Signal that stands in the middle of each 8-bit value."""
    table = tone_table().astype(int)
    index = np.arange(len(table))
    u = np.minimum(index / (len(table) - 1), 1.0 - 1e-9)
    signal = u / (1.0 - u)
    return np.array(
        [signal[table == v].mean() if (table == v).any() else np.nan for v in range(256)]
    )


@pytest.fixture(scope="module")
def camera():
    """Black boards side by side, each further away, under one width; the horizon above them."""
    mesh = MeshBuilder()
    for k, distance in enumerate(DISTANCES_M):
        left, right = (0.8 - 0.36 * k) * distance, (0.8 - 0.36 * k - 0.3) * distance
        low, high = 1.5 - 0.2 * distance, 1.5 - 0.01 * distance
        mesh.box((distance, right, low), (distance + 0.1, left, high), materials.PLAIN, (0, 0, 0))
    world = World(mesh.build(), np.zeros((1, 5)), 0, (0.0, -5.0), (13.0, 8.0))
    spec = Camera(width=320, height=180, hfov_deg=90.0, noise=False)
    return RayCamera(Geometry(world, 1, CPU), world, Furniture(), spec, (0, 0, 1.5), (1.5, 0, 0.7))


def shoot(camera, weather, minute=720):
    light = daylight(minute, weather)
    row = camera.lights.host[0]
    fill_light(row, light, weather)
    row["active"], row["noise"], row["key"] = 1, 0, 5
    fill_sky(camera.sky_table.host[0], light)
    begin_sky(row, 0)
    pose = wp.array([[0.0, 0.0, 0.0]], dtype=wp.float64, device=CPU)
    return camera.render(pose)[0].copy()


@pytest.mark.parametrize("fog", [0.4, 0.5, 0.75])
def test_contrast_of_black_targets_follows_koschmieder(camera, fog):
    weather = parameters(Conditions(cloud=1.0, fog=fog))
    signal = luminance_table()[shoot(camera, weather)].mean(axis=2)
    # The horizon is a ray through fog without end: just above the camera's height.
    horizon = signal[86:89].mean()
    for k, distance in enumerate(DISTANCES_M):
        middle = 160 - round((0.8 - 0.36 * k - 0.15) * 160)
        black = signal[100:115, middle - 8 : middle + 8].mean()
        # Rays to the board are a little longer than its distance.
        aside, down = (middle - 160) / 160, (107.5 - 90) / 160
        way = distance * math.sqrt(1 + aside * aside + down * down)
        expected = math.exp(-weather.extinction_per_m * way)
        contrast = (horizon - black) / horizon
        assert contrast == pytest.approx(expected, abs=0.03 * max(expected, 0.2)), distance


def test_visibility_is_where_contrast_falls_to_five_per_cent(camera):
    weather = parameters(Conditions(cloud=1.0, fog=0.5))
    assert math.exp(-weather.extinction_per_m * weather.mor_m) == pytest.approx(0.05, rel=0.01)
    signal = luminance_table()[shoot(camera, weather)].mean(axis=2)
    assert signal[86:89].std() < 0.01 * signal[86:89].mean()  # nothing but air there


@wp.kernel
def path_kernel(
    extinction: wp.array(dtype=wp.float32),
    up: wp.array(dtype=wp.float32),
    out: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    out[i] = extinction[i] * sky_path(extinction[i], up[i])


def depth_of_sky(extinction, up):
    arrays = [wp.array(np.asarray(a, np.float32), device="cpu") for a in (extinction, up)]
    out = wp.zeros(len(arrays[0]), dtype=wp.float32, device="cpu")
    wp.launch(path_kernel, len(out), inputs=arrays, outputs=[out], device="cpu")
    return out.numpy()


def test_the_sky_is_seen_through_a_layer_of_weather():
    haze = depth_of_sky([1e-4, 2e-4], [1.0, 0.0])
    assert not haze.any()  # clear air is in the sky's own colour
    b = np.geomspace(2e-4, 0.05, 200)
    depth = depth_of_sky(b, np.full(200, 0.5))
    assert (np.diff(depth) > 0).all()
    np.testing.assert_allclose(depth, 2 * 180 * (b - 2e-4), atol=1e-5, rtol=1e-5)
    assert (np.diff(depth_of_sky(np.full(50, 0.006), np.linspace(1, 0, 50))) >= 0).all()
