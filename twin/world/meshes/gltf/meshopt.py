"""Buffer views compressed with meshoptimizer: EXT_ and KHR_meshopt_compression."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.world.meshes.mesh_header import FILE_BYTES_MAX

ROW_BYTES_MAX = 256
"""Longest row of an attribute [bytes]; the format has none longer."""


def unpack(data: bytes, packed: dict[str, Any], count: int, row: int) -> bytes:
    """The bytes that a buffer view of ``count`` rows of ``row`` bytes would have uncompressed.

    Args:
        data: the compressed bytes.
        packed: the extension's object.
        count: of rows.
        row: length of a row [bytes].

    Raises:
        ValueError: not of the format, or the library is not installed; one line.
    """
    mode, done = packed.get("mode"), packed.get("filter", "NONE")
    whole = (2, 4) if mode in ("TRIANGLES", "INDICES") else range(4, ROW_BYTES_MAX + 1, 4)
    if mode not in ("ATTRIBUTES", "TRIANGLES", "INDICES") or row not in whole:
        raise ValueError(f"mode {str(mode)[:20]} with rows of {row} bytes")
    if count * row > FILE_BYTES_MAX:
        raise ValueError(f"{count} rows of {row} bytes, together at most {FILE_BYTES_MAX}")
    if not count:
        return b""
    try:
        import meshopt
    except ModuleNotFoundError:
        raise ValueError("install drivetwin[gltf], or export without") from None
    rows = meshopt.decode_gltf_buffer(data, count, row, mode, None if done == "NONE" else done)
    return np.ascontiguousarray(rows).tobytes()
