"""Rows of a sensor that are drawn as points as ``foxglove.PointCloud``, with all their numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from viewer.playback.outputs import needed
from viewer.playback.point_rows import PointMount, PointRows

_OPTION = "--mcap"
_PLACES = ("x", "y", "z")


class PointClouds:
    """Makes the messages."""

    def __init__(self) -> None:
        def schema(name: str) -> Any:
            return needed(f"foxglove_schemas_protobuf.{name}_pb2", _OPTION)

        self._cloud = schema("PointCloud").PointCloud
        self._float32 = schema("PackedElementField").PackedElementField.FLOAT32

    def of(self, rows: PointRows, mount: PointMount | None) -> Any:
        """Points in the axes of the sensor, whose pose in those of the ego stands beside them.
        Fields: x, y, z [m], then the sensor's columns by name, all float32."""
        values = [rows.places_m, *(column[:, None] for column in rows.columns.values())]
        packed = np.concatenate(values, axis=1).astype("<f4")
        names = (*_PLACES, *rows.columns)
        cloud = self._cloud(frame_id="ego", point_stride=4 * len(names), data=packed.tobytes())
        for number, name in enumerate(names):
            cloud.fields.add(name=name, offset=4 * number, type=self._float32)
        at, turn = cloud.pose.position, cloud.pose.orientation
        if mount is None:
            turn.w = 1.0
        else:
            at.x, at.y, at.z = mount.position_m
            turn.x, turn.y, turn.z, turn.w = _quaternion(mount.rotation)
        return cloud


def _quaternion(turn: np.ndarray) -> tuple[float, float, float, float]:
    """Quaternion x, y, z, w of a rotation by less than half a turn, or by half a turn exactly
    (Shepperd 1978)."""
    trace = float(np.trace(turn))
    squares = 0.25 * (1.0 + np.array([*(2.0 * np.diag(turn) - trace), trace]))
    largest = int(np.argmax(squares))
    sums = turn + turn.T
    less = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    if largest == 3:
        parts = np.array([*less, 4.0 * squares[3]])
    else:
        parts = np.array([*sums[largest], less[largest]])
        parts[largest] = 4.0 * squares[largest]
    x, y, z, w = parts / (4.0 * np.sqrt(squares[largest]))
    return float(x), float(y), float(z), float(w)
