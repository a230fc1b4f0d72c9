"""The resource log of a campaign folder: parts of its workers, gathered into one Parquet file."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.files.resources import PART_SUFFIX, PARTS_FOLDER, ResourceSample
from twin.base.errors import InfrastructureError, storage_error
from twin.base.files import write_atomic

RESOURCES_FILE = "resources.parquet"

_PROCESS = pa.struct(
    [
        ("role", pa.string()),
        ("pid", pa.int64()),
        ("cpu_cores", pa.float64()),
        ("rss_bytes", pa.int64()),
    ]
)
_TYPES = {
    "time_ns": pa.timestamp("ns", tz="UTC"),
    "host": pa.string(),
    "worker": pa.string(),
    "batch": pa.int64(),
    "cases": pa.int64(),
    "cpu_cores": pa.float64(),
    "ram_bytes": pa.int64(),
    "processes": pa.list_(_PROCESS),
    "node_cpus": pa.int64(),
    "node_cpu_cores": pa.float64(),
    "node_ram_bytes": pa.int64(),
    "node_ram_total_bytes": pa.int64(),
    "gpu": pa.string(),
    "gpu_name": pa.string(),
    "gpu_percent": pa.float64(),
    "gpu_memory_bytes": pa.int64(),
    "gpu_memory_total_bytes": pa.int64(),
    "gpu_power_w": pa.float64(),
}
RESOURCES_SCHEMA = pa.schema([(name, _TYPES[name]) for name in ResourceSample.__struct_fields__])
"""Columns of ``resources.parquet``: fields of :class:`schemas.files.resources.ResourceSample`."""


def read_resources(folder: Path) -> pa.Table:
    """All samples of the campaign ``folder``, gathered or not, by time and worker.

    Raises:
        InfrastructureError: ``resources.parquet`` is damaged. A damaged line of a part, such as the
            last one of a worker that was killed, is left out.
    """
    # The parts first: one that goes meanwhile is in the gathered file then.
    texts = [_read_text(path) for path in _parts(folder)]
    gathered = _read_gathered(folder / RESOURCES_FILE)
    known = set(zip(*(_keys(gathered)), strict=True))
    parts = [_samples(text, known) for text in texts]
    table = pa.concat_tables([gathered, *parts])
    return table.sort_by([("time_ns", "ascending"), ("worker", "ascending")])


def gather_resources(folder: Path, *, complete: bool) -> None:
    """Bring the parts of the campaign ``folder`` into ``resources.parquet``.

    A damaged ``resources.parquet`` is left as it is, and the parts with it.

    Args:
        folder: campaign folder.
        complete: every case has ended, so nobody writes any more: the parts are removed.

    Raises:
        TwinError: the disk lets us down; the parts are still there.
    """
    parts = _parts(folder)
    if not parts:
        return
    try:
        table = read_resources(folder)
    except InfrastructureError:
        return  # whoever shows the samples says so
    data = io.BytesIO()
    pq.write_table(table, data, compression="zstd")
    path = folder / RESOURCES_FILE
    try:
        if table.num_rows:
            write_atomic(path, data.getbuffer())
        if complete:
            for part in parts:
                part.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # a late worker still writes there
                (folder / PARTS_FOLDER).rmdir()
    except OSError as error:
        raise storage_error(error, str(path)) from None


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / PARTS_FOLDER).glob(f"*{PART_SUFFIX}"))


def _read_gathered(path: Path) -> pa.Table:
    if not path.exists():
        return RESOURCES_SCHEMA.empty_table()
    try:
        return pq.read_table(path).cast(RESOURCES_SCHEMA)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InfrastructureError(
            f"{path}: damaged: {' '.join(str(error).split())}; remove it, nothing else needs it"
        ) from None


def _keys(table: pa.Table) -> tuple[list[int], list[str]]:
    times = table.column("time_ns").cast(pa.int64()).to_pylist()
    return times, table.column("worker").to_pylist()


def _read_text(path: Path) -> bytes:
    try:
        return read_regular(path, RUN_FILE_BYTES_MAX)
    except FileNotFoundError:
        return b""


def _samples(text: bytes, known: set[tuple[int, str]]) -> pa.Table:
    """Samples of a part that are not ``known``: a gathering that was killed left them twice."""
    rows = []
    for line in text.splitlines():
        try:
            sample: ResourceSample = decode_json(line, ResourceSample)
        except JsonError:
            continue  # its writer was killed, or the disk was full
        if (sample.time_ns, sample.worker) not in known:
            rows.append(msgspec.to_builtins(sample))
    return pa.Table.from_pylist(rows, schema=RESOURCES_SCHEMA)


def hosts_of(table: pa.Table) -> list[str]:
    """Names of the nodes, sorted."""
    return sorted(pc.unique(table.column("host")).to_pylist())
