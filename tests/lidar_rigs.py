"""A LiDAR without a vehicle: a mesh and poses in, points out."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.sections.lidar import Lidar, LidarMount, LidarProfile
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather
from twin.sensors.truth import TRUTH
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.street.build import World

prepare_kernels()
CPU = wp.get_device("cpu")
QUIET = Lidar(noise=False, motion=False)
X, Y, Z, RANGE, INTENSITY, TIME, KIND, INSTANCE, SEMANTIC = range(9)
SURFACE, FOG, DROP = 1, 2, 3


def profile(**changes) -> LidarProfile:
    """A narrow, exact sensor that looks forward; ``changes`` go into it."""
    base = {
        "lidar": "test",
        "theta_min_deg": -10.0,
        "theta_max_deg": 10.0,
        "theta_res_deg": 0.5,
        "phi_min_deg": -5.0,
        "phi_max_deg": 5.0,
        "phi_res_deg": 0.5,
        "range_min_m": 0.5,
        "range_max_m": 200.0,
        "range_10_percent_m": 100.0,
        "hz": 10,
        "wavelength_nm": 905,
        "noise_m": 0.0,
    }
    return LidarProfile(**(base | changes))


def world(*quads, material=materials.PLAIN, color=(0.6, 0.6, 0.6), boxes=(), **more) -> World:
    """Quadrilaterals and upright boxes of one material; every box is an instance."""
    mesh = MeshBuilder()
    for corners in quads:
        mesh.quad(corners, material, color)
    for i, (low, high) in enumerate(boxes):
        with mesh.place(0.0, 0.0, instance=i):
            mesh.box(low, high, material, color)
    return World(mesh.build(), np.zeros((1, 5)), len(boxes), (0.0, -5.0), (13.0, 8.0), **more)


def wall(x_m: float, half_m: float = 400.0):
    """A wall across the x axis."""
    return [
        (x_m, -half_m, -half_m),
        (x_m, half_m, -half_m),
        (x_m, half_m, half_m),
        (x_m, -half_m, half_m),
    ]


def sensor(
    scene: World,
    kind: LidarProfile,
    lidar: Lidar = QUIET,
    slots: int = 1,
    position_m=(0.0, 0.0, 0.0),
    rotation_deg=(0.0, 0.0, 0.0),
) -> LidarSensor:
    """A sensor of ``kind`` before ``scene``."""
    mount = LidarMount(list(position_m), list(rotation_deg), inline=kind)
    return LidarSensor(kind, mount, Geometry(scene, slots, CPU), lidar)


def pose(position_m=(0.0, 0.0, 0.0), quaternion=(0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    """A row of the truth."""
    row = np.zeros(len(TRUTH))
    row[:3], row[3:7] = position_m, quaternion
    return row


def yawed(yaw_rad: float) -> tuple[float, float, float, float]:
    """A quaternion about z."""
    return (0.0, 0.0, float(np.sin(yaw_rad / 2)), float(np.cos(yaw_rad / 2)))


def scan(eye: LidarSensor, *rows: np.ndarray, tick: int = 0) -> np.ndarray:
    """Points [S, rays, K] with the vehicle of each slot at ``rows`` (one row: all slots)."""
    truth = np.array(rows or [pose()])
    truth = np.broadcast_to(truth, (eye.shape[0], len(TRUTH)))
    eye.air.host["tick"] = tick
    eye.scan(wp.array(truth.copy(), dtype=wp.float64, device=CPU))
    return eye.pull()[0].copy()


def look(eye: LidarSensor, weather: LidarWeather | None = None, key: int = 7, tick: int = 0):
    """Points [rays, K] of slot 0 at the origin."""
    eye.reset(0, key, weather)
    return scan(eye, tick=tick)[0]


def directions(kind: LidarProfile) -> np.ndarray:
    """Unit directions [rays, 3] after the paper's formula."""
    phi, theta = np.meshgrid(np.radians(kind.phis_deg), np.radians(kind.thetas_deg), indexing="ij")
    parts = (np.cos(theta) * np.cos(phi), np.sin(theta) * np.cos(phi), -np.sin(phi))
    return np.stack(parts, -1).reshape(-1, 3)
