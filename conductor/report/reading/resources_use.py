"""What a campaign used, from its samples: net series over time, and the tables of the report.

All workers sample at the same wall-clock moments, so samples of one moment add up to a net use.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from conductor.report.reading.dossier import Dossier
from conductor.report.reading.resources import hosts_of
from schemas.files.resources import PERIOD_S

Floats = NDArray[np.float64]
GB = 1e9
"""Bytes of a gigabyte, as in the paper."""

WORKERS_MAX = 64
"""Most workers with a line of their own on the page."""

QUANTITIES = (
    "cpu_cores",
    "ram_gb",
    "node_cpu_cores",
    "node_ram_gb",
    "gpu_percent",
    "gpu_memory_gb",
    "gpu_power_w",
)
"""Net use at one moment: sums over workers, nodes and GPUs; ``gpu_percent`` is their mean."""


@dataclass(frozen=True, slots=True)
class UseSpan:
    """Least, mean and most over time."""

    least: float
    mean: float
    most: float


@dataclass(frozen=True, slots=True)
class UseSeries:
    """Net use over time; a value that nobody could measure is NaN."""

    moment: NDArray[np.int64]
    """Wall clock since 1970 [periods]."""
    values: dict[str, Floats]
    """Values by name of :data:`QUANTITIES`."""

    def span(self, name: str) -> UseSpan | None:
        """Span over the moments at which it was measured; None: never."""
        known = self.values[name][~np.isnan(self.values[name])]
        if not len(known):
            return None
        return UseSpan(float(known.min()), float(known.mean()), float(known.max()))


@dataclass(frozen=True, slots=True)
class Use:
    """One line of a table: a node, a batch, or everything."""

    name: str
    workers: int
    gpus: int
    samples: int
    node_cpus: int
    node_ram_gb: float
    gpu_memory_gb: float | None
    """Memory that the GPUs have [GB]."""
    spans: dict[str, UseSpan | None]
    """Spans by name of :data:`QUANTITIES`."""
    models: tuple[str, ...] = ()
    """Systems under test of a batch."""
    gpu_names: tuple[str, ...] = ()
    """Kinds of GPU, sorted."""


@dataclass(frozen=True, slots=True)
class Resources:
    """The resource section of the report."""

    samples: int
    nodes: list[Use]
    """A line per node."""
    total: Use | None
    """All nodes together; None: there are no samples."""
    batches: list[Use]
    """The paper's Table 2: a line per batch that was ever sampled alone."""
    workers: list[Use]
    """A line per worker, by name."""
    series: dict[str, UseSeries]
    """Node -> its use over time."""
    missing: str = ""
    """Why there are no samples."""

    @property
    def workers_shown(self) -> list[Use]:
        """Workers with a line on the page."""
        return self.workers[:WORKERS_MAX]

    def mean_of_batches(self, name: str) -> float | None:
        """Mean of the batches' peaks, the last line of the paper's table."""
        return _mean_peak(self.batches, name)

    def mean_of_workers(self, name: str) -> float | None:
        """Mean of the workers' peaks."""
        return _mean_peak(self.workers, name)


def _mean_peak(uses: list[Use], name: str) -> float | None:
    peaks = [span.most for use in uses if (span := use.spans[name]) is not None]
    return sum(peaks) / len(peaks) if peaks else None


def no_resources(missing: str) -> Resources:
    """A section without samples, and why."""
    return Resources(0, [], None, [], [], {}, missing)


def resources_of(dossier: Dossier, table: pa.Table) -> Resources:
    """Tables and series of the samples in ``table``."""
    if not table.num_rows:
        return no_resources(
            f"workers take one every {PERIOD_S} s while they hold cases, none was taken in this run"
        )
    moments = np.rint(table.column("time_ns").cast(pa.int64()).to_numpy() / (PERIOD_S * 1e9))
    table = table.append_column("moment", pa.array(moments.astype(np.int64)))
    by_host = {host: table.filter(pc.field("host") == host) for host in hosts_of(table)}
    series = {host: series_of(rows) for host, rows in by_host.items()}
    batches = []
    for batch in sorted({row.case.variation.batch for row in dossier.rows} - {0}):
        rows = table.filter(pc.field("batch") == batch)
        if rows.num_rows:
            models = {
                r.case.variation.model: None
                for r in dossier.rows
                if r.case.variation.batch == batch
            }
            batches.append(_use(str(batch), rows, series_of(rows), tuple(models)))
    return Resources(
        samples=table.num_rows,
        nodes=[_use(host, rows, series[host]) for host, rows in by_host.items()],
        total=_use("All", table, series_of(table)),
        batches=batches,
        workers=[_use(name, rows, series_of(rows)) for name, rows in _by_worker(table)],
        series=series,
    )


def _by_worker(table: pa.Table) -> list[tuple[str, pa.Table]]:
    names = sorted(pc.unique(table.column("worker")).to_pylist())
    return [(name, table.filter(pc.field("worker") == name)) for name in names]


def series_of(table: pa.Table) -> UseSeries:
    """Net use of the workers in ``table`` at each moment."""
    workers = _most(table, ["moment", "host", "worker"], ["cpu_cores", "ram_bytes"])
    nodes = _most(table, ["moment", "host"], ["node_cpu_cores", "node_ram_bytes"])
    with_gpu = table.filter(pc.field("gpu").is_valid())
    # Two workers may share a GPU: it counts once.
    gpus = _most(
        with_gpu,
        ["moment", "host", "gpu"],
        ["gpu_percent", "gpu_memory_bytes", "gpu_power_w"],
    )
    moment = np.unique(table.column("moment").to_numpy())
    columns = {
        "cpu_cores": _net(workers, "cpu_cores", moment),
        "ram_gb": _net(workers, "ram_bytes", moment) / GB,
        "node_cpu_cores": _net(nodes, "node_cpu_cores", moment),
        "node_ram_gb": _net(nodes, "node_ram_bytes", moment) / GB,
        "gpu_percent": _net(gpus, "gpu_percent", moment, "mean"),
        "gpu_memory_gb": _net(gpus, "gpu_memory_bytes", moment) / GB,
        "gpu_power_w": _net(gpus, "gpu_power_w", moment),
    }
    return UseSeries(moment, columns)


def _most(table: pa.Table, keys: list[str], columns: list[str]) -> pa.Table:
    """The largest value of each group, under its old name."""
    largest = table.group_by(keys).aggregate([(name, "max") for name in columns])
    return largest.rename_columns([name.removesuffix("_max") for name in largest.column_names])


def _net(table: pa.Table, name: str, moment: NDArray[np.int64], how: str = "sum") -> Floats:
    grouped = table.group_by("moment").aggregate([(name, how)])
    values = np.full(len(moment), np.nan)
    places = np.searchsorted(moment, grouped.column("moment").to_numpy())
    column = grouped.column(f"{name}_{how}").cast(pa.float64())
    values[places] = column.to_numpy(zero_copy_only=False)  # null becomes NaN
    return values


def _use(name: str, table: pa.Table, series: UseSeries, models: tuple[str, ...] = ()) -> Use:
    node = _most(table, ["host"], ["node_cpus", "node_ram_total_bytes"])
    with_gpu = table.filter(pc.field("gpu").is_valid())
    gpu = _most(with_gpu, ["host", "gpu"], ["gpu_memory_total_bytes"])
    total = pc.sum(gpu.column("gpu_memory_total_bytes")).as_py()
    return Use(
        name=name,
        workers=len(pc.unique(table.column("worker"))),
        gpus=gpu.num_rows,
        samples=table.num_rows,
        node_cpus=pc.sum(node.column("node_cpus")).as_py(),
        node_ram_gb=pc.sum(node.column("node_ram_total_bytes")).as_py() / GB,
        gpu_memory_gb=None if total is None else total / GB,
        spans={quantity: series.span(quantity) for quantity in QUANTITIES},
        models=models,
        gpu_names=tuple(sorted(set(with_gpu.column("gpu_name").to_pylist()) - {None})),
    )
