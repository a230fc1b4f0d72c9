"""What NumPy and the C library prepare on the host, whose sines differ by instruction set.

``NPY_DISABLE_CPU_FEATURES="X86_V4 AVX512_ICL AVX512_SPR"`` hides AVX-512 from NumPy; with another
``WARP_CACHE_PATH``, or worlds come from the cache of the run before.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
import warp as wp

from schemas.names import WEATHERS
from schemas.sections.lens import Lens
from twin.render.lens import ray_table
from twin.render.light.light import SlotLight, fill_light
from twin.render.post.film import falloff
from twin.render.post.focus import taps, turns
from twin.render.tone import tone_table
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native, shipped_scenarios
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.sensors.lidar.scatter import scatter
from twin.sensors.lidar.sweep import make_beams
from twin.sensors.radar.threshold import power_table
from twin.sensors.radar.window import chebyshev, table
from twin.vehicle.model import VehicleModel, vehicle_model
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from twin.world.sky.sun import daylight
from twin.world.sky.weather import WEATHER
from twin.world.street.build import build_world

SCENES = ("downtown", "downtown-loop", "crossing", "track-lit", "motorway")
LENSES = {
    "pinhole": Lens(vignette=0.6),
    "brown_conrady": Lens(model="brown_conrady", k1=-0.2, k2=0.03, p1=0.001),
    "fisheye": Lens(model="fisheye", k1=0.02, vignette=0.6),
}
HOURS_MIN = range(0, 1440, 45)


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """All numbers in records, lists and arrays, in the order of their fields."""
    if isinstance(value, np.ndarray):
        if value.dtype != object:
            yield value
    elif isinstance(value, wp.array):
        yield value.numpy()
    elif isinstance(value, bool | int | float | np.generic):
        yield np.asarray(value, np.float64)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from arrays_of(getattr(value, field.name))
    elif isinstance(value, msgspec.Struct):
        for name in value.__struct_fields__:
            yield from arrays_of(getattr(value, name))
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from arrays_of(item)
    elif isinstance(value, tuple | list):
        for item in value:
            yield from arrays_of(item)
    elif hasattr(value, "_cls"):  # a struct of Warp
        for name in value._cls.vars:
            yield from arrays_of(getattr(value, name))


def tables(found: Any) -> None:
    """Worlds, skies, lenses, returns of rain and fog, storyboards."""

    def add(name: str, value: Any) -> None:
        arrays = list(arrays_of(value))
        assert arrays, name
        numbers = np.concatenate([np.asarray(a, np.float64).ravel() for a in arrays if
                                  a.dtype.names is None])[: 1 << 16]  # fmt: skip
        found.add(f"table {name}", *arrays, sample=numbers)

    for name in SCENES:
        world = build_world(load_scene(name))
        for field in dataclasses.fields(world):
            value = getattr(world, field.name)
            if any(True for _ in arrays_of(value)):
                add(f"{name} {field.name}", value)
        add(f"{name} motion", [world.motion.at(np.full(2, t)) for t in (0.0, 1.7, 9.3)])
    for weather in WEATHERS:
        lights = [daylight(minute, WEATHER[weather]) for minute in HOURS_MIN]
        add(f"sky {weather}", [light.sky for light in lights])
        rows = np.zeros(len(lights), SlotLight.numpy_dtype())
        for row, light in zip(rows, lights, strict=True):
            fill_light(row, light, WEATHER[weather], (0.8, 0.6))
        add(f"light {weather}", [np.ascontiguousarray(rows[n]) for n in rows.dtype.names])
    for name, lens in LENSES.items():
        add(f"lens {name}", [f(lens, *size, 70.0) for f, size in
                             ((ray_table, (320, 180)), (falloff, (180, 320)))])  # fmt: skip
    add("aperture", [taps(), turns(), tone_table()])
    for name in ("spinning_16", "spinning_32", "spinning_128"):
        profile = load_lidar_profile(name)
        add(f"returns {name}", scatter(profile))
        beams = make_beams(profile, profile.hz, wp.get_device("cpu"))
        add(f"beams {name}", [getattr(beams, v) for v in ("azimuth", "theta", "elevation", "time",
                              "share", "offset", "weight")])  # fmt: skip
    model = wp.array([vehicle_model(load_vehicle("opencav"))], dtype=VehicleModel, device="cpu")
    rows = model.numpy()
    add("vehicle", [np.ascontiguousarray(rows[n]) for n in rows.dtype.names])
    add("radar", [[power_table(n) for n in (1, 4, 12)], [table(chebyshev(n, 60.0)) for n in
                  (32, 128)]])  # fmt: skip
    for name in shipped_scenarios():
        add(f"storyboard {name}", compile_native(load_native(name)))
