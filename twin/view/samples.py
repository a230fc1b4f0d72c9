"""Snapshots of slots -> samples of the view plane. No session, thread or clock."""

from __future__ import annotations

import numpy as np
from PIL import Image

from schemas import SCHEMA_VERSION
from schemas.case import Case
from schemas.kinds.registry import implementation
from schemas.kinds.sensor import GridLook, drawn_kinds, shown_columns
from schemas.messages import BOX_COLUMNS, OBJECT_CLASSES, Command, command_mistake
from schemas.sections.lidar import POINT_COLUMNS
from schemas.wire.control import Lease
from schemas.wire.view import (
    POINT_CM,
    CaseStart,
    Controls,
    ImageBox,
    RowsSite,
    Stage,
    StateSample,
)
from twin.actors.car_body import HEIGHT_M, LENGTH_M, WIDTH_M
from twin.base.picture_file import jpeg_of
from twin.kpi.recorder import CLOSING_MIN_MPS
from twin.kpi.table import KpiTable
from twin.scenario import families
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.view.items import Cloud, SlotSeen
from twin.world.road_scene import road_lane

JPEG_QUALITY = 80
"""Quality of small pictures; for large ones see :mod:`twin.view.quality`."""

THUMBNAIL_WIDTH_PX = 160
"""Widest thumbnail [px]."""

_LANE_STEP_M = 3.0

_BOX = {name: i for i, name in enumerate(BOX_COLUMNS)}
_POINT = {name: i for i, name in enumerate(POINT_COLUMNS)}


def points_of(cloud: Cloud) -> np.ndarray:
    """Returns of a sweep as :class:`schemas.wire.view.PointsSample` says: int16 [N, 4]."""
    columns = [_POINT[name] for name in ("x_m", "y_m", "z_m")]
    limit = np.iinfo(np.int16).max
    xyz = np.rint(cloud.points[:, columns] / POINT_CM)
    # A comparison with NaN, which is what a ray without a return has, is False.
    inside = (np.abs(xyz) <= limit).all(axis=1)
    rows = np.empty((int(inside.sum()), 4), "<i2")
    rows[:, :3] = xyz[inside]
    rows[:, 3] = np.clip(cloud.points[inside, _POINT["intensity"]], 0, 255)
    return rows


def grid_picture(look: GridLook, grid: np.ndarray) -> np.ndarray:
    """A sensor's grid as its look says: uint8 [H, W, 3], the first axis upwards, the second to the
    right, the shorter one stretched by a whole number so that both are about as long."""
    flat = grid.max(axis=tuple(range(2, grid.ndim)))
    level_db = 10.0 * np.log10(np.maximum(flat, 1e-30))
    share = (level_db - look.low_db) / (look.high_db - look.low_db)
    grey = np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)[::-1]
    high, wide = grey.shape
    grey = grey.repeat(max(1, wide // high), axis=0).repeat(max(1, high // wide), axis=1)
    return np.repeat(grey[:, :, None], 3, axis=2)


def stage_of(lease: Lease, colliders: np.ndarray, cars: int, target: int | None) -> Stage:
    """The standing world of a lease's case: ``colliders`` [N, 5], of which the first ``cars`` are
    cars and ``target`` is what the scenario is about."""
    scene = families.scene_of(lease.case)
    hulls = colliders.tolist()
    standing = [] if target is None else [hulls.pop(target)]
    size_m = [2 * standing[0][3], 2 * standing[0][4]] if standing else [LENGTH_M, WIDTH_M]
    vehicle = load_vehicle(lease.case.rig.vehicle)
    road, beside, heights_m = scene.road, 1.0, list[float]()
    width_m, places = road.lane_width_m, road.lane().places(_LANE_STEP_M)
    if scene.opendrive:  # what lies beside the lane is no generated street
        ego_lane, beside = road_lane(scene.opendrive), 0.0
        places = ego_lane.path.places(_LANE_STEP_M)
        width_m, heights_m = float(ego_lane.course.width_m[0]), ego_lane.heights_m(places)
    return Stage(
        lane=places.tolist(),
        lane_width_m=width_m,
        lane_z_m=heights_m,
        parking_width_m=beside * road.parking_width_m,
        sidewalk_width_m=beside * road.sidewalk_width_m,
        obstacle_center_m=[*standing[0][:2], HEIGHT_M / 2] if standing else [],
        obstacle_yaw_rad=standing[0][2] if standing else 0.0,
        obstacle_size_m=[*size_m, HEIGHT_M],
        ego_center_m=[vehicle.centre_offset_m, 0.0, vehicle.height_m / 2],
        ego_size_m=[vehicle.length_m, vehicle.width_m, vehicle.height_m],
        camera_m=list(vehicle.camera(lease.case.rig.camera.name).position_m),
        hulls=hulls,
        cars=cars - (target is not None and target < cars),
    )


def start_of(lease: Lease, stage: Stage, seq: int) -> CaseStart:
    """The message that begins an attempt."""
    case = lease.case
    return CaseStart(
        v=SCHEMA_VERSION,
        seq=seq,
        token=lease.token,
        campaign=case.variation.campaign,
        case=case.id,
        attempt=lease.attempt,
        folder=f"{lease.out}/{lease.attempt_dir}",
        model=case.variation.model,
        weather=case.variation.weather,
        time_of_day_min=case.variation.time_of_day_min,
        scene=case.rig.scene,
        vehicle=case.rig.vehicle,
        seed=case.variation.seed,
        control_hz=case.rig.control_hz,
        camera=case.rig.camera.name,
        width=case.rig.camera.width,
        height=case.rig.camera.height,
        hfov_deg=case.rig.camera.hfov_deg,
        stage=stage,
        sensors=shown_columns(case.rig.sensor_hz),
        rows=_rows_sites(case),
        keep=case.rig.keep,
    )


def _rows_sites(case: Case) -> dict[str, RowsSite]:
    """Sensors of a case whose rows are drawn as points."""
    sites = {}
    for kind in drawn_kinds(case.rig.sensor_hz):
        assert kind.points is not None
        place = implementation(kind.site)(case, load_vehicle(case.rig.vehicle))
        position_m, rotation_deg = (list(values) for values in place)
        sites[kind.name] = RowsSite(list(kind.columns), kind.points, position_m, rotation_deg)
    return sites


def state_of(snapshot: SlotSeen, token: int, seq: int) -> StateSample:
    """The state message of a tick; the same values as its KPI row."""
    state = snapshot.state

    def value(name: str) -> float:
        return float(state[COLUMN[name]])

    hulls = snapshot.movers
    dtc_m = ttc_s = None
    if snapshot.nearest is not None:
        dtc_m, ttc_s = snapshot.nearest
    elif snapshot.target:
        dtc_m, closing = value("dtc_m"), value("closing_mps")
        ttc_s = dtc_m / closing if closing > CLOSING_MIN_MPS else None
    return StateSample(
        v=SCHEMA_VERSION,
        seq=seq,
        token=token,
        tick=snapshot.tick,
        sim_time_ns=snapshot.sim_time_ns,
        x_m=value("x_m"),
        y_m=value("y_m"),
        yaw_rad=value("yaw_rad"),
        speed_mps=value("speed_mps"),
        accel_mps2=value("accel_mps2"),
        dtc_m=dtc_m,
        ttc_s=ttc_s,
        collisions=int(state[COLUMN["collisions"]]),
        controls=_controls(snapshot.command),
        boxes=None if snapshot.boxes is None else [_box(row) for row in snapshot.boxes],
        movers=[] if hulls is None else hulls[:, :7].tolist(),
        mover_tilts=[] if hulls is None or not hulls[:, 7:].any() else hulls[:, 7:].tolist(),
        z_m=value("z_m"),
        pitch_rad=value("pitch_rad"),
        roll_rad=value("roll_rad"),
        hand=snapshot.label,
        sensors={name: row.tolist() for name, row in snapshot.readings.items()},
        rows={name: rows.tolist() for name, rows in snapshot.rows.items()},
    )


def last_row_of(table: KpiTable, token: int, seq: int) -> StateSample:
    """The state message of a finished case's last KPI row, for which nothing was asked."""

    def value(name: str) -> float:
        return float(table.columns[name].values[-1])

    return StateSample(
        v=SCHEMA_VERSION,
        seq=seq,
        token=token,
        tick=int(value("tick")),
        sim_time_ns=int(table.columns["sim_time_ns"].values[-1]),
        x_m=value("x_m"),
        y_m=value("y_m"),
        yaw_rad=value("yaw_rad"),
        speed_mps=value("speed_mps"),
        accel_mps2=value("accel_mps2"),
        dtc_m=last_of(table, "dtc_m"),
        ttc_s=last_of(table, "ttc_s"),
        collisions=int(value("collisions")),
        controls=None,
        boxes=None,
    )


def last_of(table: KpiTable, name: str) -> float | None:
    """A number of the last row; None: missing."""
    column = table.columns[name]
    known = column.valid is None or bool(column.valid[-1])
    return float(column.values[-1]) if known else None


def jpeg(image: np.ndarray, width_max_px: int | None = None, quality: int = JPEG_QUALITY) -> bytes:
    """RGB picture [H, W, 3] -> JPEG, scaled down to ``width_max_px``."""
    height, width = image.shape[:2]
    if width_max_px is not None and width > width_max_px:
        size = (width_max_px, max(1, height * width_max_px // width))
        small = Image.fromarray(image).resize(size, Image.Resampling.BOX, reducing_gap=1.0)
        image = np.asarray(small)
    return jpeg_of(image, quality)


def _controls(command: Command | None) -> Controls | None:
    """None for a command that is none: the case has failed with it."""
    if command is None or command_mistake(command):
        return None
    return Controls(
        throttle=command.throttle,
        brake=command.brake,
        steering_rad=command.steering_rad,
        aeb=command.aeb,
        lights=command.lights,
        detections=command.detections,
        trigger=command.trigger,
    )


def _box(row: np.ndarray) -> ImageBox:
    return ImageBox(
        label=OBJECT_CLASSES[int(row[_BOX["class_id"]])],
        x_px=float(row[_BOX["x_px"]]),
        y_px=float(row[_BOX["y_px"]]),
        width_px=float(row[_BOX["width_px"]]),
        height_px=float(row[_BOX["height_px"]]),
        distance_m=float(row[_BOX["distance_m"]]),
    )
