"""The resource log: what a worker's processes, its node and its GPU used, every five seconds.

Each worker appends to a part of its own, ``<campaign>/resources/<worker>.jsonl``: one sample per
line, so that a part can be read at any moment, also after its writer was killed. The conductor
gathers the parts into ``resources.parquet``, whose columns are the fields of
:class:`ResourceSample`.

These are wall-clock measurements: they never reach a KPI, a verdict or a fingerprint.
"""

from __future__ import annotations

from msgspec import Struct

PERIOD_S = 5
"""Every worker samples at wall-clock times that are multiples of this: 0.2 Hz [s]."""

PARTS_FOLDER = "resources"
"""Folder of the parts, in the campaign folder."""

PART_SUFFIX = ".jsonl"
"""Suffix of the name of a part; before it stands the worker's id."""


class ProcessUse(Struct, frozen=True, kw_only=True):
    """One process of a worker."""

    role: str
    """``worker``, ``simulator``, ``stack``, ``recorder``, or the name of any other process."""
    pid: int
    cpu_cores: float | None
    """CPU time per wall time since the sample before; None: there was none [cores]."""
    rss_bytes: int
    """Resident set; memory that processes share counts in each of them [bytes]."""


class ResourceSample(Struct, frozen=True, kw_only=True):
    """What one worker saw at one moment; None: it could not be measured, which is never 0."""

    time_ns: int
    """Wall clock since 1970, UTC [ns]."""
    host: str
    worker: str
    batch: int
    """Batch of all cases that the worker holds; 0: none, or of several batches."""
    cases: int
    """Cases of this campaign that the worker holds."""
    cpu_cores: float | None
    """CPU time per wall time of the worker and its children since the sample before [cores]."""
    ram_bytes: int
    """Sum of the resident sets of the worker and its children [bytes]."""
    processes: list[ProcessUse]
    node_cpus: int
    """Logical CPUs of the node."""
    node_cpu_cores: float | None
    """Busy CPUs of the whole node, whoever uses them [cores]."""
    node_ram_bytes: int
    """Memory of the node that is not available, whoever uses it [bytes]."""
    node_ram_total_bytes: int
    gpu: str | None = None
    """UUID of the worker's GPU; None: it computes on the CPU, or NVML is absent."""
    gpu_name: str | None = None
    gpu_percent: float | None = None
    """Share of the last second or so in which the GPU was busy, 0 to 100 [%]."""
    gpu_memory_bytes: int | None = None
    """Used memory of the GPU, by whomever [bytes]."""
    gpu_memory_total_bytes: int | None = None
    gpu_power_w: float | None = None
