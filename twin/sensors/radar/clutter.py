"""Clutter: echoes of the road and of all that stands beside it, by rays.

Rays go out over the field of view, one per cell of a grid in azimuth and elevation, each at another
place of its cell at every tick. A surface that fills the solid angle W at distance R has the area
W R^2 / cos t, t the angle of incidence, and the cross section per area
g cos t + r / (m^2 cos^4 t) e^{-tan^2 t / m^2}: a constant-gamma term of what is rough, and the
mirror term of facets whose slopes have the variance m^2 / 2 (Barrick 1968). The latter adds up to
pi R^2 r over a wall that faces the radar, which is its mirror image. The sum over a cell of many
facets is a complex normal number, so each ray has an exponentially distributed power and a random
phase.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import warp as wp

from twin.base.portable_math import portable_cos, portable_exp, portable_log, portable_sin
from twin.render.build import Features
from twin.render.noise import draw
from twin.render.trace.geometry import RayScene, rays_of
from twin.sensors.radar.echo import (
    FAINT,
    RadarEcho,
    RadarModel,
    RadarPose,
    RadarSlot,
    echo_of,
    power_of,
)
from twin.sensors.radar.profile import RadarProfile
from twin.sensors.radar.spectrum import first_uniform
from twin.world.meshes import materials

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_UNIT = wp.constant(wp.float64(2.0**-32))
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_FLAT = wp.constant(wp.float64(0.02))
_WET_LOSS = wp.constant(wp.float64(0.7))

# Constant gamma of backscatter [-], reflectance r of a smooth face, mean square slope m^2 and
# whether water takes the roughness away. Inferred within what is published at 76 to 95 GHz (asphalt
# -25 to -20 dB, grass -18 to -12 dB, trees -12 to -8 dB: Ulaby and Dobson 1989, handbook of radar
# scattering statistics for terrain; Li, Sarabandi 1999 for asphalt).
_SURFACES: dict[str, tuple[float, float, float, float]] = {
    "PLAIN": (0.05, 0.40, 0.10, 0.0),
    "ASPHALT": (0.004, 0.11, 0.02, 1.0),
    "PAVING": (0.008, 0.14, 0.02, 1.0),
    "PAINT": (0.004, 0.11, 0.02, 1.0),
    "FACADE": (0.03, 0.17, 0.05, 0.0),
    "SHOPFRONT": (0.02, 0.20, 0.03, 0.0),
    "FOLIAGE": (0.10, 0.0, 1.0, 0.0),
    "CAR_PAINT": (0.02, 0.90, 0.10, 0.0),
    "GLASS": (0.01, 0.20, 0.03, 0.0),
    "WINDOW": (0.01, 0.20, 0.03, 0.0),
    "BRICK": (0.05, 0.14, 0.10, 0.0),
    "PLASTER": (0.03, 0.14, 0.05, 0.0),
    "SIGN": (0.01, 0.90, 0.02, 0.0),
    "GRASS": (0.03, 0.0, 1.0, 0.0),
}


def surfaces() -> np.ndarray:
    """Rows of gamma, r, m^2 and smoothing by water, by material; float64 [materials, 4]."""
    numbers = {
        name: value
        for name, value in vars(materials).items()
        if name.isupper() and isinstance(value, int)
    }
    table = np.zeros((max(numbers.values()) + 1, 4))
    for name, number in numbers.items():
        table[number] = _SURFACES.get(name, _SURFACES["PLAIN"])
    return table


@wp.struct
class RayGrid:
    """Directions in which rays go."""

    across: wp.int32
    upright: wp.int32
    """Cells in azimuth and elevation."""
    half: wp.vec2d
    """Half the field of view, azimuth and elevation [rad]."""
    step: wp.vec2d
    """Size of a cell [rad]."""
    parked: wp.int32
    """Instances below are vehicles that stand, which are no clutter."""


def make_grid(profile: RadarProfile, parked: int) -> RayGrid:
    """The grid of ``profile``; ``parked``: vehicles that stand in the world."""
    grid = RayGrid()
    grid.across, grid.upright = profile.rays
    half = [math.radians(angle) for angle in profile.half_view_deg]
    grid.half = wp.vec2d(*half)
    grid.step = wp.vec2d(2.0 * half[0] / profile.rays[0], 2.0 * half[1] / profile.rays[1])
    grid.parked = parked
    return grid


@wp.func
def section_per_area(surface: wp.vec4d, cosine: wp.float64, wetness: wp.float64) -> wp.float64:
    """Cross section per area of a surface at an angle of incidence [-]."""
    rough = surface[0] * cosine * (_ONE - _WET_LOSS * surface[3] * wetness)
    if surface[1] <= _ZERO:
        return rough
    square = cosine * cosine
    slopes = (_ONE - square) / (square * surface[2])
    return rough + surface[1] / (surface[2] * square * square) * portable_exp(-slopes)


@cache
def clutter_kernel_of(features: Features) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    trace, _ = rays_of(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def clutter_kernel(
        # model
        model: RadarModel,
        scene: RayScene,
        grid: RayGrid,
        surface: wp.array(dtype=wp.vec4d),
        # state in
        slots: wp.array(dtype=RadarSlot),
        poses: wp.array(dtype=RadarPose),
        # args
        first: wp.int32,
        # out
        echoes_out: wp.array2d(dtype=RadarEcho),
    ):
        """Echoes [S, first + rays]; threads over (slot, ray)."""
        slot, ray = wp.tid()
        state = slots[slot]
        if state.active == 0:
            return
        echo = RadarEcho()
        if state.clutter != 0:
            # Counters beyond those of the map's noise.
            cells = (model.columns + model.upper + 1) * model.speeds * model.ranges
            bits = draw(state.key, state.tick, cells + 2 * ray)
            more = draw(state.key, state.tick, cells + 2 * ray + 1)
            column = ray / grid.upright
            row = ray - column * grid.upright
            inside_x = wp.float64(bits & _LOW) * _UNIT
            inside_y = first_uniform(bits)
            azimuth = grid.half[0] - (wp.float64(column) + inside_x) * grid.step[0]
            elevation = (wp.float64(row) + inside_y) * grid.step[1] - grid.half[1]
            level = portable_cos(elevation)
            unit = wp.vec3d(
                level * portable_cos(azimuth),
                level * portable_sin(azimuth),
                portable_sin(elevation),
            )
            ahead = pose_turn(poses[slot], unit)
            origin = wp.vec3(
                wp.float32(poses[slot].origin[0]),
                wp.float32(poses[slot].origin[1]),
                wp.float32(poses[slot].origin[2]),
            )
            direction = wp.vec3(wp.float32(ahead[0]), wp.float32(ahead[1]), wp.float32(ahead[2]))
            far = wp.float32(wp.float64(model.ranges) * model.range_cell)
            hit = trace(scene, slot, origin, direction, 0.0, far)
            parked = hit.instance >= 0 and hit.instance < grid.parked
            if hit.found and hit.object < 0 and not parked:
                cosine = wp.max(wp.float64(wp.abs(wp.dot(hit.normal, direction))), _FLAT)
                row_of = surface[wp.min(scene.faces[hit.face].material, surface.shape[0] - 1)]
                distance = wp.float64(hit.t)
                solid = grid.step[0] * grid.step[1] * level
                area = solid * distance * distance / cosine
                section = section_per_area(row_of, cosine, state.wetness) * area
                section *= -portable_log(first_uniform(more))
                at = unit * distance
                power = power_of(model, state, at, section)
                if wp.float32(power) > FAINT:
                    radial = -wp.dot(poses[slot].velocity, ahead)
                    turns = wp.float64(more & _LOW) * _UNIT
                    echo = echo_of(model, power, at, radial, turns)
        echoes_out[slot, first + ray] = echo

    return clutter_kernel


@wp.func
def pose_turn(pose: RadarPose, unit: wp.vec3d) -> wp.vec3d:
    """A direction of the radar's axes in the world."""
    return pose.rotation * unit
