"""Sensors without a vehicle: a given truth in, readings out."""

from __future__ import annotations

import numpy as np
import warp as wp
from case_changes import changed

from schemas.case import Case
from schemas.kinds.sensor import sensor_kinds
from schemas.plan import parse_plan
from twin.sensors.mount import SensorMount
from twin.sensors.truth import TRUTH
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import Origin

prepare_kernels()
CPU = wp.get_device("cpu")
GRAVITY_MPS2 = 9.80665
HOME = Origin(latitude_deg=34.8, longitude_deg=-82.32, altitude_m=250.0)


def case(name: str = "a", seed: int = 4, hz: int = 20, **sensors: dict) -> Case:
    """One case with these sensors."""
    data = {
        "campaign": "rows",
        "seed": seed,
        "control_hz": hz,
        "camera": {"width": 32, "height": 18, "hz": hz if hz <= 100 else 20},
        "sensors": sensors,
        "matrix": {"weather": ["clear"]},
    }
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    return changed(plan.cases[0], id=name)


def built(sensor, one, slots: int = 1, origin: Origin = HOME):
    """A sensor of a class, in ``slots`` slots of a rig of the case ``one``."""
    rates = one.rig.sensor_hz
    reference = f"{sensor.__module__}:{sensor.__name__}"
    kinds = sensor_kinds().declared
    hz = rates[next(kind.name for kind in kinds if kind.implementation == reference)]
    return sensor(SensorMount(slots, CPU, origin, hz, one.rig.control_hz // hz))


def resting(slots: int, **columns: float) -> np.ndarray:
    """Truth [S, T] of vehicles that stand level at the world's origin, some columns changed."""
    rows = np.zeros((slots, len(TRUTH)))
    given = {"qw": 1.0, "force_z_mps2": GRAVITY_MPS2, **columns}
    for name, value in given.items():
        rows[:, TRUTH.index(name)] = value
    return rows


def on_device(rows: np.ndarray) -> wp.array:
    """Truth for a sensor's ``read``."""
    return wp.array(rows, dtype=wp.float64, device=CPU)


def readings(sensor, slots: int, ticks: int, rows: np.ndarray | None = None) -> np.ndarray:
    """Readings [n, S, C] of tick 0, ``every``, 2 ``every``, ... of a truth that stays."""
    truth = on_device(resting(slots) if rows is None else rows)
    return np.stack(
        [
            sensor.read(truth, np.full(slots, tick, np.int32)).copy()
            for tick in range(0, ticks, sensor.every)
        ]
    )
