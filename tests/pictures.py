"""Worlds of bare triangles and cameras that look at them, for tests of pictures."""

import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.messages import Lights
from schemas.sections.lens import CameraMount
from twin.actors.motion import Placement
from twin.render.camera import RayCamera
from twin.render.light.light import fill_light, fill_sky, switch_lamps
from twin.render.trace.geometry import Geometry
from twin.vehicle.state import COLUMN, TELEMETRY
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes.mesh import Mesh
from twin.world.scene import Furniture
from twin.world.sky.sun import daylight
from twin.world.sky.weather import WEATHER
from twin.world.street.build import World

prepare_kernels()
CPU = wp.get_device("cpu")


def mesh_of(points, faces, **values):
    """A mesh of matt gray; ``values`` replace columns."""
    faces = np.asarray(faces, np.int32)
    count = len(faces)
    columns = {
        "material": np.zeros(count, np.int32),
        "color": np.full((count, 3), 0.4, np.float32),
        "tag": np.zeros(count, np.int32),
        "instance": np.full(count, -1, np.int32),
        "semantic": np.zeros(count, np.int32),
        "texture": np.full(count, -1, np.int32),
        "uv": np.zeros((len(points), 2), np.float32),
        "ambient": np.ones(len(points), np.float32),
    }
    return Mesh(points_m=np.asarray(points, np.float32), faces=faces, **{**columns, **values})


def world_of(mesh, instances=0, **more):
    return World(mesh, np.zeros((1, 5)), instances, (0.0, -500.0), (0.0, 500.0), **more)


def quad(*corners):
    """Points and faces of a flat quadrilateral."""
    return np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    """One list of points and faces from several."""
    points, faces, count = [], [], 0
    for p, f in parts:
        points.append(p)
        faces.append(np.asarray(f) + count)
        count += len(p)
    return np.concatenate(points), np.concatenate(faces)


def camera_in(world, slots=1, mount=(0.0, 0.0, 0.0), size=(64, 36), **spec):
    """A camera at the vehicle's reference point by default, all slots lit at noon."""
    spec = {"hfov_deg": 90.0, "noise": False, **spec}
    place = mount if isinstance(mount, CameraMount) else CameraMount(position_m=list(mount))
    geometry = Geometry(world, slots, CPU)
    camera = RayCamera(
        geometry,
        world,
        Furniture(),
        Camera(width=size[0], height=size[1], **spec),
        place,
        (1.5, 0.0, 0.7),
    )
    for slot in range(slots):
        light_slot(camera, slot)
    return camera


def light_slot(camera, slot, weather="clear", minute=720, lights=None, **fields):
    """Light a slot; further fields of its row as they are."""
    light = daylight(minute, WEATHER[weather])
    row = camera.lights.host[slot]
    fill_light(row, light, WEATHER[weather])
    fill_sky(camera.sky_table.host[slot], light)
    switch_lamps(row, lights or Lights())
    row["active"], row["key"], row["noise"] = 1, slot + 1, 0
    for name, value in fields.items():
        row[name] = value


def flat(*poses):
    """Poses of level vehicles for :meth:`RayCamera.render`."""
    return wp.array(np.array(poses, float).reshape(-1, 3), dtype=wp.float64, device=CPU)


def states(positions_m, quaternions):
    """Vehicle states with an attitude (x, y, z, w)."""
    rows = np.zeros((len(positions_m), len(TELEMETRY)))
    for row, place, turn in zip(rows, positions_m, quaternions, strict=True):
        for name, value in zip(("x_m", "y_m", "z_m"), place, strict=True):
            row[COLUMN[name]] = value
        for axis, value in zip("xyzw", turn, strict=True):
            row[COLUMN[f"orientation_{axis}"]] = value
    return wp.array(rows, dtype=wp.float64, device=CPU)


class Script:
    """Objects that are where they are told to be."""

    def __init__(self, **columns):
        """``columns``: of :class:`Placement` for one slot [M, ...]; the rest is zero."""
        self.columns = columns
        self.count = len(columns["position_m"])

    def at(self, time_s):
        slots = len(time_s)
        count = self.count
        shapes = {
            "kind": (np.int32, ()),
            "position_m": (float, (3,)),
            "yaw_rad": (float, ()),
            "velocity_mps": (float, (3,)),
            "yaw_rate_radps": (float, ()),
            "brake": (np.float32, ()),
            "lamps": (np.float32, ()),
            "lights": (np.int32, ()),
        }
        if "pitch_rad" in self.columns:
            shapes |= {"pitch_rad": (float, ()), "roll_rad": (float, ())}
        values = {}
        for name, (dtype, inner) in shapes.items():
            one = np.zeros((count, *inner), dtype)
            one[...] = self.columns.get(name, 0)
            values[name] = np.repeat(one[None], slots, axis=0)
        return Placement(**values)


def box_mesh(half, **values):
    """A box around the origin's upper side: x, y from -half to half, z from 0 to 2 half."""
    hx, hy, hz = half
    p = np.array([(x, y, z) for x in (-hx, hx) for y in (-hy, hy) for z in (0.0, 2 * hz)])
    f = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    f += [(2, 3, 7), (2, 7, 6), (1, 5, 7), (1, 7, 3), (0, 2, 6), (0, 6, 4)]
    return mesh_of(p, f, **values)
