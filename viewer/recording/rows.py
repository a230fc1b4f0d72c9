"""Rows of one entity, logged together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from schemas.wire.view import CameraSample, PointsSample, StateSample
from viewer.recording import naming


@dataclass(frozen=True, slots=True)
class EntityRows:
    """Values of an entity at several times."""

    path: str
    sim_time_ns: list[int]
    ticks: list[int]
    columns: list[rr.ComponentColumn]
    """Columns of the entity, each as long as the times."""


def rows_at(
    path: str,
    samples: Sequence[StateSample | CameraSample | PointsSample],
    columns: Iterable[rr.ComponentColumn],
) -> EntityRows:
    """Rows at the times of ``samples``."""
    times, ticks = [s.sim_time_ns for s in samples], [s.tick for s in samples]
    return EntityRows(path, times, ticks, list(columns))


def send(stream: rr.RecordingStream, rows: EntityRows) -> None:
    """Log rows."""
    times = np.array(rows.sim_time_ns, "timedelta64[ns]")
    indexes = [
        rr.TimeColumn(naming.SIM_TIME, duration=times),
        rr.TimeColumn(naming.TICK, sequence=rows.ticks),
    ]
    stream.send_columns(rows.path, indexes, rows.columns)
