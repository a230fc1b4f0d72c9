"""Arrays of a glTF file: accessors over buffer views, sparse and normalized ones too."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.world.meshes.gltf.document import Document, GltfError, whole

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
VALUES_MAX = 1 << 28
"""Most numbers of one accessor."""


def array(document: Document, index: object, *, as_float: bool = True) -> np.ndarray:
    """The values of an accessor, [count, width] or [count] of scalars.

    Args:
        document: the file.
        index: of the accessor.
        as_float: float64, normalized if it says so; False: whole numbers as they are, int64.

    Raises:
        GltfError: it cannot be read.
        OSError: a file cannot be read.
    """
    accessor = document.row("accessors", index)
    dtype, width = _layout(accessor, index)
    count = whole(accessor, "count")
    if count * width > VALUES_MAX:
        raise GltfError(f"accessors[{index}] has {count} values, at most {VALUES_MAX // width}")
    if "bufferView" in accessor:
        found = _strided(document, accessor, dtype, width, count, f"accessors[{index}]").copy()
    else:
        found = np.zeros((count, width), dtype)
    if "sparse" in accessor:
        _replace(document, accessor["sparse"], found, f"accessors[{index}].sparse")
    if as_float:
        found = _floats(found, normalized=accessor.get("normalized") is True)
    elif dtype.kind == "f":
        raise GltfError(f"accessors[{index}] holds fractions, needed whole numbers")
    else:
        found = found.astype(np.int64)
    return found[:, 0] if width == 1 else found


def _layout(accessor: dict[str, Any], index: object) -> tuple[np.dtype[Any], int]:
    kind, shape = accessor.get("componentType"), accessor.get("type")
    if kind not in TYPES or shape not in WIDTHS:
        raise GltfError(f"accessors[{index}] is of type {str(kind)[:20]} {str(shape)[:20]}")
    return np.dtype(TYPES[kind]), WIDTHS[shape]


def _strided(
    document: Document,
    accessor: dict[str, Any],
    dtype: np.dtype[Any],
    width: int,
    count: int,
    name: str,
) -> np.ndarray:
    """Rows in a buffer view, [count, width], read-only."""
    data, stride = document.view(accessor["bufferView"])
    offset, row = whole(accessor, "byteOffset", 0), dtype.itemsize * width
    stride = stride or row
    if stride < row:
        raise GltfError(f"{name}: rows of {row} bytes every {stride} bytes")
    if count and offset + stride * (count - 1) + row > len(data):
        raise GltfError(f"{name} reads beyond its view of {len(data)} bytes")
    return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))


def _replace(document: Document, sparse: Any, values: np.ndarray, name: str) -> None:
    """Put a sparse accessor's own values in place."""
    if not isinstance(sparse, dict) or not all(
        isinstance(sparse.get(key), dict) and "bufferView" in sparse[key]
        for key in ("indices", "values")
    ):
        raise GltfError(f"{name} has no indices or values")
    count = whole(sparse, "count")
    kind = sparse["indices"].get("componentType")
    if kind not in (5121, 5123, 5125):
        raise GltfError(f"{name}: indices of type {str(kind)[:20]}")
    rows = _strided(document, sparse["indices"], np.dtype(TYPES[kind]), 1, count, name)[:, 0]
    if count and int(rows.max()) >= len(values):
        raise GltfError(f"{name} replaces value {int(rows.max())} of {len(values)}")
    width = values.shape[1]
    values[rows] = _strided(document, sparse["values"], values.dtype, width, count, name)


def _floats(values: np.ndarray, *, normalized: bool) -> np.ndarray:
    """float64; normalized whole numbers as glTF 2.0, 3.6.2.2, says."""
    found = values.astype(np.float64)
    if normalized and values.dtype.kind in "iu":
        found /= np.iinfo(values.dtype).max
        np.maximum(found, -1.0, out=found)
    return found
