"""Heightfield terrain from a PNG or NPY file."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from schemas.files.regular_file import open_regular, read_regular
from twin.base.picture_file import DAMAGED
from twin.world.content import Terrain
from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

SAMPLES_MAX = 1024
"""Most rows, and most columns, of a heightfield."""
_FILE_BYTES_MAX = 64 << 20

_SAMPLE_MAX = {"L": 255.0, "I;16": 65535.0}
"""Pillow's names of what is read, and its largest value."""

_COLORS: dict[str, Color] = {
    "asphalt": (0.09, 0.09, 0.095),
    "paving": (0.30, 0.29, 0.27),
    "grass": (0.07, 0.11, 0.035),
}
_EARTH: Color = (0.20, 0.16, 0.12)


def check_heightmap(path: Path) -> None:
    """Refuse a heightmap that is no regular file, or too large.

    Raises:
        ValueError: one line that names it.
    """
    try:
        open_regular(path, _FILE_BYTES_MAX).close()
    except OSError as error:
        raise ValueError(f"{_where(path)}: {error.strerror or error}") from None


def read_samples(path: Path) -> np.ndarray:
    """Samples of a heightmap, float64 [rows, columns]: shares of the brightest value of a PNG file,
    values of an NPY file as they are; the last row lies at the lowest y.

    Raises:
        ValueError: no such file, no picture or array of heights, too large or not finite; one line
            that names it.
    """
    where = _where(path)
    try:
        data = read_regular(path, _FILE_BYTES_MAX)
    except OSError as error:
        raise ValueError(f"{where}: {error.strerror or error}") from None
    if path.suffix.lower() == ".npy":
        values = _from_npy(data, where)
    elif path.suffix.lower() == ".png":
        values = _from_png(data, where)
    else:
        raise ValueError(f"{where}: allowed are .png and .npy files")
    rows, columns = values.shape
    _check_size(rows, columns, where)
    samples = values.astype(np.float64)
    if not np.isfinite(samples).all():
        raise ValueError(f"{where}: holds NaN or infinite heights")
    return samples


def _where(path: Path) -> str:
    return f"terrain.heightmap {path}"


def _check_size(rows: int, columns: int, where: str) -> None:
    if not (2 <= rows <= SAMPLES_MAX and 2 <= columns <= SAMPLES_MAX):
        raise ValueError(
            f"{where}: {rows} x {columns} samples, allowed 2 to {SAMPLES_MAX} each way"
        )


def _from_npy(data: bytes, where: str) -> np.ndarray:
    try:
        values = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception:  # its header is a Python expression, and wrong in as many ways
        raise ValueError(f"{where}: not an NPY file") from None
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        raise ValueError(
            f"{where}: {values.ndim} axes of {values.dtype}, needed two axes of numbers"
        )
    return values


def _from_png(data: bytes, where: str) -> np.ndarray:
    # Pillow, since OpenCV takes a damaged chunk at its word: 59 bytes made it fill 4 GB.
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            columns, rows = picture.size
            _check_size(rows, columns, where)
            if picture.mode not in _SAMPLE_MAX:
                raise ValueError(f"{where}: needed one channel of 8 or 16 bits")
            values = np.asarray(picture)
    except DAMAGED:
        raise ValueError(f"{where}: not a PNG file") from None
    return values / _SAMPLE_MAX[picture.mode]


def add_terrain(mesh: MeshBuilder, terrain: Terrain, samples: np.ndarray) -> None:
    """Add the heightfield as a mesh.

    Args:
        mesh: receives it.
        terrain: where it lies, and its looks.
        samples: what :func:`read_samples` read of its heightmap.

    Raises:
        ValueError: it is infinitely high.
    """
    heights = samples[::-1] * terrain.height_m
    if not np.isfinite(heights).all():
        raise ValueError(f"{_where(Path(terrain.heightmap))}: holds NaN or infinite heights")
    rows, columns = heights.shape
    x0, y0, z0 = terrain.position_m
    half_x, half_y = terrain.size_m[0] / 2, terrain.size_m[1] / 2
    x = np.linspace(x0 - half_x, x0 + half_x, columns)
    y = np.linspace(y0 - half_y, y0 + half_y, rows)
    points = np.stack([*np.meshgrid(x, y), heights + z0], axis=-1).reshape(-1, 3)
    j, i = (a.ravel() for a in np.meshgrid(range(columns - 1), range(rows - 1)))
    a, b = i * columns + j, (i + 1) * columns + j
    faces = np.concatenate([np.stack([a, a + 1, b + 1], 1), np.stack([a, b + 1, b], 1)])
    color = terrain.color or _COLORS.get(terrain.material, _EARTH)
    with mesh.label(terrain.semantic):
        rgb: Color = (color[0], color[1], color[2])
        mesh.add(points, faces, materials.NAMES[terrain.material], rgb)
