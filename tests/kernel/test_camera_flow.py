"""Optical flow beside projections in float64 that share no code with the camera."""

import math

import numpy as np
import pytest
from pictures import (
    Script,
    box_mesh,
    camera_in,
    joined,
    light_slot,
    mesh_of,
    quad,
    states,
    world_of,
)

from schemas.sections.lens import CameraMount, Lens
from twin.actors.motion import ObjectKind

PX_MAX = 0.02
"""Largest difference [px]."""
SIZE = (160, 90)
HZ = 20
GROUND_Z, WALL_X = -1.5, 30.0
HALF = np.array([2.0, 1.0, 0.8])
"""Half length, width and height of the box [m]."""

LENSES = {
    "pinhole": (Lens(), 80.0),
    "off centre": (Lens(fx=0.7, fy=1.1, cx=0.3, cy=0.6), 80.0),
    "frustum": (
        Lens(model="frustum", near_m=0.1, left_m=-0.1, right_m=0.06, top_m=0.05, bottom_m=-0.04),
        80.0,
    ),
    "barrel": (Lens(model="brown_conrady", k1=-0.18, k2=0.03, p1=0.001, p2=-0.002), 80.0),
    "rational": (Lens(model="brown_conrady", k1=0.3, k2=0.02, k4=0.4, k5=0.05, p2=0.002), 95.0),
    "fisheye": (Lens(model="fisheye", k1=0.02), 150.0),
    "whole circle": (Lens(model="fisheye", fx=0.24, k1=0.05, k2=-0.01, circle_deg=190.0), 180.0),
}


def focal(lens, hfov_deg):
    """fx, fy, cx, cy [px]."""
    width, height = SIZE
    if lens.model == "frustum":
        across, down = lens.right_m - lens.left_m, lens.top_m - lens.bottom_m
        return (
            width * lens.near_m / across,
            height * lens.near_m / down,
            -width * lens.left_m / across,
            height * lens.top_m / down,
        )
    if lens.fx:
        fx = lens.fx * width
    else:
        half = math.radians(hfov_deg / 2)
        edge = half if lens.model == "fisheye" else math.tan(half)
        fx = width / 2 / (edge * stretch(lens, edge**2))
    fy = lens.fy * height if lens.fy else fx
    return fx, fy, lens.cx * width, lens.cy * height


def stretch(lens, q):
    """How much farther out the lens draws than an ideal one, over the squared radius or angle."""
    if lens.model == "fisheye":
        return 1 + lens.k1 * q + lens.k2 * q**2 + lens.k3 * q**3 + lens.k4 * q**4
    above = 1 + lens.k1 * q + lens.k2 * q**2 + lens.k3 * q**3
    return above / (1 + lens.k4 * q + lens.k5 * q**2 + lens.k6 * q**3)


def drawn_at(lens, hfov_deg, points):
    """Where points [..., 3] (x right, y down, z forward) are drawn [px]; NaN: nowhere."""
    fx, fy, cx, cy = focal(lens, hfov_deg)
    x, y, z = np.moveaxis(points, -1, 0)
    if lens.model == "fisheye":
        across = np.maximum(np.hypot(x, y), 1e-300)
        angle = np.arctan2(across, z)
        angle = np.where(angle <= math.radians(lens.circle_deg) / 2, angle, np.nan)
        radius = angle * stretch(lens, angle**2)
        u, v = x / across * radius, y / across * radius
    else:
        z = np.where(z > 0, z, np.nan)
        a, b = x / z, y / z
        q = a * a + b * b
        u = a * stretch(lens, q) + 2 * lens.p1 * a * b + lens.p2 * (q + 2 * a * a)
        v = b * stretch(lens, q) + lens.p1 * (q + 2 * b * b) + 2 * lens.p2 * a * b
    return np.stack([fx * u + cx, fy * v + cy], axis=-1)


def turn(yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def tilt(yaw, pitch):
    """World from vehicle, and its quaternion; pitch: nose down."""
    c, s = math.cos(pitch), math.sin(pitch)
    matrix = turn(yaw) @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    half = np.array(
        [math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)]
    )
    cy, sy, cp, sp = half
    return matrix, (-sy * sp, cy * sp, sy * cp, cy * cp)


AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Vehicle from camera, without rotation."""
MOUNT_M = (1.0, 0.2, 0.4)


class Rides:
    """Two pictures: of a car that drives, turns and dips, and of a box that turns and brakes."""

    def __init__(self, lens, hfov_deg, far_x=0.0):
        self.lens, self.hfov_deg = lens, hfov_deg
        self.cars = [
            (np.array([far_x, 0.0, 0.0]), 0.0, 0.0),
            (np.array([far_x + 0.8, 0.05, -0.01]), 0.02, 0.01),
        ]
        self.boxes = [
            (np.array([far_x + 8.0, 1.9, GROUND_Z]), 0.60),
            (np.array([far_x + 8.35, 1.6, GROUND_Z]), 0.68),
        ]
        self.wall_x = far_x + WALL_X

    def pictures(self, *, held_between=False, appears=False):
        """Flow and instances of the second picture, and the rays.

        ``held_between``: further pictures are made meanwhile, without the slot; ``appears``: the
        box is not in the first picture.
        """
        low, high = self.wall_x - 200, self.wall_x + 300
        ground = [(low, -300), (high, -300), (high, 300), (low, 300)]
        wall = [(-60, -9), (60, -9), (60, 30), (-60, 30)]
        static = joined(
            quad(*((x, y, GROUND_Z) for x, y in ground)),
            quad(*((self.wall_x, y, z) for y, z in wall)),
        )
        # Velocities are those of the later moment: what it did in between is not in them.
        script = Script(
            position_m=self.boxes[0][0][None],
            yaw_rad=np.array([self.boxes[0][1]]),
            velocity_mps=np.array([[4.0, -3.0, 0.0]]),
            yaw_rate_radps=np.array([2.5]),
        )
        kind = ObjectKind("box", box_mesh(tuple(HALF)), 2.0, 1.0)
        world = world_of(mesh_of(*static), kinds=(kind,), motion=script, mover_classes=(1,))
        camera = camera_in(
            world,
            mount=CameraMount(position_m=list(MOUNT_M), lens=self.lens),
            size=SIZE,
            hfov_deg=self.hfov_deg,
            outputs=["flow", "instance"],
            hz=HZ,
        )
        light_slot(camera, 0)
        for number, (car, box) in enumerate(zip(self.cars, self.boxes, strict=True)):
            script.columns["position_m"], script.columns["yaw_rad"] = box[0][None], box[1]
            script.columns["kind"] = -1 if appears and number == 0 else 0
            camera.geometry.place(script.at(np.zeros(1)))
            if held_between and number == 1:
                self._pictures_without(camera)
            camera.render(states([car[0]], [tilt(*car[1:])[1]]))
            if number == 0:
                first = np.abs(camera.outputs["flow"][0])
                assert first.max() < 1e-3, "no picture is before the first"
        flow, instance = camera.outputs["flow"][0], camera.outputs["instance"][0]
        return flow.astype(float), instance, camera._rays.numpy().astype(float)

    def _pictures_without(self, camera):
        camera.hold(0, held=True)
        camera.lights.host[0]["active"] = 0
        for _ in range(2):
            camera.render(states([(50.0, 1.0, 0.0)], [tilt(0.3, 0.0)[1]]))
        camera.lights.host[0]["active"] = 1
        camera.hold(0, held=False)

    def expected(self, rays):
        """Flow [H, W, 2], NaN where unknown; 0 ground, 1 wall, 2 box, -1 sky; clear of edges."""
        place, yaw, pitch = self.cars[1]
        attitude = tilt(yaw, pitch)[0]
        eye = place + attitude @ MOUNT_M
        along = rays @ (attitude @ AXES).T
        lengths, clear = self._lengths(eye, along)
        surface = np.where(np.isfinite(lengths).any(axis=0), lengths.argmin(axis=0), -1)
        t = np.where(surface >= 0, lengths.min(axis=0), 1e9)
        points = eye + along * t[..., None]
        (then, angle), (now, angle_now) = self.boxes
        carried = (points - now) @ turn(angle_now) @ turn(angle).T + then
        points = np.where((surface == 2)[..., None], carried, points)
        place, yaw, pitch = self.cars[0]
        attitude = tilt(yaw, pitch)[0]
        seen = (points - (place + attitude @ MOUNT_M)) @ (attitude @ AXES)
        here = np.stack(np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5), axis=-1)
        off = drawn_at(self.lens, self.hfov_deg, rays) - here
        with_rays = (rays != 0).any(axis=-1)
        assert np.abs(off[with_rays]).max() < 1e-3, "the rays go through the pixels' centres"
        flow = here - drawn_at(self.lens, self.hfov_deg, seen)
        flow[~with_rays] = np.nan
        return flow, surface, clear

    def _lengths(self, eye, along):
        """Ways along the rays to ground, wall and box, infinite if missed; and whether a little
        beside the ray the box is met or missed just so."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = (GROUND_Z - eye[2]) / along[..., 2]
            wall = (self.wall_x - eye[0]) / along[..., 0]
            at = eye + along * wall[..., None]
            wall = np.where((np.abs(at[..., 1]) <= 60) & (at[..., 2] <= 30), wall, np.inf)
            at = eye + along * ground[..., None]
            ground = np.where(
                (np.abs(at[..., 1]) <= 300) & (np.abs(at[..., 0] - self.wall_x) < 199),
                ground,
                np.inf,
            )
            place, yaw = self.boxes[1]
            origin, local = (eye - place) @ turn(yaw), along @ turn(yaw)
            low, high = np.array([-HALF[0], -HALF[1], 0.0]), HALF * (1, 1, 2)
            a, b = (low - origin) / local, (high - origin) / local
        enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        box = np.where((enter <= leave) & (enter > 0), enter, np.inf)
        lengths = np.stack([ground, wall, box])
        lengths = np.where(lengths > 0, lengths, np.inf)
        return lengths, np.abs(enter - leave) > 0.02


def differences(rides):
    """Largest difference of a pixel's two coordinates [px], where the flow is known; what is known,
    what came from outside the picture, and what is the box."""
    flow, instance, rays = rides.pictures()
    expected, surface, clear = rides.expected(rays)
    np.testing.assert_array_equal((instance == 0)[clear], (surface == 2)[clear])
    # A way longer than the picture is cut to it.
    known = clear & (np.abs(expected) < SIZE).all(axis=-1)
    here = np.stack(np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5), axis=-1)
    old = here - expected
    outside = known & ((old < 0) | (old > SIZE)).any(axis=-1)
    assert known.sum() > 0.99 * (clear & (rays != 0).any(axis=-1)).sum()
    assert np.nanmax(np.abs(expected[known])) > 2.0
    return np.abs(flow - expected).max(axis=-1), known, outside, known & (surface == 2)


@pytest.mark.parametrize("name", LENSES)
def test_flow_is_what_projection_in_float64_gives_up_to_the_border_and_beyond(name):
    difference, known, outside, box = differences(Rides(*LENSES[name]))
    assert box.sum() > 200, "a box that turned and braked meanwhile is seen"
    # Nothing comes from outside of a whole circle; a rim of the lens is in the picture there.
    assert outside.sum() >= (0 if name == "whole circle" else 40)
    assert difference[known].max() < PX_MAX


def test_a_kilometre_from_the_origin_flow_keeps_its_digits():
    difference, known, _, _ = differences(Rides(*LENSES["pinhole"], far_x=1000.0))
    assert difference[known].max() < PX_MAX


def test_flow_of_a_slot_that_was_held_begins_at_its_own_last_picture():
    rides = Rides(*LENSES["pinhole"])
    expected = rides.pictures()[0]
    held = rides.pictures(held_between=True)[0]
    np.testing.assert_array_equal(held, expected)


def test_an_object_that_appears_comes_from_where_its_speed_says():
    lens, hfov_deg = LENSES["pinhole"]
    rides = Rides(lens, hfov_deg)
    # Its middle goes straight while it turns.
    rides.boxes[0] = (rides.boxes[1][0] - np.array([4.0, -3.0, 0.0]) / HZ, 0.68 - 2.5 / HZ)
    there = rides.pictures()[0]
    appears = rides.pictures(appears=True)[0]
    np.testing.assert_allclose(appears, there, atol=PX_MAX)
