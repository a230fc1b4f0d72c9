"""How much of a laser pulse each face sends back: near-infrared reflectances of materials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lidar import LidarProfile
from twin.world.meshes import materials
from twin.world.meshes.details import wrapped
from twin.world.meshes.srgb import linear

LONG_WAVE_NM = 1200.0
"""Lasers above are taken as 1550 nm, below as 905 nm."""


@dataclass(frozen=True, slots=True)
class Infrared:
    """One material."""

    base: float
    """Lambertian reflectance of black [-]."""
    gain: float
    """Reflectance added per luminance of the visible colour [-]: pigments that absorb visible light
    are brighter in the infrared."""
    long_wave: float = 0.9
    """Factor at 1550 nm, where water absorbs [-]."""
    retro: float = 0.0
    """Retro-reflected part at normal incidence, relative to a white matt surface [-]."""
    wet: float = 0.8
    """Factor when wet [-]: water fills the pores, and mirrors light away."""
    snow: float = 1.0
    """Whether snow settles on its upper side: 0 or 1."""


# ECOSTRESS spectral library (asphalt, concrete, paint, leaves, brick) for the reflectances,
# rounded; ASTM D4956 coefficients of retro-reflection R_A [cd/(lx m^2)] of sheeting, over 1 / pi.
_MATERIALS: dict[str, Infrared] = {
    "PLAIN": Infrared(0.12, 0.75),
    "ASPHALT": Infrared(0.10, 0.80, wet=0.35),
    "PAVING": Infrared(0.18, 0.70, wet=0.5),
    "PAINT": Infrared(0.30, 0.50, retro=0.8, wet=0.4),
    "FACADE": Infrared(0.15, 0.75, wet=0.7),
    "SHOPFRONT": Infrared(0.12, 0.60),
    "FOLIAGE": Infrared(0.42, 0.60, long_wave=0.6, wet=0.85),
    "CAR_PAINT": Infrared(0.06, 0.70, snow=0.6),
    "GLASS": Infrared(0.04, 0.05, snow=0.0),
    "STREET_LAMP": Infrared(0.30, 0.40),
    "HAZARD": Infrared(0.30, 0.40, retro=15.0, snow=0.0),
    "REFLECTOR": Infrared(0.20, 0.40, retro=150.0, snow=0.0),
    # Of scenes with more than the first downtown.
    "WINDOW": Infrared(0.08, 0.30, snow=0.0),
    "BRICK": Infrared(0.15, 0.75, wet=0.7),
    "PLASTER": Infrared(0.20, 0.70, wet=0.7),
    "SIGN": Infrared(0.30, 0.50, retro=220.0, snow=0.0),
    "SIGNAL": Infrared(0.25, 0.30, snow=0.0),
    "GRASS": Infrared(0.40, 0.60, long_wave=0.6, wet=0.85),
    "TAIL_LAMP": Infrared(0.20, 0.40, retro=120.0, snow=0.0),
    "HEAD_LAMP": Infrared(0.30, 0.40, retro=10.0, snow=0.0),
    "VEHICLE_LAMP": Infrared(0.20, 0.40, retro=150.0, snow=0.0),
    "SIGNAL_LAMP": Infrared(0.25, 0.30, snow=0.0),
    "PLATE": Infrared(0.30, 0.50, retro=150.0, snow=0.0),
}

SNOW_REFLECTANCE = {False: 0.85, True: 0.06}
"""Of fresh snow at 905 nm and at 1550 nm (Warren 1982) [-]."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def is_long_wave(profile: LidarProfile) -> bool:
    """Whether water and snow absorb the laser."""
    return profile.wavelength_nm > LONG_WAVE_NM


def face_returns(faces: np.ndarray, colors: np.ndarray, profile: LidarProfile) -> np.ndarray:
    """Per face float32 [F, 4]: dry reflectance, retro part, factor when wet, snow settles (0..1).

    Args:
        faces: rows of :class:`twin.render.trace.geometry.Face`.
        colors: visible colours, linear RGB [F, 3].
        profile: chooses the wavelength.
    """
    kinds = [Infrared(0.15, 0.70)] * (max(_numbers().values()) + 1)  # materials without a row
    for name, number in _numbers().items():
        kinds[number] = _MATERIALS.get(name, kinds[number])
    long_wave = is_long_wave(profile)
    table = np.array(
        [(k.base, k.gain, k.long_wave if long_wave else 1.0, k.retro, k.wet, k.snow) for k in kinds]
    )
    own = table[np.clip(faces["material"], 0, len(table) - 1)]
    luminance = colors @ _LUMINANCE
    reflectance = np.clip((own[:, 0] + own[:, 1] * luminance) * own[:, 2], 0.0, 0.98)
    wet = own[:, 4] * (0.4 if long_wave else 1.0)
    return np.stack([reflectance, own[:, 3], wet, own[:, 5]], axis=1).astype(np.float32)


def face_colors(
    faces: np.ndarray,
    uv: np.ndarray,
    textures: tuple[np.ndarray, ...],
    kinds: tuple[int, ...] = (),
) -> np.ndarray:
    """Colour of every face, times its image where its corners' middle lies; linear RGB [F, 3].

    Args:
        faces: rows of :class:`twin.render.trace.geometry.Face`.
        uv: texture coordinates of each face's corners [F, 3, 2]; 0, 0 is lower left.
        textures: images uint8 [h, w, 3], sRGB, the first row on top.
        kinds: of the images, as :attr:`twin.world.street.build.World.texture_kinds`.
    """
    colors = faces["color"].astype(float)
    means = uv.mean(axis=1)
    for number, image in enumerate(textures):
        own = faces["texture"] == number
        kind = kinds[number] if kinds else 0
        middle = np.stack([wrapped(means[:, 0], kind & 3), wrapped(means[:, 1], kind >> 2 & 3)], 1)
        height, width = image.shape[:2]
        column = np.minimum((middle[own, 0] * width).astype(int), width - 1)
        row = np.minimum(((1.0 - middle[own, 1]) * height).astype(int), height - 1)
        colors[own] *= linear(image[row, column] / 255.0)
    return colors


def _numbers() -> dict[str, int]:
    return {
        name: value
        for name, value in vars(materials).items()
        if name.isupper() and isinstance(value, int)
    }
