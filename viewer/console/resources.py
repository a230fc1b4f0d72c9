"""What workers used over time: of a finished run from its table, else from the workers' logs."""

from __future__ import annotations

import io
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.files.regular_file import open_below
from schemas.files.resources import PART_SUFFIX, PARTS_FOLDER, ResourceSample
from viewer.console.run_folder import RunFolder

TABLE_FILE = "resources.parquet"
TAIL_BYTES = 256 << 10
"""What is read of the end of a worker's log [bytes]: an hour of it."""
WORKERS_MAX = 256
"""Workers that are shown."""
POINTS_MAX = 360
"""Points of a worker's plot; of more, every second, third and so on."""
TABLE_BYTES_MAX = 256 << 20

_COLUMNS = (
    "time_ns",
    "worker",
    "host",
    "cpu_cores",
    "ram_bytes",
    "gpu",
    "gpu_percent",
    "gpu_memory_bytes",
    "cases",
)


def resources_of(run: RunFolder) -> dict[str, Any]:
    """Plots by worker: ``t`` since 1970 [s], ``cpu_cores``, ``ram_bytes``, ``gpu_percent``,
    ``gpu_memory_bytes``, ``cases``; None where nothing was measured."""
    plots: dict[str, Any] = {}
    for worker, rows in _rows(run).items():
        step = max(1, -(-len(rows) // POINTS_MAX))
        shown = rows[::step]
        plots[worker] = {
            "host": shown[-1]["host"],
            "gpu": shown[-1]["gpu"],
            "t": [row["time_ns"] / 1e9 for row in shown],
            **{
                name: [row[name] for row in shown]
                for name in ("cpu_cores", "ram_bytes", "gpu_percent", "gpu_memory_bytes", "cases")
            },
        }
    return plots


def gpus_of(run: RunFolder) -> int | None:
    """GPUs that its workers computed on; None: nothing says it."""
    return run.once("gpus", TABLE_FILE, lambda: _gpus(run))


def _gpus(run: RunFolder) -> int | None:
    rows = _rows(run)
    if not rows:
        return None
    return len({row["gpu"] for samples in rows.values() for row in samples if row["gpu"]})


def _rows(run: RunFolder) -> dict[str, list[dict[str, Any]]]:
    table = _table(run)
    return table if table is not None else _parts(run)


def _table(run: RunFolder) -> dict[str, list[dict[str, Any]]] | None:
    try:
        data = run.read(TABLE_FILE, TABLE_BYTES_MAX)
        parquet = pq.ParquetFile(io.BytesIO(data))
        names = [name for name in _COLUMNS if name in parquet.schema_arrow.names]
        table = parquet.read(columns=names)
        place = table.schema.get_field_index("time_ns")
        # A timestamp would become an object of pandas.
        times = table.column("time_ns").cast(pa.int64())
        rows = table.set_column(place, "time_ns", times).to_pylist()
    except (OSError, ValueError, KeyError):
        return None
    by_worker: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        full = {name: row.get(name) for name in _COLUMNS}
        if full["worker"] in by_worker or len(by_worker) < WORKERS_MAX:
            by_worker.setdefault(str(full["worker"]), []).append(full)
    return by_worker


def _parts(run: RunFolder) -> dict[str, list[dict[str, Any]]]:
    try:
        names = sorted(path.name for path in (run.folder / PARTS_FOLDER).iterdir())
    except OSError:
        return {}
    decoder = msgspec.json.Decoder(ResourceSample)
    by_worker: dict[str, list[dict[str, Any]]] = {}
    for name in [name for name in names if name.endswith(PART_SUFFIX)][:WORKERS_MAX]:
        try:
            with open_below(run.folder, f"{PARTS_FOLDER}/{name}") as file:
                size = file.seek(0, 2)
                file.seek(max(0, size - TAIL_BYTES))
                lines = file.read(TAIL_BYTES).split(b"\n")
        except OSError:
            continue
        rows = []
        for line in lines:
            try:
                sample = decoder.decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                continue  # torn, cut at the beginning, or damaged
            rows.append({name: getattr(sample, name) for name in _COLUMNS})
        if rows:
            by_worker[name.removesuffix(PART_SUFFIX)] = rows
    return by_worker
