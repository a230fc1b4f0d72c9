"""Camera boxes as places on the road: distance by foot point and by size, ends by the box's edges.

The pinhole of the camera and a flat road, as the reference stack's planner has them
(:mod:`devkit.reference.planning`), but two measures of a distance: the foot point fails when the
car pitches, the size when a label is of something larger. They are weighed by their variances.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from devkit.fusion.parameters import FusionSensors
from devkit.fusion.path import CarPath
from devkit.fusion.sightings import LABELS, Sightings
from devkit.reference.planning import SHAPES
from devkit.reference.view import CameraView
from schemas.messages import Detection

BOXES_TAKEN_MAX = 32
"""Most boxes of a picture that are looked at; the nearest count."""
PITCH_RAD = 0.01
"""Deviation of the camera's pitch against the road, which a foot point suffers from [rad]."""
EDGE_PX = 1.0
"""Deviation of a box's edge [px]; with :data:`EDGE_RATIO`."""
EDGE_RATIO = 0.04
"""The same, relative to the side of the box [-]."""
SIZE_RATIO = 0.15
"""Deviation of the height of objects of one label, relative to it [-]."""
BORDER_PX = 1.5
"""A box that ends as near to the border of the picture goes on beyond it [px]."""
X_MAX_M = 120.0
"""Objects further ahead are left out [m]."""


def place_boxes(
    seen: Sightings,
    slot: int,
    detections: Sequence[Detection],
    view: CameraView,
    path: CarPath,
    corridor_half_m: float,
    sensors: FusionSensors,
) -> None:
    """Write the objects of one picture into row ``slot`` of ``seen``, the nearest first."""
    rows = []
    for place, box in enumerate(detections):
        if box.label not in SHAPES or box.confidence < sensors.confidence_min:
            continue
        if box.height_px < sensors.height_min_px:
            continue
        distance = distance_m(box, view)
        if distance is None or not 0.0 < distance[0] < X_MAX_M:
            continue
        right_m, left_m = ends_m(box, view, distance[0])
        x_m = view.forward_m + distance[0]
        rows.append((x_m, distance[1], right_m, left_m, LABELS.index(box.label), place))
    if not rows:
        return
    rows.sort()
    taken = slice(min(len(rows), BOXES_TAKEN_MAX))
    columns = zip(*rows[taken], strict=True)
    x, sigma, right, left, label, places = (np.array(column) for column in columns)
    seen.valid[slot, taken] = True
    seen.x_m[slot, taken] = seen.path_x_m[slot, taken] = x
    seen.sigma_m[slot, taken], seen.label[slot, taken], seen.place[slot, taken] = (
        sigma, label, places,
    )  # fmt: skip
    seen.right_m[slot, taken], seen.left_m[slot, taken] = right, left
    seen.inside[slot, taken] = path.holds(x, right, left, corridor_half_m)


def distance_m(box: Detection, view: CameraView) -> tuple[float, float] | None:
    """Distance of a box's near end before the camera and its deviation [m]; None: it stands
    nowhere.

    By the foot point at the angle a below the horizon: h / a, with a deviation of
    d^2 / h x sqrt(pitch^2 + edge^2). By the size: f H / (height of the box). A box that the
    picture's border cuts off tells only what is left of it.
    """
    bottom_px = box.y_px + box.height_px
    foot_m = view.ground_m(box.x_px + 0.5 * box.width_px, bottom_px)
    focal_px = view.lens.fy_px
    edge_px = EDGE_PX + EDGE_RATIO * box.height_px
    cut = bottom_px >= view.height_px - BORDER_PX
    information, weighted = 0.0, 0.0
    if foot_m is not None and not cut:
        edge_rad = edge_px / focal_px
        sigma = (
            foot_m * foot_m / view.above_m * math.sqrt(PITCH_RAD * PITCH_RAD + edge_rad * edge_rad)
        )
        weight = 1.0 / (sigma * sigma)
        information, weighted = weight, weight * foot_m
    if not cut and box.y_px > BORDER_PX:
        size_m = focal_px * SHAPES[box.label].height_m / box.height_px
        edge = edge_px / box.height_px
        sigma = size_m * math.sqrt(SIZE_RATIO * SIZE_RATIO + 2.0 * edge * edge)
        weight = 1.0 / (sigma * sigma)
        information, weighted = information + weight, weighted + weight * size_m
    if information == 0.0:
        # So near that its foot lies below the picture: as near as the picture's lower border.
        return None if foot_m is None else (foot_m, 0.3 * foot_m)
    return weighted / information, math.sqrt(1.0 / information)


def ends_m(box: Detection, view: CameraView, ahead_m: float) -> tuple[float, float]:
    """Right and left end of an object that begins ``ahead_m`` before the camera [m].

    The edge nearer to straight ahead is the far corner of its flank. Where the picture's border
    cuts it off, its width counts from the edge that is there.
    """
    shape = SHAPES[box.label]
    bottom_px = box.y_px + box.height_px
    far_m = ahead_m + shape.flank_m

    def across_m(x_px: float, *, flank: bool) -> float:
        return view.across_m(x_px, bottom_px, far_m if flank else ahead_m)

    def is_left(x_px: float) -> bool:
        return view.ray(x_px, bottom_px)[1] > 0.0

    right_px = box.x_px + box.width_px
    left_m = across_m(box.x_px, flank=not is_left(box.x_px))
    right_m = across_m(right_px, flank=is_left(right_px))
    if right_px >= view.width_px - BORDER_PX:
        right_m = min(right_m, left_m - shape.width_m)
    if box.x_px <= BORDER_PX:
        left_m = max(left_m, right_m + shape.width_m)
    return min(right_m, left_m), max(right_m, left_m)
