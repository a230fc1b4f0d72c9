"""Normals, instances, semantics, textures; pictures do not depend on slots."""

import math

import numpy as np
import pytest
from pictures import (
    Script,
    box_mesh,
    camera_in,
    flat,
    joined,
    light_slot,
    mesh_of,
    quad,
    states,
    world_of,
)

from schemas.campaign import Camera
from twin.actors.motion import ObjectKind
from twin.render.camera import wanted_of
from twin.render.outputs import bytes_per_pixel
from twin.render.texture import pack_textures, srgb_to_linear

GROUND = quad((-50, -300, -1.5), (600, -300, -1.5), (600, 300, -1.5), (-50, 300, -1.5))


def test_normals_are_in_the_axes_of_the_camera():
    wall = quad((10, -40, -9), (10, 40, -9), (10, 40, 20), (10, -40, 20))
    world = world_of(mesh_of(*joined(GROUND, wall)))
    camera = camera_in(world, outputs=["normal", "depth"])
    camera.render(flat((0, 0, 0.3)))
    normal, depth = camera.outputs["normal"][0], camera.outputs["depth"][0]
    seen = np.isfinite(depth)
    np.testing.assert_allclose(np.linalg.norm(normal[seen], axis=1), 1.0, atol=1e-5)
    assert (normal[~seen] == 0.0).all()
    on_ground = seen & (normal[..., 1] < -0.5)
    np.testing.assert_allclose(normal[on_ground], [[0.0, -1.0, 0.0]] * on_ground.sum(), atol=1e-6)
    # The vehicle has turned left by 0.3: the wall turns to the right of the picture.
    on_wall = seen & ~on_ground
    expected = [-math.sin(0.3), 0.0, -math.cos(0.3)]
    np.testing.assert_allclose(normal[on_wall], [expected] * on_wall.sum(), atol=1e-5)
    assert on_wall.any()
    assert on_ground.any()


def test_instances_and_semantics():
    left = quad((10, 1, -1), (10, 5, -1), (10, 5, 1), (10, 1, 1))
    right = quad((10, -5, -1), (10, -1, -1), (10, -1, 1), (10, -5, 1))
    points, faces = joined(left, right)
    mesh = mesh_of(
        points,
        faces,
        instance=np.array([3, 3, -1, -1], np.int32),
        semantic=np.array([5, 5, 7, 7], np.int32),
    )
    camera = camera_in(world_of(mesh, instances=4), outputs=["instance", "semantic"])
    camera.render(flat((0, 0, 0)))
    instance, semantic = camera.outputs["instance"][0], camera.outputs["semantic"][0]
    columns = np.arange(64) + 0.5 - 32
    # y is left: 1 to 5 m at 10 m, 32 px focal length.
    inside = (columns < -3.2) & (columns > -16.0)
    np.testing.assert_array_equal(instance[18], np.where(inside, 3, -1))
    other = (columns > 3.2) & (columns < 16.0)
    np.testing.assert_array_equal(semantic[18], np.where(inside, 5, np.where(other, 7, 0)))
    assert (instance[0] == -1).all()
    assert instance.dtype == np.int32
    assert semantic.dtype == np.uint8


def moving_box(speed=6.0, yaw=0.0, yaw_rate=0.0, x=20.0):
    kind = ObjectKind("box", box_mesh((1.0, 1.5, 1.0)), 1.0, 1.5)
    script = Script(
        position_m=np.array([[x, 0.0, -1.0]]),
        velocity_mps=np.array([[0.0, speed, 0.0]]),
        yaw_rad=np.array([yaw]),
        yaw_rate_radps=np.array([yaw_rate]),
    )
    return world_of(mesh_of(*GROUND), kinds=(kind,), motion=script, mover_classes=(1,))


def test_flow_of_an_object_that_moves():
    world = moving_box()
    camera = camera_in(world, outputs=["flow", "instance"], hz=20)
    for y in (-0.3, 0.0):
        world.motion.columns["position_m"] = np.array([[20.0, y, -1.0]])
        camera.geometry.place(world.motion.at(np.zeros(1)))
        camera.render(flat((0, 0, 0)))
    flow, instance = camera.outputs["flow"][0], camera.outputs["instance"][0]
    assert (instance == 0).sum() > 8
    # It was 0.3 m further right; its front is 19 m away, the focal length 32 px.
    np.testing.assert_allclose(flow[instance == 0][:, 0], -0.3 / 19.0 * 32.0, atol=4e-3)
    np.testing.assert_allclose(flow[instance == 0][:, 1], 0.0, atol=4e-3)
    assert np.abs(flow[instance == -1]).max() < 1e-3


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_objects_are_met_where_they_are(yaw):
    camera = camera_in(moving_box(yaw=yaw), outputs=["depth", "normal", "instance"], size=(128, 72))
    geometry = camera.geometry
    geometry.place(geometry.world.motion.at(np.zeros(1)))
    camera.render(flat((0, 0, 0)))
    depth, normal = camera.outputs["depth"][0], camera.outputs["normal"][0]
    on = camera.outputs["instance"][0] == 0
    rays = camera._rays.numpy()[on].astype(float)
    direction = np.stack([rays[:, 2], -rays[:, 0], -rays[:, 1]], 1)
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    origin = (np.zeros(3) - [20.0, 0.0, -1.0]) @ turn
    local = direction @ turn
    low, high = np.array([-1, -1.5, 0]), np.array([1, 1.5, 2])
    with np.errstate(divide="ignore"):
        a, b = (low - origin) / local, (high - origin) / local
    entry = np.minimum(a, b)
    t = entry.max(axis=1)
    assert on.sum() > 30
    np.testing.assert_allclose(depth[on], t * rays[:, 2], rtol=1e-4)
    side = entry.argmax(axis=1)
    facing = np.zeros((on.sum(), 3))
    facing[np.arange(on.sum()), side] = -np.sign(local[np.arange(on.sum()), side])
    world = facing @ turn.T
    expected = np.stack([-world[:, 1], -world[:, 2], world[:, 0]], 1)
    np.testing.assert_allclose(normal[on], expected, atol=1e-5)


@pytest.mark.parametrize("weather", ["clear", "cloudy"])
def test_objects_shadow_the_ground(weather):
    """The sun stands left of the box; under clouds only the sky is missing at its foot."""
    camera = camera_in(moving_box(x=8.0), size=(128, 72))
    light_slot(camera, 0, weather, sun_direction=(0.0, 0.8, 0.6))
    open_ground = camera.render(flat((0, 0, 0)))[0].astype(float).mean(axis=2)
    geometry = camera.geometry
    geometry.place(geometry.world.motion.at(np.zeros(1)))
    change = camera.render(flat((0, 0, 0)))[0].astype(float).mean(axis=2) - open_ground

    def at(x, y):  # pixel of a point on the ground
        return change[int(36 + 64 * 1.5 / x), int(64 - 64 * y / x)]

    if weather == "clear":
        assert at(8.0, -2.6) < -25.0  # in the shadow
    else:
        assert -30.0 < at(8.0, -1.6) < -3.0  # at the foot
    assert abs(at(8.0, 3.5)) < 1.5
    assert abs(at(5.0, 0.0)) < 1.5


def test_bytes_do_not_depend_on_slot_batch_or_neighbours():
    world = moving_box()
    wide = camera_in(world, slots=5, outputs=["depth", "flow"], effects=[])
    weathers = ["clear", "heavy_rain", "heavy_fog", "light_snow", "cloudy"]
    minutes = [720, 1300, 1200, 600, 300]
    poses = [(0.0, 0.0, 0.0), (1.0, 0.5, 0.1), (3.0, 0.0, -0.1), (5.0, 1.0, 0.0), (7.0, -1.0, 0.0)]
    for slot in range(5):
        light_slot(wide, slot, weathers[slot], minutes[slot], key=slot + 9, noise=1, tick=3)
    geometry = wide.geometry
    geometry.place(geometry.world.motion.at(np.zeros(5)))
    together = wide.render(flat(*poses)).copy()
    order = [3, 0, 4, 2, 1]
    for slot, case in enumerate(order):
        light_slot(wide, slot, weathers[case], minutes[case], key=case + 9, noise=1, tick=3)
    again = wide.render(flat(*(poses[case] for case in order))).copy()
    for slot, case in enumerate(order):
        assert again[slot].tobytes() == together[case].tobytes()
    for case in range(5):
        alone = camera_in(world, outputs=["depth", "flow"])
        light_slot(alone, 0, weathers[case], minutes[case], key=case + 9, noise=1, tick=3)
        alone.geometry.place(world.motion.at(np.zeros(1)))
        assert alone.render(flat(poses[case]))[0].tobytes() == together[case].tobytes()


def test_pictures_in_several_chunks(monkeypatch):
    world = moving_box()
    whole = camera_in(world, slots=5)
    monkeypatch.setattr("twin.render.trace.visibility.CHUNK_PIXELS", 2 * 64 * 36)
    parts = camera_in(world, slots=5)
    assert parts._chunk == 2
    poses = flat(*((float(s), 0.0, 0.0) for s in range(5)))
    assert parts.render(poses).tobytes() == whole.render(poses).tobytes()
    assert parts.rays_per_frame() >= 64 * 36


def test_textures_are_bilinear_in_linear_light():
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 0], image[0, 1] = (255, 0, 0), (0, 255, 0)  # upper row
    image[1, 0], image[1, 1] = (0, 0, 255), (255, 255, 255)
    wall = quad((10, 10, -10), (10, -10, -10), (10, -10, 10), (10, 10, 10))
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    mesh = mesh_of(
        *wall, texture=np.zeros(2, np.int32), uv=uv, color=np.full((2, 3), 0.9, np.float32)
    )
    camera = camera_in(world_of(mesh, textures=(image,)), size=(64, 64))
    light_slot(camera, 0, "cloudy")
    picture = camera.render(flat((0, 0, 0)))[0].astype(float)
    quarters = [picture[16, 16], picture[16, 48], picture[48, 16], picture[48, 48]]
    assert quarters[0].argmax() == 0
    assert quarters[0][1] < 35  # air and sky light
    assert quarters[1].argmax() == 1
    assert quarters[2].argmax() == 2
    assert np.ptp(quarters[3]) < 40
    middle = picture[31:33, 31:33].reshape(-1, 3).mean(axis=0)
    assert (middle > 0.4 * quarters[3].max()).all()  # a mixture of all four


def test_coarse_levels_keep_the_mean_light():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (16, 8, 3)).astype(np.uint8)
    from pictures import CPU

    packed = pack_textures((image,), CPU)
    row = packed.images.numpy()[0]
    texels = packed.texels.numpy()
    assert row["levels"] == 5
    assert len(texels) == 128 + 32 + 8 + 2 + 1
    linear = srgb_to_linear()
    mean = linear[image].mean(axis=(0, 1))
    np.testing.assert_allclose(linear[(texels[-1] >> np.arange(0, 24, 8)) & 255], mean, atol=0.01)


def test_outputs_have_their_types_and_memory_is_known():
    outputs = ["depth", "instance", "semantic", "normal", "flow"]
    camera = camera_in(world_of(mesh_of(*GROUND)), slots=2, outputs=outputs)
    camera.render(flat((0, 0, 0), (0, 0, 0)))
    found = {name: (a.dtype.str, a.shape) for name, a in camera.outputs.items()}
    assert found == {
        "depth": ("<f4", (2, 36, 64)),
        "instance": ("<i4", (2, 36, 64)),
        "semantic": ("|u1", (2, 36, 64)),
        "normal": ("<f4", (2, 36, 64, 3)),
        "flow": ("<f4", (2, 36, 64, 2)),
    }
    lean = bytes_per_pixel(wanted_of(Camera(width=64, height=36)))
    rich = bytes_per_pixel(wanted_of(Camera(width=64, height=36, outputs=outputs)))
    assert rich - lean == 4 + 4 + 1 + 12 + 8


def test_states_and_level_poses_agree():
    world = moving_box()
    camera = camera_in(world)
    yaw = 0.3
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    level = camera.render(flat((2.0, 1.0, yaw))).copy()
    body = camera.render(states([(2.0, 1.0, 0.0)], [turn]))
    assert (np.abs(level.astype(int) - body) <= 1).mean() > 0.999


def test_effects_work_on_linear_light():
    world = moving_box()
    plain = camera_in(world, hfov_deg=30.0)
    full = camera_in(world, hfov_deg=30.0, effects=["all"])
    for camera in (plain, full):
        light_slot(camera, 0)
        camera.geometry.place(world.motion.at(np.zeros(1)))
        camera.render(flat((0, 0, 0)))
    a, b = (camera.render(flat((0.05, 0, 0)))[0].astype(float) for camera in (plain, full))
    assert 0.5 < np.abs(a - b).mean() < 25.0
