"""Labels of a dataset against geometry: edges, visibility, truncation, contrast."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from schemas.messages import SEMANTIC_CLASSES
from schemas.sections.lens import Lens
from schemas.sections.lens_projection import project
from twin.dataset.images.cameras import eyes_of
from twin.dataset.images.cast import streets_of
from twin.dataset.images.eyepoint import EyeView, eyepoint_of, outlines_of
from twin.dataset.images.pose import VehiclePose, attitude
from twin.dataset.images.shot import plan_shot
from twin.dataset.images.studio import Studio
from twin.dataset.images.traffic import Placed
from twin.dataset.labels import contrast
from twin.dataset.recipe import DatasetRecipe, Streets
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.meshes.materials import SIGN
from twin.world.meshes.mesh import DECAL
from twin.world.sky.weather import PRESETS

RECIPE = DatasetRecipe(seed=4, cameras=4, streets=Streets(train=1, held_out=1))
VEHICLE = load_vehicle("opencav")
EYES = eyes_of(RECIPE, VEHICLE)
EGO = VehiclePose(40.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PINHOLE, FISHEYE, BROWN = 0, 3, 2


@pytest.fixture(scope="module")
def street():
    return streets_of(RECIPE, "train")[0]


@pytest.fixture(scope="module")
def studio(street):
    return Studio(RECIPE, street, VEHICLE, EYES, 2, wp.get_device("cpu"))


def look_of(street, kind):
    return next(i for i, look in enumerate(street.cast) if look.kind == kind)


def standing(street, kind, x_m, y_m, yaw_rad=0.0):
    name = {"van": "car", "cyclist": "bicycle"}.get(kind, kind)
    return Placed(look_of(street, kind), name, x_m, y_m, 0.0, yaw_rad, 0.0, -1, 0.0, 0.0)


def shot_of(street, *placed, eye=PINHOLE, pose=EGO):
    drawn = plan_shot(RECIPE, VEHICLE, [street], "train", 0)
    return replace(
        drawn,
        street=0,
        eye=eye,
        date="2025-06-21",
        minute=720,
        weather="clear",
        conditions=PRESETS["clear"],
        pose=pose,
        speed_mps=0.0,
        placed=placed,
    )


def labels(studio, shot, class_name):
    category = ["car", "truck", "bus", "pedestrian", "bicycle"].index(class_name) + 1
    (taken,) = studio.take([shot])
    own = [row for row in taken.annotations if row["category_id"] == category]
    return [row for row in own if row["distance_m"] < 60.0]  # not the broken-down car


def drawn_box(studio, street, shot, eye):
    """Rectangle around the projected vertices of the only object, and how near it is [m]."""
    one = shot.placed[0]
    kind = studio._world.kinds[int(studio._kinds[one.look])]
    c, s = math.cos(one.yaw_rad), math.sin(one.yaw_rad)
    faces = kind.mesh.faces[kind.mesh.tag != DECAL]
    points = kind.mesh.points_m[np.unique(faces)].astype(float)
    points = points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + (one.x_m, one.y_m, one.z_m)
    view = eyepoint_of(*attitude(shot.pose), eye.mount)
    spec = eye.camera
    px, _ = project(
        eye.mount.lens, spec.width, spec.height, spec.hfov_deg, view.camera_from_world(points)
    )
    nearest_m = float(np.linalg.norm(view.camera_from_world(points), axis=1).min())
    return (*px.min(axis=0), *px.max(axis=0)), nearest_m


@pytest.mark.slow
@pytest.mark.parametrize("eye", [PINHOLE, BROWN, FISHEYE])
@pytest.mark.parametrize("pose", [EGO, VehiclePose(40.0, 0.3, 0.12, 0.2, 0.04, -0.03)])
def test_box_edges_are_those_of_the_projected_mesh(studio, street, eye, pose):
    shot = shot_of(street, standing(street, "car", 58.0, 0.4, 0.3), eye=eye, pose=pose)
    (found,) = labels(studio, shot, "car")
    (x0, y0, x1, y1), nearest_m = drawn_box(studio, street, shot, EYES[eye])
    x, y, width, height = found["bbox"]
    # A pixel is seen when its centre is: half a pixel, and as much for thin tips.
    assert (x, y, x + width, y + height) == pytest.approx((x0, y0, x1, y1), abs=1.3)
    assert found["visibility"] > 0.97
    assert found["truncation"] == 0.0
    assert found["ignore"] == 0
    assert found["distance_m"] == pytest.approx(nearest_m, abs=0.25)  # between two rays


@pytest.mark.slow
def test_visibility_falls_as_something_covers_the_object(studio, street):
    car = standing(street, "car", 66.0, 0.0)
    shares = []
    for y_m in (-6.0, -1.9, -1.4, -0.9, -0.3):
        bus = standing(street, "bus", 56.0, y_m)
        found = labels(studio, shot_of(street, car, bus), "car")
        shares.append(found[0]["visibility"] if found else 0.0)
        if found:
            assert found[0]["visible_px"] <= found[0]["unoccluded_px"]
            full, seen = found[0]["full_bbox"], found[0]["bbox"]
            assert full[0] <= seen[0]
            assert full[0] + full[2] >= seen[0] + seen[2]
    assert shares[0] > 0.97
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 0.15
    assert any(0.2 < share < 0.8 for share in shares), shares


def test_what_is_counted_alone_does_not_change_with_what_covers_it(studio, street):
    car = standing(street, "car", 66.0, 0.0)
    free = labels(studio, shot_of(street, car), "car")[0]
    hidden = labels(studio, shot_of(street, car, standing(street, "bus", 56.0, -1.4)), "car")[0]
    assert abs(hidden["unoccluded_px"] - free["unoccluded_px"]) <= 2
    assert hidden["visible_px"] < 0.9 * free["visible_px"]


@pytest.mark.parametrize("eye", [PINHOLE, BROWN, FISHEYE])
def test_an_object_across_the_edge_is_half_outside(studio, street, eye):
    spec, lens = EYES[eye].camera, EYES[eye].mount.lens
    view = EyeView(lens, spec.width, spec.height, spec.hfov_deg)
    seat = eyepoint_of(*attitude(EGO), EYES[eye].mount)
    shares = []
    for y_m in np.arange(2.0, 26.0, 0.5):
        shot = shot_of(street, standing(street, "car", 55.0, float(y_m)), eye=eye)
        (x0, _, x1, _), _ = drawn_box(studio, street, shot, EYES[eye])
        subject = studio._subject(shot, studio._world.first_mover, seat)
        (outline,) = outlines_of(view, [subject.shape(studio._bodies)])
        share = outline.truncation
        shares.append(share)
        if np.isfinite([x0, x1]).all() and lens.model == "pinhole":
            outside = -min(x0, 0.0) / (x1 - min(x0, x1))
            assert share == pytest.approx(min(outside, 1.0), abs=0.12)
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] == 1.0 or eye == FISHEYE


def test_truncation_of_a_plate_is_exact():
    """A small plate far away, of which a known part lies outside the image."""
    view = EyeView(Lens(), 200, 100, 90.0)
    edge = 50.0  # the right edge of the image at z = 50

    def plate(low, high):
        a, b, c, d = (low, 0, 50), (high, 0, 50), (high, 1, 50), (low, 1, 50)
        strips = np.linspace(0.0, 1.0, 101)
        corners = np.array([[a, b, c], [a, c, d]], float)
        parts = []
        for u, v in pairwise(strips):
            part = corners.copy()
            part[..., 0] = np.where(
                corners[..., 0] == low, low + u * (high - low), low + v * (high - low)
            )
            parts.append(part)
        return np.concatenate(parts)

    for outside in (0.0, 0.25, 0.6, 1.0):
        corners = plate(edge - 1 + outside, edge + outside)
        shape = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
        found = outlines_of(view, [shape])[0].truncation
        assert found == pytest.approx(outside, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("eye", [PINHOLE, FISHEYE])  # without and with all effects
def test_slots_do_not_see_each_other(studio, street, eye):
    near = shot_of(street, standing(street, "car", 52.0, 0.0), eye=eye)
    far = shot_of(street, standing(street, "truck", 70.0, 0.5), eye=eye)
    near, far = replace(near, speed_mps=9.0), replace(far, index=1, speed_mps=3.0)
    together = [(t.image.copy(), t.annotations) for t in studio.take([near, far])]
    for shot, (image, rows) in zip((near, far), together, strict=True):
        (alone,) = studio.take([shot])
        assert np.array_equal(alone.image, image)
        assert alone.annotations == rows


def test_contrast_is_that_of_means_or_of_the_object_itself():
    image = np.full((40, 60, 3), 90, np.uint8)
    instances = np.full((40, 60), -1, np.int32)
    instances[10:20, 20:40] = 7
    box = (20, 10, 20, 10)
    assert contrast(image, instances, 7, box) == 0.0
    image[10:20, 20:40, 1] = 120
    assert contrast(image, instances, 7, box) == 30.0
    image[...] = 90
    image[10:20, 20:30], image[10:20, 30:40] = 60, 120
    assert contrast(image, instances, 7, box) > 20.0


@pytest.mark.slow
def test_a_sign_is_a_label_from_its_front_only(studio, street):
    mesh = studio._world.mesh
    signs = np.unique(mesh.instance[mesh.semantic == SEMANTIC_CLASSES.index("traffic_sign")])
    seen = {"front": 0, "back": 0}
    for sign in signs[signs >= 0].tolist():
        corners = mesh.points_m[mesh.faces[(mesh.instance == sign) & (mesh.material == SIGN)]]
        x, y, _ = corners.reshape(-1, 3).mean(axis=0).tolist()
        a, b, c = corners[0]
        front = np.cross(b - a, c - a)
        yaw = math.atan2(-front[1], -front[0])
        for side, turn in (("front", 0.0), ("back", math.pi)):
            # The camera sits 2 m before the axle; it looks at the plate from 8 m.
            ahead = (math.cos(yaw + turn), math.sin(yaw + turn))
            pose = VehiclePose(x - 10.0 * ahead[0], y - 10.0 * ahead[1], yaw + turn, 0.0, 0.0, 0.0)
            (taken,) = studio.take([shot_of(street, pose=pose)])
            for row in taken.annotations:
                here = row["category_id"] == 6 and 7.0 < row["distance_m"] < 8.4
                if here and abs(row["bbox"][0] + row["bbox"][2] / 2 - 170) < 25:
                    assert ("behind" in row["ignored_for"]) == (side == "back")
                    seen[side] += 1
    assert min(seen.values()) >= 2, seen
