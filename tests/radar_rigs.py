"""A radar without a vehicle: targets and a pose in, detections out."""

from __future__ import annotations

import numpy as np
import warp as wp
from lidar_rigs import CPU, world

from twin.render.trace.geometry import Geometry
from twin.sensors.radar.profile import RadarProfile, load_radar_profile
from twin.sensors.radar.sensor import RadarSensor
from twin.vehicle.columns import COLUMN, TELEMETRY

RANGE, AZIMUTH, ELEVATION, SPEED, RCS, SNR = range(6)
HEIGHT_M = 0.5
EMPTY = [(900.0, 0.0, 0.0), (901.0, 0.0, 0.0), (901.0, 1.0, 0.0), (900.0, 1.0, 0.0)]
"""A face beyond every range: a world must have one."""


def small_profile(**changes) -> RadarProfile:
    """The mid-range radar with fewer cells; ``changes`` go into it."""
    base = load_radar_profile("mid_range")
    fields = {name: getattr(base, name) for name in base.__struct_fields__}
    small = {"samples": 128, "chirps": 64, "range_max_m": 37.0, "speed_min_mps": -20.0}
    return RadarProfile(**(fields | small | {"rays": [8, 4]} | changes))


def vehicle_row(x_m=0.0, y_m=0.0, speed_mps=0.0) -> np.ndarray:
    """State of a vehicle that looks along x and drives there."""
    row = np.zeros(len(TELEMETRY))
    row[COLUMN["x_m"]], row[COLUMN["y_m"]] = x_m, y_m
    row[COLUMN["com_x_m"]], row[COLUMN["com_y_m"]] = x_m, y_m
    row[COLUMN["orientation_w"]] = 1.0
    row[COLUMN["velocity_x_mps"]] = speed_mps
    return row


def radar(profile=None, reflectors=(), scene=None, slots=1, **state) -> RadarSensor:
    """A radar before ``scene`` and ``reflectors``; by default without noise, second ways and
    clutter."""
    sensor = RadarSensor(
        profile or small_profile(), Geometry(scene or world(EMPTY), slots, CPU), tuple(reflectors)
    )
    fields = {"noise": 0, "multipath": 0, "clutter": 0} | state
    for slot in range(slots):
        sensor.reset(slot, 7 + slot)
        sensor.mount(slot, (0.0, 0.0, HEIGHT_M), 0.0)
        for name, value in fields.items():
            sensor.state.host[slot][name] = value
    return sensor


def measure(sensor: RadarSensor, *rows: np.ndarray, tick: int = 0) -> list[np.ndarray]:
    """Detections of each slot, with its vehicle at ``rows`` (none: at the origin)."""
    slots = sensor.geometry.slots
    states = np.array(rows or [vehicle_row()] * slots)
    sensor.state.host["tick"] = tick
    sensor.measure(wp.array(states, dtype=wp.float64, device=CPU))
    detections, count = sensor.pull()
    return [detections[slot, : count[slot]].copy() for slot in range(slots)]
