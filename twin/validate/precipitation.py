"""What a LiDAR sees of rain, snow and fog, beside what was published.

The sensor stands in the open, so every return is one of the air; and between walls, so every return
of a wall that is missing was taken away by the air.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp
from rich.table import Table

from schemas.sections.lidar import POINT_COLUMNS, RETURN_KINDS, Lidar, LidarMount, LidarProfile
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar.air import rain_extinction, snow_extinction
from twin.sensors.lidar.lidar import LidarSensor, LidarWeather
from twin.sensors.truth import ROTATION, TRUTH
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.sky.weather import AIR_PER_M, MOR_PER_EXTINCTION
from twin.world.street.build import World

RAIN_MM_PER_H = (2.0, 10.0, 25.0, 50.0)
SNOW_MM_PER_H = (0.25, 0.5, 1.0, 4.4)
"""Of water; 1.0 and 4.4 are the presets light_snow and heavy_snow."""
FOG_MOR_M = (40.0, 120.0, 500.0)

CADC_BOX_M = ((-4.0, -4.0, -3.0), (4.0, 4.0, 10.0))
"""Around the sensor: where the Canadian Adverse Driving Conditions data set counts flakes."""
CADC_SHARE = (26 / 60_000, 1443 / 60_000)
"""Fewest and most flakes there in its 75 drives, over the pulses of a sweep of its sensor, a
VLP-32C of 600,000 pulses a second that turns at 10 Hz [-]."""

CADC_RANGE_10_PERCENT_MAX_M = 80.0
"""Sensors that see farther are not of the class that counted these flakes [m]."""
HEAVY_RAIN_MM_PER_H = 25.0
"""From here on every test in rain chambers reports false returns [mm/h]."""

_WALL_M = 50.0
_KEY = 7
_COLUMN = {name: i for i, name in enumerate(POINT_COLUMNS)}


@dataclass(frozen=True, slots=True)
class AirFigures:
    """One profile in one weather. Shares are of all pulses [-]."""

    profile: str
    weather: str
    """rain or snow, of ``amount`` mm/h of water; fog, of ``amount`` metres MOR."""
    amount: float
    returns: float
    """Pulses into the open that come back from a drop, a flake or fog."""
    range_m: tuple[float, float, float]
    """5 %, 50 % and 95 % of these returns lie nearer [m]; zeros without any."""
    in_box: float
    """Those in :data:`CADC_BOX_M`."""
    target: float
    """Returns of walls of 57 % reflectance 50 m away, over those in clear air."""


@dataclass(frozen=True, slots=True)
class PublishedCheck:
    """A figure of ours and the range that was published."""

    name: str
    value: float
    low: float
    high: float
    source: str

    @property
    def passed(self) -> bool:
        """Whether the figure is in the range."""
        return bool(self.low <= self.value <= self.high)


def weather_air(weather: str, amount: float) -> LidarWeather:
    """Air of ``amount`` mm/h of rain or snow, or of fog of a MOR of ``amount`` metres."""
    if weather == "rain":
        # Half as much again for mist and spray, as in twin.world.sky.weather.
        return LidarWeather(AIR_PER_M + 1.5 * rain_extinction(amount), rain_mm_per_h=amount)
    if weather == "snow":
        return LidarWeather(AIR_PER_M + snow_extinction(amount), snow_mm_per_h=amount)
    return LidarWeather(MOR_PER_EXTINCTION / amount)


def figures(profile: LidarProfile) -> list[AirFigures]:
    """``profile`` in every weather of this module."""
    kinds: tuple[tuple[str, Sequence[float]], ...] = (
        ("rain", RAIN_MM_PER_H),
        ("snow", SNOW_MM_PER_H),
        ("fog", FOG_MOR_M),
    )
    open_air, walls = _sensor(profile, _far()), _sensor(profile, _walls())
    clear = _sweep(walls, LidarWeather())[:, _COLUMN["range_m"]]
    there = np.abs(clear - _WALL_M) < 5.0
    return [
        _figures(profile, weather, amount, open_air, walls, there)
        for weather, amounts in kinds
        for amount in amounts
    ]


def checks(found: Sequence[AirFigures], profile: LidarProfile) -> list[PublishedCheck]:
    """The figures that a measurement or a published model exists for; docs/precipitation.md."""
    rows = []
    for own in found:
        what = f"{own.weather}, {own.amount:g} mm/h"
        if own.weather == "rain":
            least = 1e-5 if own.amount >= HEAVY_RAIN_MM_PER_H else 0.0
            most = kilic_share(profile, own.amount)
            name, source = f"{what}, returns", "Kilic et al. 2021"
            rows.append(PublishedCheck(name, own.returns, least, most, source))
        comparable = profile.range_10_percent_m <= CADC_RANGE_10_PERCENT_MAX_M
        if own.weather == "snow" and own.amount <= 1.0 and comparable:
            name, source = f"{what}, returns within 4 m", "Pitropov et al. 2021"
            rows.append(PublishedCheck(name, own.in_box, *CADC_SHARE, source))
    return rows


def kilic_share(profile: LidarProfile, rain_mm_per_h: float) -> float:
    """Share of pulses into the open that come back from a drop by the equations of LISA [-].

    Kilic et al., arXiv 2107.07004 (2021): drops of Marshall and Palmer's sizes from 0.05 mm on in a
    cone, each the share (D / width)^2 of a surface that reflects as water does at normal incidence,
    nearer than 1.5 m nothing. The least signal is that of 10 % at ``range_10_percent_m``.
    """
    r = np.linspace(1.5, 60.0, 3000)
    width_mm = max(profile.divergence_mrad) * r
    reflectance = ((1.328 - 1.0) / (1.328 + 1.0)) ** 2
    passes = np.exp(-2.0 * rain_extinction(rain_mm_per_h) * r)
    least = 0.1 / profile.range_10_percent_m**2
    smallest = np.maximum(np.sqrt(least * r**2 / (reflectance * passes)) * width_mm, 0.05)
    slope = 4.1 * rain_mm_per_h**-0.21
    per_m = 8e3 / slope * np.exp(-slope * smallest) * np.pi / 4.0 * (1e-3 * width_mm) ** 2
    return float(-np.expm1(-per_m.sum() * (r[1] - r[0])))


def to_tables(found: Sequence[AirFigures], rows: Sequence[PublishedCheck]) -> tuple[Table, Table]:
    """Figures and checks for people."""
    title = f"{found[0].profile}: shares of pulses"
    figures = Table(title=title, title_justify="left")
    names = ("weather", "returns of the air", "5 % / 50 % / 95 % [m]", "within 4 m", "target, 50 m")
    for i, name in enumerate(names):
        figures.add_column(name, justify="right" if i else "left")
    for own in found:
        unit = "m MOR" if own.weather == "fog" else "mm/h"
        ranges = " / ".join(f"{r:.1f}" for r in own.range_m) if own.returns else ""
        figures.add_row(
            f"{own.weather}, {own.amount:g} {unit}",
            f"{100 * own.returns:.3f} %",
            ranges,
            f"{100 * own.in_box:.3f} %",
            f"{100 * own.target:.1f} %",
        )
    published = Table(title="beside what was published", title_justify="left")
    for name in ("figure", "ours", "published", "source", ""):
        published.add_column(name, justify="right" if name in ("ours", "published") else "left")
    for row in rows:
        limits = f"{100 * row.low:.3f} to {100 * row.high:.3f} %"
        verdict = "ok" if row.passed else "FAILED"
        published.add_row(row.name, f"{100 * row.value:.3f} %", limits, row.source, verdict)
    return figures, published


def to_json(found: Sequence[AirFigures], rows: Sequence[PublishedCheck]) -> dict[str, Any]:
    """Figures and checks."""
    return {
        "passed": all(row.passed for row in rows),
        "figures": [asdict(own) for own in found],
        "checks": [asdict(row) | {"passed": row.passed} for row in rows],
    }


def _figures(
    profile: LidarProfile,
    weather: str,
    amount: float,
    open_air: LidarSensor,
    walls: LidarSensor,
    there: np.ndarray,
) -> AirFigures:
    air = weather_air(weather, amount)
    points = _sweep(open_air, air)
    seen = points[points[:, _COLUMN["kind"]] > 0.0]
    low, high = (np.array(corner) for corner in CADC_BOX_M)
    inside = ((seen[:, :3] > low) & (seen[:, :3] < high)).all(axis=1)
    quantiles = (
        np.quantile(seen[:, _COLUMN["range_m"]], [0.05, 0.5, 0.95]) if len(seen) else [0] * 3
    )
    hit = _sweep(walls, air)[there, _COLUMN["kind"]] == RETURN_KINDS.index("surface")
    near, middle, far = (float(q) for q in quantiles)
    return AirFigures(
        profile=profile.lidar,
        weather=weather,
        amount=amount,
        returns=len(seen) / len(points),
        range_m=(near, middle, far),
        in_box=float(inside.sum()) / len(points),
        target=float(hit.mean()),
    )


def _sensor(profile: LidarProfile, world: World) -> LidarSensor:
    mount = LidarMount([0.0, 0.0, 0.0], inline=profile)
    geometry = Geometry(world, 1, wp.get_device("cpu"))
    return LidarSensor(profile, mount, geometry, Lidar(motion=False))


def _sweep(sensor: LidarSensor, weather: LidarWeather) -> np.ndarray:
    """Points [rays, K]; always the same random numbers."""
    truth = np.zeros((1, len(TRUTH)))
    truth[0, ROTATION + 3] = 1.0
    sensor.reset(0, _KEY, weather)
    sensor.scan(wp.array(truth, dtype=wp.float64, device="cpu"))
    return np.array(sensor.pull()[0][0])


def _world(mesh: MeshBuilder) -> World:
    return World(mesh.build(), np.zeros((1, 5)), 0, (0.0, 0.0), (0.0, 0.0))


def _far() -> World:
    """A square metre a long way off: a world has to have a face."""
    mesh = MeshBuilder()
    far = 5000.0
    corners = [(far, 0.0, 0.0), (far, 1.0, 0.0), (far, 1.0, 1.0), (far, 0.0, 1.0)]
    mesh.quad(corners, materials.PLAIN, (0.6, 0.6, 0.6))
    return _world(mesh)


def _walls() -> World:
    """Four grey walls 50 m away; PLAIN of luminance 0.6 reflects 57 %."""
    mesh = MeshBuilder()
    d = _WALL_M
    for x, y, turn in ((d, 0.0, 0), (0.0, d, 1), (-d, 0.0, 0), (0.0, -d, 1)):
        across = np.array([0.0, d, 0.0] if turn == 0 else [d, 0.0, 0.0])
        middle, up = np.array([x, y, 0.0]), np.array([0.0, 0.0, 4.0 * d])
        corners = [
            tuple(middle - across - up),
            tuple(middle + across - up),
            tuple(middle + across + up),
            tuple(middle - across + up),
        ]
        mesh.quad(corners, materials.PLAIN, (0.6, 0.6, 0.6))
    return _world(mesh)
