"""Boxes at the borders of pictures beside silhouettes in float64, apart from the camera's code."""

import itertools
import math

import numpy as np
import pytest
from pictures import Script, box_mesh, camera_in, flat, mesh_of, quad, world_of

from schemas.sections.lens import CameraMount, Lens
from twin.actors.motion import ObjectKind
from twin.sensors.camera.boxes import BoxSensor

WIDTH, HEIGHT = 160, 90
HALF = np.array([2.0, 1.0, 0.8])
"""Half length, width and height of the object [m]."""
LENSES = {
    "pinhole": Lens(fx=0.6),
    "barrel": Lens(model="brown_conrady", fx=0.6, k1=-0.18, k2=0.03, p1=0.001),
    "fisheye": Lens(model="fisheye", fx=0.4, k1=0.02),
}
FX = {"pinhole": 96.0, "barrel": 96.0, "fisheye": 64.0}
"""Focal lengths; the axis meets the middle of the picture [px]."""

PLACES = {
    "inside": (14.03, 0.31, 0.42),
    "left": (9.04, 5.93, 0.41),
    "right": (9.02, -6.31, -0.53),
    "bottom": (5.07, 0.43, -3.02),
    "top": (5.01, -0.74, 1.31),
    "lower left": (6.03, 4.22, -3.61),
    "upper right": (6.05, -4.43, 1.94),
    "across": (2.63, 0.24, -0.91),
    "just over the right": (12.01, -11.23, 0.12),
}
"""Middle of the object's lower side, with the camera in the origin [m]."""


def drawn_at(name, points):
    """Where points [..., 3] (x right, y down, z forward) are drawn [px]."""
    lens, fx = LENSES[name], FX[name]
    x, y, z = np.moveaxis(points, -1, 0)
    if name == "fisheye":
        across = np.maximum(np.hypot(x, y), 1e-300)
        angle = np.arctan2(across, z)
        scale = angle * (1 + lens.k1 * angle**2) / across
        u, v = x * scale, y * scale
    else:
        a, b = x / z, y / z
        q = a * a + b * b
        scale = 1 + lens.k1 * q + lens.k2 * q**2
        u = a * scale + 2 * lens.p1 * a * b
        v = b * scale + lens.p1 * (q + 2 * b * b)
    return np.stack([fx * u + WIDTH / 2, fx * v + HEIGHT / 2], axis=-1)


def rays_of(name):
    """Directions through the pixels' centres [H, W, 3]: the lens inverted by bisection along the
    radius, and for the small tangential part by fixed points."""
    centres = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1)
    wanted = (centres - (WIDTH / 2, HEIGHT / 2)) / FX[name]
    aim = wanted.copy()
    for _ in range(60):
        radius = np.linalg.norm(aim, axis=-1)
        low, high = np.zeros_like(radius), np.full_like(radius, 2.5 if name != "fisheye" else 2.0)
        for _ in range(60):
            middle = (low + high) / 2
            lens = LENSES[name]
            drawn = middle * (1 + lens.k1 * middle**2 + lens.k2 * middle**4)
            low, high = (
                np.where(drawn < radius, middle, low),
                np.where(drawn < radius, high, middle),
            )
        unit = aim / radius[..., None]
        if name == "fisheye":
            rays = np.concatenate([unit * np.sin(low)[..., None], np.cos(low)[..., None]], axis=-1)
        else:
            rays = np.concatenate([unit * low[..., None], np.ones_like(low)[..., None]], axis=-1)
        off = (drawn_at(name, rays) - centres) / FX[name]
        if np.abs(off).max() < 1e-12:
            break
        aim = aim - off
    assert np.abs(off).max() < 1e-9
    return rays


def corners_of(place, yaw):
    """Corners of the object's triangles in the camera's axes [12, 3, 3]."""
    mesh = box_mesh(tuple(HALF))
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = mesh.points_m.astype(float).T
    world = np.stack([c * x - s * y, s * x + c * y, z], axis=1) + place
    return np.stack([-world[:, 1], -world[:, 2], world[:, 0]], axis=1)[mesh.faces]


def met(rays, triangles):
    """How far inside a triangle rays go [H, W]: the smallest angle to the planes through eye and
    edges, the largest of all triangles [rad]; negative: they miss all."""
    most = np.full(rays.shape[:-1], -np.inf)
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    for corners in triangles:
        planes = np.cross(corners, np.roll(corners, -1, axis=0))
        planes /= np.linalg.norm(planes, axis=1, keepdims=True)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        ahead = (unit @ normal) * (corners[0] @ normal) > 0
        for side in (1, -1):
            inside = (side * (unit @ planes.T)).min(axis=-1)
            most = np.maximum(most, np.where(ahead, inside, -np.inf))
    return most


def around(pixels):
    """Left, top, right and bottom of the rectangle of whole pixels around those that are set."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)


def clipped(polygon, axis, limit, side):
    """The part of a convex polygon [N, n] with a coordinate up to (for -1: from) a limit."""
    kept = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        over_a, over_b = side * (a[axis] - limit), side * (b[axis] - limit)
        if over_a <= 0:
            kept.append(a)
        if (over_a < 0 < over_b) or (over_b < 0 < over_a):
            kept.append(a + (b - a) * (over_a / (over_a - over_b)))
    return np.array(kept).reshape(-1, polygon.shape[1])


def silhouette(triangles):
    """Left, top, right and bottom of what an undistorted lens draws, cut at the border."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for corners in triangles:
        part = clipped(corners, 2, 0.1, -1)  # nothing nearer is drawn
        part = drawn_at("pinhole", part)
        for axis, end in ((0, WIDTH), (1, HEIGHT)):
            for limit, side in ((0.0, -1), (end, 1)):
                if len(part):
                    part = clipped(part, axis, limit, side)
        if len(part):
            low, high = np.minimum(low, part.min(axis=0)), np.maximum(high, part.max(axis=0))
    return np.array([*low, *high])


class Shots:
    """An object before a camera in the origin."""

    def __init__(self, name):
        self.script = Script(position_m=np.zeros((1, 3)), yaw_rad=np.zeros(1))
        kind = ObjectKind("box", box_mesh(tuple(HALF)), 2.0, 1.0)
        far = quad((400, -1, -1), (400, 1, -1), (400, 1, 1), (400, -1, 1))
        world = world_of(mesh_of(*far), kinds=(kind,), motion=self.script, mover_classes=(1,))
        mount = CameraMount(position_m=[0.0, 0.0, 0.0], lens=LENSES[name])
        self.camera = camera_in(world, mount=mount, size=(WIDTH, HEIGHT))
        geometry = self.camera.geometry
        self.sensor = BoxSensor(geometry.classes, 1, geometry.device)

    def box(self, place, yaw):
        """Left, top, right and bottom, and the number of pixels."""
        self.script.columns |= {"position_m": np.array([place]), "yaw_rad": np.array([yaw])}
        self.camera.geometry.place(self.script.at(np.zeros(1)))
        self.camera.render(flat((0, 0, 0)))
        self.sensor.launch(self.camera.boxes)
        boxes, count = self.sensor.read()
        assert count[0] == 1
        _, x, y, width, height, pixels, _ = boxes[0, 0].astype(float)
        return np.array([x, y, x + width, y + height]), pixels


@pytest.mark.parametrize("name", LENSES)
def test_a_box_goes_around_the_pixels_whose_centre_rays_meet_the_object(name):
    shots, rays = Shots(name), rays_of(name)
    at_border = 0
    for place, yaw in itertools.product(PLACES.values(), (0.0, 0.5, 1.2)):
        inside = met(rays, corners_of(place, yaw))
        box, pixels = shots.box(place, yaw)
        # A ray along an edge may go either way: 1e-6 rad are a ten thousandth of a pixel.
        np.testing.assert_array_equal(box, around(inside > 1e-6))
        np.testing.assert_array_equal(box, around(inside > -1e-6))
        assert (inside > 1e-6).sum() <= pixels <= (inside > -1e-6).sum()
        at_border += int((box == (0, 0, WIDTH, HEIGHT)).any())
    assert at_border >= 6


def test_edges_lie_within_a_pixel_of_the_silhouette_and_what_goes_on_ends_at_the_border():
    """By how much an edge is off its silhouette is where its pixels lie: the same inside and beside
    a border. Where the silhouette is cut by the border the box ends there exactly."""
    shots, rng = Shots("pinhole"), np.random.default_rng(11)
    off, cut_off, cuts = [], [], 0
    while len(off) < 60 or len(cut_off) < 60:
        x = rng.uniform(6.0, 12.0)
        place = (x, rng.uniform(-1, 1) * x * 0.95, rng.uniform(-1, 1) * x * 0.5 - 0.8)
        yaw = rng.uniform(0.0, np.pi)
        edges = silhouette(corners_of(place, yaw))
        if not (edges[2:] - edges[:2] > 4.0).all():
            continue
        box, _ = shots.box(place, yaw)
        at_border = edges == (0, 0, WIDTH, HEIGHT)
        cuts += at_border.sum()
        np.testing.assert_array_equal(box[at_border], edges[at_border])
        (cut_off if at_border.any() else off).extend(np.abs(box - edges)[~at_border])
    assert cuts > 20
    assert max(off) < 1.0
    assert max(cut_off) < 1.0
    assert np.mean(np.array(off) <= 0.5) > 0.95
    assert np.mean(np.array(cut_off) <= 0.5) > 0.95
