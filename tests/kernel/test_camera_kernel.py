"""The camera against geometry that is known: a box in front of it, fog, noise."""

import math

import numpy as np
import pytest
import warp as wp

from schemas.campaign import Camera
from schemas.messages import Lights
from twin.render.camera import RayCamera
from twin.render.light.air import through_air
from twin.render.light.light import advance_light, begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.noise import draw, normal
from twin.render.tone import tone_table
from twin.render.trace.geometry import Geometry
from twin.sensors.camera.boxes import BoxSensor
from twin.snapshot import usual_lights
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import Furniture
from twin.world.sky.sun import daylight
from twin.world.sky.weather import WEATHER
from twin.world.street.build import World

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})
CPU = wp.get_device("cpu")
MOUNT = (0.0, 0.0, 1.5)


def camera_before(boxes, size=(160, 90), noise=False, hfov_deg=90.0, image_out=None):
    """A camera at the origin, 1.5 m up, before ``boxes`` of (low, high); each is an instance."""
    mesh = MeshBuilder()
    mesh.floor((-20, 400), (-60, 60), 0.0, materials.ASPHALT, (0.1, 0.1, 0.1))
    for i, (low, high) in enumerate(boxes):
        with mesh.place(0.0, 0.0, instance=i):
            mesh.box(low, high, materials.PLAIN, (0.4, 0.04, 0.03))
    world = World(mesh.build(), np.zeros((1, 5)), len(boxes), (0.0, -5.0), (13.0, 8.0))
    camera = Camera(width=size[0], height=size[1], hfov_deg=hfov_deg, noise=noise)
    geometry = Geometry(world, 1, CPU)
    return RayCamera(
        geometry,
        world,
        Furniture(lamp_intensity_cd=500.0),
        camera,
        MOUNT,
        (1.5, 0.0, 0.7),
        image_out,
    )


def boxes_of(camera):
    """Boxes and count in its last picture."""
    sensor = BoxSensor(camera.geometry.classes, 1, CPU)
    sensor.launch(camera.boxes)
    return sensor.read()


def shoot(camera, weather="clear", minute=720, key=7, tick=0, noise=False, lights=None):
    light = daylight(minute, WEATHER[weather])
    row = camera.lights.host[0]
    fill_light(row, light, WEATHER[weather])
    fill_sky(camera.sky_table.host[0], light)
    switch_lamps(row, lights or usual_lights(weather, light.illuminance_lx))
    row["active"], row["noise"], row["key"], row["tick"] = 1, int(noise), key, tick
    begin_sky(row, key)
    advance_light(row, tick / 20.0)
    pose = wp.array([[0.0, 0.0, 0.0]], dtype=wp.float64, device=CPU)
    return camera.render(pose)[0].copy()


def test_boxes_are_the_projection_of_the_hull():
    # Near face at 20 m, 1 to 3 m right of the axis, its top 0.4 m below the camera.
    camera = camera_before([((20.0, -3.0, 0.0), (24.0, -1.0, 1.1))])
    shoot(camera)
    boxes, count = boxes_of(camera)
    assert count.tolist() == [1]
    x, y, width, height, pixels, distance = boxes[0, 0, 1:]
    focal = 80.0 / math.tan(math.radians(45.0))
    # Pixel centres inside the silhouette: right is -y; the far upper edge is behind the near one.
    left, right = 80 + focal * 1.0 / 24.0, 80 + focal * 3.0 / 20.0
    top, bottom = 45 + focal * 0.4 / 24.0, 45 + focal * 1.5 / 20.0
    assert x == math.ceil(left - 0.5)
    assert x + width - 1 == math.ceil(right - 0.5) - 1
    assert y == math.ceil(top - 0.5)
    assert y + height - 1 == math.ceil(bottom - 0.5) - 1
    assert 0.8 * width * height <= pixels <= width * height
    assert distance == pytest.approx(math.sqrt(20.0**2 + 1.0**2), abs=0.1)


def test_hidden_objects_are_not_seen_and_ties_go_by_instance():
    wall = ((10.0, -4.0, 0.0), (11.0, 4.0, 3.0))
    behind = ((20.0, -1.0, 0.0), (22.0, 1.0, 1.0))
    camera = camera_before([behind, wall])
    shoot(camera)
    boxes, count = boxes_of(camera)
    assert count.tolist() == [1]
    assert not boxes[0, 1:].any()
    twins = [((10.0, 2.0, 0.0), (11.0, 4.0, 1.0)), ((10.0, -4.0, 0.0), (11.0, -2.0, 1.0))]
    camera = camera_before(twins)
    shoot(camera)
    boxes, count = boxes_of(camera)
    assert count.tolist() == [2]
    assert boxes[0, 0, 5] == boxes[0, 1, 5]
    assert boxes[0, 0, 1] < boxes[0, 1, 1]  # instance 0 stands left


@wp.kernel
def fog_kernel(distance: wp.array(dtype=wp.float32), out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    surface = wp.vec3(10.0, 100.0, 1000.0)
    out[i] = through_air(surface, wp.vec3(500.0, 400.0, 300.0), 0.02, distance[i])


def test_fog_follows_koschmieder():
    distance = np.array([0.0, 1.0, 50.0, 195.6, 1200.0], np.float32)
    out = wp.zeros(5, dtype=wp.vec3, device="cpu")
    wp.launch(fog_kernel, 5, inputs=[wp.array(distance, device="cpu")], outputs=[out], device="cpu")
    t = np.exp(-0.02 * distance.astype(float))[:, None]
    expected = np.array([10, 100, 1000]) * t + np.array([500, 400, 300]) * (1 - t)
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-5)
    assert t[3] == pytest.approx(0.02, rel=1e-3)  # V = 3.912 / b


@wp.kernel
def noise_kernel(key: wp.uint64, tick: wp.int32, out: wp.array(dtype=wp.float32)):
    i = wp.tid()
    out[i] = normal(draw(key, tick, i))


def noise(key, tick):
    out = wp.zeros(100_000, dtype=wp.float32, device="cpu")
    inputs = [wp.uint64(key), tick]
    wp.launch(noise_kernel, 100_000, inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().astype(float)


def test_noise_is_normal_and_its_streams_are_unrelated():
    a, b, c = noise(1, 0), noise(1, 1), noise(2, 0)
    assert abs(a.mean()) < 0.02
    assert a.std() == pytest.approx(1.0, abs=0.01)
    for other in (b, c, np.roll(a, 1)):
        assert abs(np.corrcoef(a, other)[0, 1]) < 0.02
    assert noise(1, 0).tobytes() == a.tobytes()


def test_noise_changes_with_key_and_tick_only():
    camera = camera_before([((15.0, -1.0, 0.0), (18.0, 1.0, 1.5))], size=(64, 36))
    first = shoot(camera, key=3, tick=5, noise=True)
    assert (shoot(camera, key=3, tick=5, noise=True) == first).all()
    assert (shoot(camera, key=4, tick=5, noise=True) != first).any()
    assert (shoot(camera, key=3, tick=6, noise=True) != first).any()
    quiet = shoot(camera, noise=False)
    assert np.abs(first.astype(int) - quiet).mean() < 8


def contrast(image, x0, x1, y0, y1):
    """Difference of the box's mean gray value to a frame around it, over 255."""
    gray = image.astype(float).mean(axis=2)
    around = gray[y0 - 4 : y1 + 4, x0 - 4 : x1 + 4].copy()
    inside = gray[y0:y1, x0:x1].mean()
    around[4:-4, 4:-4] = np.nan
    return abs(inside - np.nanmean(around)) / 255


def test_contrast_falls_with_fog_rain_and_night():
    camera = camera_before([((25.0, -1.0, 0.0), (29.0, 1.0, 1.5))], size=(320, 180))
    shoot(camera)
    box = boxes_of(camera)[0][0, 0].astype(int)
    region = (box[1], box[1] + box[3], box[2], box[2] + box[4])
    values = {w: contrast(shoot(camera, w), *region) for w in WEATHER}
    assert values["clear"] > values["light_fog"] > 1.3 * values["heavy_fog"]
    # A wet road is darker than a dry one, so light rain need not lower the contrast.
    assert min(values["cloudy"], values["light_rain"]) > 1.1 * values["heavy_rain"]
    dark = contrast(shoot(camera, minute=300, lights=Lights()), *region)
    assert dark < 0.5 * values["clear"]


def test_high_beam_lights_the_road_and_glows_in_fog():
    camera = camera_before([], size=(64, 36))
    off = shoot(camera, minute=0, lights=Lights()).mean()
    on = shoot(camera, minute=0, lights=Lights(high=True)).mean()
    assert on > off + 1.5
    upper = np.s_[12:17, 24:40]
    clear = shoot(camera, minute=0, lights=Lights(high=True))[upper].mean()
    clear -= shoot(camera, minute=0, lights=Lights())[upper].mean()
    fog = shoot(camera, "heavy_fog", 0, lights=Lights(high=True))[upper].mean()
    fog -= shoot(camera, "heavy_fog", 0, lights=Lights())[upper].mean()
    assert fog > clear + 1.5


def test_image_axes_are_row_major_rgb_top_first():
    red_left = [((10.0, 1.0, 0.0), (11.0, 6.0, 1.4))]
    image = shoot(camera_before(red_left, size=(64, 36)), "cloudy")
    assert image[20, 18, 0] > image[20, 18, 2] + 20  # red, left of the middle, below the horizon
    assert image[2].mean() > image[33].mean()  # the sky is on top


def test_tone_table_is_monotonic_and_ends_black_and_white():
    table = tone_table().astype(int)
    assert table[0] == 0
    assert table[-1] == 255
    assert (np.diff(table) >= 0).all()


def test_inactive_slots_are_not_rendered():
    camera = camera_before([], size=(16, 9))
    camera.lights.host[0]["active"] = 0
    pose = wp.array([[0.0, 0.0, 0.0]], dtype=wp.float64, device=CPU)
    assert not camera.render(pose).any()
    assert not camera.boxes.numpy()[..., 4].any()


def test_image_buffer_must_fit():
    with pytest.raises(ValueError, match="contiguous uint8"):
        camera_before([], size=(16, 9), image_out=np.zeros((1, 9, 16, 4), np.uint8))
