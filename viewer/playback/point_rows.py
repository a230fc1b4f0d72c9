"""Rows of sensors that are drawn as points, read back from a recording: radar detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from viewer.recording import naming

_POSITIONS, _PLACE, _TURN = (
    *("Points3D:positions", "Transform3D:translation", "Transform3D:mat3x3"),
)


@dataclass(frozen=True, slots=True)
class PointRows:
    """Rows of a sensor that was due."""

    places_m: np.ndarray
    """float32 [N, 3] in the axes of the sensor."""
    columns: dict[str, np.ndarray]
    """Their numbers by name, float32 [N]."""


@dataclass(frozen=True, slots=True)
class PointMount:
    """Where such a sensor sits on the ego."""

    position_m: tuple[float, float, float]
    rotation: np.ndarray
    """[3, 3]: vehicle_from_sensor."""


def sensor_of(path: str, batch: pa.RecordBatch) -> str:
    """Name of the sensor whose rows or mount a chunk of entity ``path`` holds; empty: of none."""
    if not path.startswith(f"{naming.EGO}/") or path == naming.CAMERA:
        return ""
    held = {_POSITIONS, _TURN} & set(batch.schema.names)
    return path.removeprefix(f"{naming.EGO}/") if held else ""


def mount_of(batch: pa.RecordBatch) -> PointMount | None:
    """The mount that a static chunk holds; None: it is about something else."""
    if _TURN not in batch.schema.names or _PLACE not in batch.schema.names:
        return None
    row = batch.to_pylist()[0]
    (place,), (turn,) = row[_PLACE], row[_TURN]
    # Rerun keeps matrices by columns.
    return PointMount((place[0], place[1], place[2]), np.array(turn, float).reshape(3, 3).T)


def rows_of(batch: pa.RecordBatch) -> list[PointRows | None]:
    """Rows of each time of a chunk; None: the sensor was not due."""
    names = [name for name in batch.schema.names if _is_number(batch, name)]
    found: list[PointRows | None] = []
    for row in batch.select([*names, _POSITIONS]).to_pylist():
        places = row[_POSITIONS]
        if places is None:
            found.append(None)
            continue
        columns = {name: np.array(row[name] or [], np.float32) for name in sorted(names)}
        found.append(PointRows(np.array(places, np.float32).reshape(-1, 3), columns))
    return found


def _is_number(batch: pa.RecordBatch, name: str) -> bool:
    """Whether a component is a column of the sensor: no archetype's, and a list of numbers."""
    if ":" in name or name.startswith("rerun."):
        return False
    kind: Any = batch.schema.field(name).type
    return bool(pa.types.is_list(kind) and pa.types.is_floating(kind.value_type))
