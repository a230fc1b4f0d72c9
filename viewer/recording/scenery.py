"""What stands around the ego and what it carries: street, world mesh, cameras, lidars, movers."""

from __future__ import annotations

import hashlib
import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from schemas.kinds.scenario import verdict_kinds
from schemas.messages import CameraSite, LidarSite
from schemas.wire.view import POINT_CM, CaseStart, SceneMesh, Stage
from viewer.recording import naming
from viewer.recording.classes import class_id

Logged = tuple[str, Any]
"""Entity path and archetype."""

Color = tuple[int, int, int]

BLUE: Color = (76, 139, 245)
GREEN: Color = (52, 199, 123)
RED: Color = (240, 84, 84)
ORANGE: Color = (245, 166, 35)
YELLOW: Color = (255, 235, 59)
CYAN: Color = (90, 200, 220)
VIOLET: Color = (178, 120, 255)
GREY: Color = (120, 126, 138)

_TONES: dict[str, Color] = {"good": GREEN, "doubtful": ORANGE, "bad": RED}
VERDICT_COLORS = {verdict.name: _TONES[verdict.tone] for verdict in verdict_kinds()}

BUILDING_HEIGHT_M = 0.2
"""Buildings are drawn as flat as their ground plan, so that they hide nothing [m]."""
POST_M = 1.0
"""A hull with a smaller half length is a tree or a post [m]."""
IMAGE_PLANE_M = 6.0
"""Distance before a camera at which its picture hangs in the street [m]."""

SCENE_BYTES_MAX = 256 << 20
"""Largest world that is unpacked [bytes]."""

_STEPS = ((0, (52, 84, 186)), (33, (60, 190, 190)), (66, (240, 210, 90)), (100, (250, 250, 250)))
"""Reflectivities and their colours; from 100 on are retro-reflectors."""
_INTENSITY = np.stack(
    [
        np.interp(np.arange(256), [s for s, _ in _STEPS], [c[i] for _, c in _STEPS])
        for i in range(3)
    ],
    axis=1,
).astype(np.uint8)
"""uint8 [256, 3]: colour of every intensity."""


def verdict_color(verdict: str) -> Color:
    """Colour of a verdict; grey without one."""
    return VERDICT_COLORS.get(verdict, GREY)


def unpacked(scene: SceneMesh) -> rr.Mesh3D:
    """The standing world.

    Raises:
        ValueError: damaged, or not the world it says it is.
    """
    sizes = [scene.vertices * 12, scene.faces * 12, scene.vertices * 3]
    if min(sizes) < 0 or sum(sizes) > SCENE_BYTES_MAX:
        raise ValueError(f"a world of {scene.faces} triangles is too large to be shown")
    try:
        data = zlib.decompressobj().decompress(scene.data, sum(sizes) + 1)
    except zlib.error as error:
        raise ValueError(f"the world's mesh is damaged: {error}") from None
    if len(data) != sum(sizes) or hashlib.sha256(data).hexdigest() != scene.sha256:
        raise ValueError("the world's mesh is damaged: it has another digest than it says")
    points, faces = data[: sizes[0]], data[sizes[0] : sizes[0] + sizes[1]]
    triangles = np.frombuffer(faces, "<u4").reshape(-1, 3)
    if triangles.max(initial=0) >= scene.vertices:
        raise ValueError("the world's mesh is damaged: a triangle without a corner")
    return rr.Mesh3D(
        vertex_positions=np.frombuffer(points, "<f4").reshape(-1, 3),
        triangle_indices=triangles,
        vertex_colors=np.frombuffer(data[sum(sizes[:2]) :], np.uint8).reshape(-1, 3),
    )


def _obstacle(stage: Stage) -> rr.Boxes3D:
    return rr.Boxes3D(
        centers=[stage.obstacle_center_m],
        sizes=[stage.obstacle_size_m],
        rotation_axis_angles=[
            rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=stage.obstacle_yaw_rad))
        ],
        colors=[RED],
        fill_mode="solid",
        class_ids=[class_id("car")],
        show_labels=False,
    )


def outline(stage: Stage) -> list[Logged]:
    """Lane edges, kerbs, the obstacle if there is one, parked cars and buildings."""
    lane = stage.lane_width_m
    right, left = -lane / 2 - stage.parking_width_m, 1.5 * lane + stage.parking_width_m
    edges = [-lane / 2, lane / 2, 1.5 * lane]
    strips = [_beside(stage, y) for y in (*edges, right, left)]
    colors = [GREY, (225, 190, 80), GREY, (80, 84, 92), (80, 84, 92)]
    cars = stage.hulls[: stage.cars]
    walls = [hull for hull in stage.hulls[stage.cars :] if hull[3] >= POST_M]
    height = stage.obstacle_size_m[2]
    logged: list[Logged] = [
        (naming.STREET, rr.LineStrips3D(strips, colors=colors, radii=0.05)),
    ]
    if stage.obstacle_center_m:
        logged.append((naming.OBSTACLE, _obstacle(stage)))
    if cars:
        logged.append((naming.PARKED, _hulls(cars, height, (70, 76, 88), "car")))
    if walls:
        plan = _hulls(walls, BUILDING_HEIGHT_M, (44, 48, 57), "building")
        logged.append((naming.BUILDINGS, plan))
    return logged


def _beside(stage: Stage, y_m: float) -> list[list[float]]:
    """The line ``y_m`` to the left of the lane, a little above the ground."""
    heights_m = stage.lane_z_m
    if len(heights_m) != len(stage.lane):
        heights_m = [0.0] * len(stage.lane)
    return [
        [x - y_m * math.sin(yaw), y + y_m * math.cos(yaw), z + 0.02]
        for (x, y, yaw), z in zip(stage.lane, heights_m, strict=True)
    ]


def eyes(start: CaseStart) -> list[Logged]:
    """Cameras and lidars on the ego."""
    if not start.rig:  # for a recorder, which gets the main one only
        half_px = math.tan(math.radians(start.hfov_deg) / 2)
        return [
            (naming.CAMERA, rr.Transform3D(translation=start.stage.camera_m)),
            (naming.CAMERA, _pinhole(start.width / 2 / half_px, start.width, start.height)),
        ]
    logged: list[Logged] = []
    for site in start.cameras:
        path = naming.sensor(site.message)
        focal_px = site.width / 2 / math.tan(math.radians(site.hfov_deg) / 2)
        logged.append((path, _mounted(site)))
        logged.append((path, _pinhole(focal_px, site.width, site.height)))
    for site in start.lidars:
        path = naming.sensor(site.message)
        logged.append((path, _mounted(site)))
        logged.append((path, rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5))))
    return logged


def points(payload: bytes) -> list[rr.ComponentColumn]:
    """A lidar's points as :class:`schemas.wire.view.PointsSample` says, coloured by reflectivity.

    Raises:
        ValueError: not of that form.
    """
    rows = np.frombuffer(payload, "<i2").reshape(-1, 4)
    columns = rr.Points3D.columns(
        positions=rows[:, :3] * np.float32(POINT_CM),
        colors=_INTENSITY[np.clip(rows[:, 3], 0, 255)],
    )
    return list(columns.partition([len(rows)]))


def movers(
    rows: Sequence[tuple[Sequence[Sequence[float]], Sequence[Sequence[float]]]],
) -> list[rr.ComponentColumn]:
    """Hulls of the objects that move by script, and how they lean, at several times; see
    :attr:`schemas.wire.view.StateSample.movers`."""
    flat = [
        (hull, *tilt)
        for hulls, tilts in rows
        for hull, tilt in zip(hulls, tilts or [(0.0, 0.0)] * len(hulls), strict=True)
    ]
    turns = [quaternion(hull[3], pitch, roll) for hull, pitch, roll in flat]
    columns = rr.Boxes3D.columns(
        centers=[
            _above(hull[:3], turn, hull[6] / 2)
            for (hull, *_), turn in zip(flat, turns, strict=True)
        ],
        half_sizes=[[hull[4], hull[5], hull[6] / 2] for hull, *_ in flat],
        quaternions=turns,
    )
    return list(columns.partition([len(hulls) for hulls, _ in rows]))


def quaternion(yaw_rad: float, pitch_rad: float, roll_rad: float) -> list[float]:
    """x, y, z, w of the turn about z by the yaw, then y by the pitch, then x by the roll."""
    (sy, cy), (sp, cp), (sr, cr) = (
        (math.sin(angle / 2), math.cos(angle / 2)) for angle in (yaw_rad, pitch_rad, roll_rad)
    )
    x, y = cy * cp * sr - sy * sp * cr, cy * sp * cr + sy * cp * sr
    return [x, y, sy * cp * cr - cy * sp * sr, cy * cp * cr + sy * sp * sr]


def _above(foot_m: Sequence[float], turn: Sequence[float], height_m: float) -> list[float]:
    """The place ``height_m`` above another along the upward axis of what is turned so."""
    x, y, z, w = turn
    up = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    return [at + height_m * way for at, way in zip(foot_m, up, strict=True)]


def rotation(rotation_deg: Sequence[float]) -> np.ndarray:
    """[3, 3]: roll, pitch and yaw about the vehicle's axes, applied in this order."""
    (sr, cr), (sp, cp), (sy, cy) = (
        (math.sin(math.radians(angle)), math.cos(math.radians(angle))) for angle in rotation_deg
    )
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll)


def _mounted(site: CameraSite | LidarSite) -> rr.Transform3D:
    return rr.Transform3D(translation=site.position_m, mat3x3=rotation(site.rotation_deg))


def _pinhole(focal_px: float, width: int, height: int) -> rr.Pinhole:
    return rr.Pinhole(
        focal_length=focal_px,
        width=width,
        height=height,
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=IMAGE_PLANE_M,
    )


def _hulls(hulls: list[list[float]], height_m: float, color: Color, name: str) -> rr.Boxes3D:
    return rr.Boxes3D(
        centers=[[x, y, height_m / 2] for x, y, *_ in hulls],
        half_sizes=[[half_x, half_y, height_m / 2] for *_, half_x, half_y in hulls],
        rotation_axis_angles=[
            rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=hull[2])) for hull in hulls
        ],
        colors=[color],
        fill_mode="solid",
        class_ids=[class_id(name)],
        show_labels=False,
    )
