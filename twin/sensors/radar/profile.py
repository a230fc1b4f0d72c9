"""Radar profiles: what a radar is built like, and what follows from it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from twin.world.scene import load_named

_PROFILES = Path(__file__).parent / "profiles"

LIGHT_MPS = 299_792_458.0
_BOLTZMANN = 1.380649e-23
_ROOM_K = 290.0
COLUMNS_MAX, CELLS_MAX = 32, 262_144
"""Most columns of an array, and most range-Doppler cells."""

Positive = Annotated[float, Meta(gt=0)]
Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


class RadarProfile(Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """One kind of chirp-sequence radar with a virtual array of one or two rows."""

    schema: Literal[1] = 1
    radar: str
    """Name of the profile."""
    carrier_hz: Annotated[float, Meta(ge=20e9, le=150e9)]
    """Middle of the sweep [Hz]."""
    bandwidth_hz: Annotated[float, Meta(ge=10e6, le=5e9)]
    """Swept while the receiver samples [Hz]."""
    samples: Annotated[int, Meta(ge=32, le=2048)]
    """Complex samples of a chirp: as many range cells."""
    chirp_s: Positive
    """Sampled part of a chirp [s]."""
    repetition_s: Positive
    """From a chirp of a transmitter to its next [s]."""
    chirps: Annotated[int, Meta(ge=16, le=1024)]
    """Chirps of a transmitter in a measurement: as many speed cells."""
    speed_min_mps: float
    """Lowest radial speed that is not folded [m/s]."""
    transmit_dbm: float
    """Power of a transmitter [dBm]."""
    gain_dbi: float
    """Of a transmit or receive antenna in its axis [dBi]."""
    beam_deg: Pair
    """Half-power widths of such an antenna, azimuth and elevation [deg]."""
    floor_db: Pair
    """Least gain beside the beam, relative to the axis, azimuth and elevation [dB]."""
    noise_figure_db: float
    """[dB]"""
    loss_db: float
    """Of bumper and radome, both ways [dB]."""
    columns: Annotated[int, Meta(ge=2, le=COLUMNS_MAX)]
    """Elements of the lower row."""
    upper: Annotated[int, Meta(ge=0, le=COLUMNS_MAX)]
    """Elements of the upper row, above the first of the lower one; 0: no elevation."""
    spacing: Annotated[float, Meta(ge=0.25, le=4)]
    """Between columns [wavelengths]."""
    lift: Annotated[float, Meta(ge=0.25, le=4)]
    """Between the rows [wavelengths]."""
    half_view_deg: Pair
    """Half the field of view, azimuth and elevation [deg]."""
    range_min_m: Positive
    """Nearest detection [m]."""
    range_max_m: Positive
    """Farthest detection [m]."""
    false_alarm_rate: Annotated[float, Meta(ge=1e-12, le=0.1)]
    """Probability that noise alone exceeds the threshold, per cell [-]."""
    sidelobe_db: Annotated[float, Meta(ge=30, le=100)]
    """Below the main lobe, of the windows in range and speed [dB]."""
    rays: Annotated[list[int], Meta(min_length=2, max_length=2)]
    """Rays that look for clutter, azimuth and elevation."""
    height_m: float
    """Where it sits by default, above the ground [m]."""
    yaw_deg: float
    """Where it looks by default, to the left of forward [deg]."""

    def __post_init__(self) -> None:
        if self.chirp_s > self.repetition_s:
            raise ValueError(
                f"chirp_s {self.chirp_s:g} must not be above repetition_s {self.repetition_s:g}"
            )
        if self.upper > self.columns:
            raise ValueError(f"upper {self.upper} must not be above columns {self.columns}")
        if self.samples * self.chirps > CELLS_MAX:
            raise ValueError(
                f"{self.samples} samples x {self.chirps} chirps are too many cells, "
                f"at most {CELLS_MAX}"
            )
        if self.range_max_m > (self.samples - 4) * self.range_cell_m:
            raise ValueError(
                f"range_max_m {self.range_max_m:g} is beyond what {self.samples} samples reach, "
                f"{(self.samples - 4) * self.range_cell_m:.1f} m"
            )

    @property
    def wavelength_m(self) -> float:
        """Wavelength of the carrier [m]."""
        return LIGHT_MPS / self.carrier_hz

    @property
    def range_cell_m(self) -> float:
        """c / 2 B [m]."""
        return LIGHT_MPS / (2.0 * self.bandwidth_hz)

    @property
    def speed_cell_mps(self) -> float:
        """lambda / 2 N T [m/s]."""
        return self.wavelength_m / (2.0 * self.chirps * self.repetition_s)

    @property
    def antennas(self) -> int:
        """Elements of the virtual array."""
        return self.columns + self.upper

    @property
    def signal_at_1_m(self) -> float:
        """Signal over thermal noise in one cell of one antenna, of 1 m^2 at 1 m in the axis [-].

        Radar equation P G^2 lambda^2 sigma / ((4 pi)^3 R^4 L) over k T0 F, times the time that is
        integrated; what windows lose comes on top (:func:`twin.sensors.radar.window.loss`).
        """
        power_w = 10.0 ** ((self.transmit_dbm - 30.0) / 10.0)
        gain = 10.0 ** (self.gain_dbi / 5.0)
        loss = 10.0 ** ((self.loss_db + self.noise_figure_db) / 10.0)
        seconds = self.chirps * self.chirp_s
        spread = (4.0 * math.pi) ** 3 * _BOLTZMANN * _ROOM_K
        return power_w * gain * self.wavelength_m**2 * seconds / (spread * loss)


def load_radar_profile(name_or_path: str) -> RadarProfile:
    """Load a shipped radar profile by name, or a profile file by path.

    Raises:
        ValueError: no such profile, or a mistake in its file; one line.
    """
    return load_named(name_or_path, RadarProfile, _PROFILES, "radar profile")
