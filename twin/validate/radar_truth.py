"""What a radar measures of targets and noise with known answers, beside these answers.

Targets stand in the open before a radar that does not move; there is no clutter and no second way.
Sources: closed forms of cross sections (Knott, Shaeffer, Tuley: Radar Cross Section, chapters 5 and
6), ITU-R P.838-3 table 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import warp as wp
from msgspec import structs
from rich.table import Table

from twin.render.trace.geometry import Geometry
from twin.sensors.radar.bodies import CYLINDER, LOBE, PLATE, SPHERE, TRIHEDRAL, Reflector
from twin.sensors.radar.profile import RadarProfile
from twin.sensors.radar.rain import coefficients
from twin.sensors.radar.sensor import RadarSensor
from twin.sensors.radar.window import chebyshev
from twin.vehicle.columns import COLUMN, TELEMETRY
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.street.build import World

CELLS = 1_000_000
"""Cells of noise, at least, whose alarms are counted."""
ALARM_RATE = 1e-3
"""Asked of them [-]: a shipped profile's rate would need a thousand times as many cells."""

TICKS = 48
"""Measurements with other noise that are averaged."""
SNR = 10.0**2.5
"""Signal over noise of the targets whose bias is looked for, before what windows lose [-]."""

_RANGES_M = (12.07, 25.2)
_SHARES = (0.0, 0.13, 0.31, 0.5, 0.77)
_P838 = {
    10.0: (0.01217, 1.2571, 0.01129, 1.2156),
    40.0: (0.4431, 0.8673, 0.4274, 0.8421),
    80.0: (1.1704, 0.7115, 1.1668, 0.7021),
    100.0: (1.3671, 0.6815, 1.3680, 0.6765),
}
"""Frequency [GHz] -> k and alpha, horizontal and vertical: rows of table 5."""
_RANGE, _SPEED, _RCS, _SNR = 0, 3, 4, 5


@dataclass(frozen=True, slots=True)
class TruthRow:
    """A figure, its largest allowed value, and whether it holds."""

    what: str
    value: float
    allowed: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the figure is within what is allowed."""
        return self.value <= self.allowed


class _Range:
    """A radar of a profile before targets."""

    def __init__(self, profile: RadarProfile) -> None:
        self.profile = structs.replace(profile, rays=[1, 1], yaw_deg=0.0)
        mesh = MeshBuilder()
        corners = [(900.0, 0.0, 0.0), (901.0, 0.0, 0.0), (901.0, 1.0, 0.0), (900.0, 1.0, 0.0)]
        mesh.quad(corners, materials.PLAIN, (0.5, 0.5, 0.5))
        self._world = World(mesh.build(), np.zeros((1, 5)), 0, (0.0, -5.0), (13.0, 8.0))

    def sensor(self, *targets: Reflector, noise: bool = False) -> RadarSensor:
        """The radar before ``targets``."""
        geometry = Geometry(self._world, 1, wp.get_device("cpu"))
        sensor = RadarSensor(self.profile, geometry, targets)
        sensor.reset(0, 7, noise=noise)
        sensor.mount(0, (0.0, 0.0, self.profile.height_m), 0.0)
        row = sensor.state.host[0]
        row["multipath"], row["clutter"] = 0, 0
        return sensor

    def measure(self, sensor: RadarSensor, tick: int = 0) -> np.ndarray:
        """Detections [N, 6]."""
        state = np.zeros((1, len(TELEMETRY)))
        state[0, COLUMN["orientation_w"]] = 1.0
        sensor.state.host["tick"] = tick
        sensor.measure(wp.array(state, dtype=wp.float64, device="cpu"))
        rows, count = sensor.pull()
        return rows[0, : count[0]].astype(float)

    def point(self, range_m: float, speed_mps: float = 0.0, m2: float = 10.0) -> Reflector:
        """A target that looks the same from everywhere."""
        place = (range_m, 0.0, self.profile.height_m)
        return Reflector(LOBE, place, size_m=(m2, 100.0), velocity_mps=(speed_mps, 0.0))

    def mean_of(self, target: Reflector) -> np.ndarray:
        """Mean detection of ``target`` in noise over :data:`TICKS` ticks [6]; NaN if it was missed
        or there were others within a cell."""
        sensor = self.sensor(target, noise=True)
        far = math.hypot(target.position_m[0], target.position_m[1])
        found = []
        for tick in range(TICKS):
            rows = self.measure(sensor, tick)
            near = rows[np.abs(rows[:, _RANGE] - far) < self.profile.range_cell_m]
            found.append(near[0] if len(near) == 1 else np.full(6, np.nan))
        return np.asarray(np.mean(found, axis=0))

    def faint(self, range_m: float) -> float:
        """Cross section that is :data:`SNR` over the noise there, all antennas together [m^2]."""
        of_one = self.profile.signal_at_1_m * self.profile.antennas
        return SNR * range_m**4 / of_one

    def count_of(self, *targets: Reflector) -> int:
        """Detections of ``targets`` without noise."""
        return len(self.measure(self.sensor(*targets)))


def truth_rows(profile: RadarProfile) -> list[TruthRow]:
    """All figures of ``profile``."""
    stand = _Range(profile)
    return [
        _equation(stand),
        *_cross_sections(stand),
        *_biases(stand),
        _false_alarms(profile),
        _rain(),
        *_pairs(stand),
    ]


def _cross_sections(stand: _Range) -> list[TruthRow]:
    wavelength = stand.profile.wavelength_m
    forms: dict[str, tuple[int, tuple[float, ...], float]] = {
        "sphere": (SPHERE, (0.3,), math.pi * 0.3**2),
        "plate": (PLATE, (0.1, 0.1), 4.0 * math.pi * 0.1**4 / wavelength**2),
        "corner": (TRIHEDRAL, (0.06,), 12.0 * math.pi * 0.06**4 / wavelength**2),
        "cylinder": (CYLINDER, (0.03, 0.15), 2.0 * math.pi * 0.03 * 0.15**2 / wavelength),
    }
    found = []
    for name, (shape, size_m, m2) in forms.items():
        worst = 0.0
        for range_m in _RANGES_M:
            place = (range_m, 0.0, stand.profile.height_m)
            mean = stand.mean_of(Reflector(shape, place, math.pi, size_m))
            worst = _worse(worst, mean[_RCS] - 10.0 * math.log10(m2))
        found.append(
            TruthRow(f"cross section of a {name}, largest mean difference", worst, 0.5, "dB")
        )
    return found


def _worse(worst: float, off: float) -> float:
    """The larger magnitude; infinite where a target was missed."""
    return math.inf if math.isnan(off) else max(worst, abs(float(off)))


def _equation(stand: _Range) -> TruthRow:
    """Signal-to-noise ratio of 10 m^2 in the middle of a cell, by the figures of the profile."""
    p = stand.profile
    far, speed = 40.0 * p.range_cell_m, p.speed_min_mps + 30.0 * p.speed_cell_mps
    watts, gain = 10.0 ** (p.transmit_dbm / 10.0 - 3.0), 10.0 ** (p.gain_dbi / 10.0)
    received = watts * gain**2 * p.wavelength_m**2 * 10.0 / ((4.0 * math.pi) ** 3 * far**4)
    noise = 1.380649e-23 * 290.0 * 10.0 ** ((p.noise_figure_db + p.loss_db) / 10.0)
    energy = received * p.chirps * p.chirp_s * p.antennas / noise
    for count in (p.samples, p.chirps):
        window = chebyshev(count, p.sidelobe_db)
        energy *= window.sum() ** 2 / (count * (window**2).sum())
    mean = stand.mean_of(stand.point(far, speed))
    off = _worse(0.0, mean[_SNR] - 10.0 * math.log10(energy))
    return TruthRow("signal-to-noise ratio against the radar equation, difference", off, 0.5, "dB")


def _biases(stand: _Range) -> list[TruthRow]:
    cell_m, cell_mps = stand.profile.range_cell_m, stand.profile.speed_cell_mps
    off_range = off_speed = 0.0
    for share in _SHARES:
        range_m = (40.0 + share) * cell_m
        speed = stand.profile.speed_min_mps + (30.0 + share) * cell_mps
        mean = stand.mean_of(stand.point(range_m, speed, stand.faint(range_m)))
        off_range = _worse(off_range, (mean[_RANGE] - range_m) / cell_m)
        off_speed = _worse(off_speed, (mean[_SPEED] - speed) / cell_mps)
    return [
        TruthRow(
            "range of a faint target anywhere in a cell, largest mean bias", off_range, 0.1, "cells"
        ),
        TruthRow("its radial speed, largest mean bias", off_speed, 0.1, "cells"),
    ]


def _false_alarms(profile: RadarProfile) -> TruthRow:
    stand = _Range(structs.replace(profile, false_alarm_rate=ALARM_RATE))
    sensor = stand.sensor(noise=True)
    rows = slice(sensor.model.first_row, sensor.model.last_row + 1)
    cells = alarms = tick = 0
    while cells < CELLS:
        stand.measure(sensor, tick)
        sensor.look(peaks_only=False)
        alarm = sensor.alarm.numpy()[:, :, rows]
        cells, alarms, tick = cells + alarm.size, alarms + int(alarm.sum()), tick + 1
    what = f"false alarms of {cells:,} cells against the rate asked for, {ALARM_RATE:g}"
    return TruthRow(what, abs(alarms / cells / ALARM_RATE - 1.0), 0.1, "relative")


def _rain() -> TruthRow:
    worst = 0.0
    for ghz, table in _P838.items():
        ours = [v for vertical in (False, True) for v in coefficients(ghz * 1e9, vertical=vertical)]
        worst = max(worst, *(abs(a / b - 1.0) for a, b in zip(ours, table, strict=True)))
    return TruthRow("rain: k and alpha against table 5 of ITU-R P.838-3", worst, 5e-4, "relative")


def _pairs(stand: _Range) -> list[TruthRow]:
    cell_m, cell_mps = stand.profile.range_cell_m, stand.profile.speed_cell_mps

    def off(first: Reflector, second: Reflector, count: int) -> float:
        return float(abs(stand.count_of(first, second) - count))

    point: Callable[..., Reflector] = stand.point
    near, speed = 40.0 * cell_m, 3.0 * cell_mps
    within = off(point(near + 0.1 * cell_m), point(near + 0.5 * cell_m), 1)
    by_range = off(point(near), point(near + 3.0 * cell_m), 2)
    by_speed = off(point(near), point(near, speed), 2)
    return [
        TruthRow("two targets in a cell are one detection, too many", within, 0.0, ""),
        TruthRow("three cells of range apart they are two, missing", by_range, 0.0, ""),
        TruthRow("three cells of speed apart they are two, missing", by_speed, 0.0, ""),
    ]


def to_table(profile: RadarProfile, rows: list[TruthRow]) -> Table:
    """The figures for people."""
    table = Table(title=f"{profile.radar}: what is known", title_justify="left")
    for name in ("figure", "value", "at most", "unit", ""):
        table.add_column(name, justify="right" if name in ("value", "at most") else "left")
    for row in rows:
        verdict = "ok" if row.passed else "MISS"
        table.add_row(row.what, f"{row.value:.4g}", f"{row.allowed:g}", row.unit, verdict)
    return table


def to_json(profile: RadarProfile, rows: list[TruthRow]) -> dict[str, object]:
    """The figures for scripts; missing ones, which are infinite, are null."""
    found = [asdict(row) | {"passed": row.passed} for row in rows]
    for row in found:
        row["value"] = row["value"] if math.isfinite(row["value"]) else None
    return {"profile": profile.radar, "figures": found}
