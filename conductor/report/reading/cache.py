"""What a report has read of the KPI files, kept beside the campaign for the next one.

An entry holds as long as the file has the size and time of change it had when it was read, and the
case the digest it was committed with. The folder may be removed at any time.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct

from conductor.records.fingerprint import Fingerprint
from conductor.report.reading.curves import BINS, CURVES, SHARED, KpiCurve
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from twin.base.files import write_atomic
from twin.base.software import own_version

FOLDER = ".report"
_FILE = "read.msgpack"
_VERSION = 3
"""Version of the entries' meaning, together with the columns that are drawn and the package's
version: the byte stream of a fingerprint and the thinning of curves are code too."""


class Stamp(Struct, frozen=True, array_like=True):
    """What says that a file is still the one that was read."""

    kpi_sha256: str
    size: int
    changed_ns: int


class Entry(Struct, frozen=True, array_like=True):
    """A KPI file that was read and found to be the one that was committed."""

    stamp: Stamp
    ticks: int
    points: int = 0
    """Most points that the curve was thinned to; 0: no curve was kept."""
    curve: bytes = b""
    """Time and columns one after the other, float32."""
    means: bytes = b""
    """Means of the shared columns one after the other, float32."""
    rests_m: list[float] = []
    """Distances to the obstacle at which the ego came to rest, in order [m]."""


class Cache(Struct):
    """Entries by case, and the fingerprint of a complete campaign."""

    version: str = f"{_VERSION} {own_version()} {' '.join(CURVES)}"
    entries: dict[str, Entry] = {}
    fingerprint: Fingerprint | None = None
    fingerprint_of: str = ""
    """Digest of the outcomes that it stands for."""


def load(folder: Path) -> Cache:
    """The cache of a campaign folder; empty where there is none that can be used."""
    try:
        cache = msgspec.msgpack.decode(
            read_regular(folder / FOLDER / _FILE, RUN_FILE_BYTES_MAX), type=Cache
        )
    except (OSError, msgspec.MsgspecError):
        return Cache()
    return cache if cache.version == Cache().version else Cache()


def store(folder: Path, cache: Cache) -> None:
    """Write it; a folder that cannot be written has no cache."""
    with contextlib.suppress(OSError):
        (folder / FOLDER).mkdir(exist_ok=True)
        write_atomic(folder / FOLDER / _FILE, msgspec.msgpack.encode(cache), sync=False)


def stamp(path: Path, kpi_sha256: str) -> Stamp | None:
    """Size and times of a file as it is; None: it is not there."""
    try:
        status = path.stat()
    except OSError:
        return None
    return Stamp(kpi_sha256, status.st_size, status.st_mtime_ns)


def packed(curve: KpiCurve) -> tuple[bytes, bytes]:
    """``curve`` and ``means`` of an :class:`Entry`."""
    columns = [curve.time_s, *(curve.values[name] for name in CURVES)]
    means = [curve.means[name] for name in SHARED]
    return np.stack(columns).astype("<f4").tobytes(), np.stack(means).astype("<f4").tobytes()


def unpacked(entry: Entry) -> KpiCurve:
    """The curve of an :class:`Entry`."""
    rows = np.frombuffer(entry.curve, "<f4").reshape(len(CURVES) + 1, -1)
    means = np.frombuffer(entry.means, "<f4").reshape(len(SHARED), BINS)
    values = dict(zip(CURVES, rows[1:], strict=True))
    return KpiCurve(rows[0], values, entry.ticks, dict(zip(SHARED, means, strict=True)))
