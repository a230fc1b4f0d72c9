"""Reads the KPI files of a campaign once: curves to draw, the fingerprint, and what is damaged."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from conductor.records.fingerprint import (
    Fingerprint,
    Fingerprinter,
    committed_rows,
    kpi_path,
    label_of,
)
from conductor.records.outcomes import CaseOutcome
from conductor.report.reading import cache as caching
from conductor.report.reading.cache import Cache, Entry
from conductor.report.reading.curves import KpiCurve, thin
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.rest import Track
from twin.base.errors import InfrastructureError
from twin.base.progress import steps


@dataclass(frozen=True, slots=True)
class KpiReading:
    """Content of the KPI files."""

    curves: dict[str, KpiCurve]
    """Curves by case, of the cases that are drawn."""
    broken: list[str]
    """Mistakes, one line each."""
    rests_m: dict[str, list[float]]
    """Distances to the obstacle where the ego came to rest, in order, by case [m]."""
    damaged: int
    """KPI files that could not be read."""
    fingerprint: Fingerprint | None
    """Fingerprint; None: cases have not ended, or files are damaged."""
    read: int
    """Files that were read; the others had been read before and have not changed."""


Known = Mapping[str, tuple[Entry, bytes]]
"""Entries by case that were read ahead, each with its canonical byte stream."""
NOTHING_KNOWN: Known = MappingProxyType({})


def read_cases(
    dossier: Dossier,
    drawn: Collection[str],
    points: int,
    *,
    anew: bool = False,
    known: Known = NOTHING_KNOWN,
) -> KpiReading:
    """Read what an earlier report has not.

    The fingerprint of a campaign that has become complete takes every file: once.

    Args:
        dossier: the campaign.
        drawn: cases whose curves are wanted.
        points: about the most points of a curve.
        anew: read and check every file, whatever an earlier report found.
        known: files that this process has read and checked; they are not read again.
    """
    old = Cache() if anew else caching.load(dossier.folder)
    new = Cache()
    wanted = _outcomes_digest(dossier) if dossier.outcomes.complete else ""
    kept_fingerprint = old.fingerprint if wanted and old.fingerprint_of == wanted else None
    total = Fingerprinter() if wanted and kept_fingerprint is None else None
    curves: dict[str, KpiCurve] = {}
    rests_m: dict[str, list[float]] = {}
    broken: dict[str, str] = {}
    read = 0
    for row in steps("KPI files", sorted(dossier.rows, key=lambda row: row.case.id)):
        name = row.case.id
        limit = points if name in drawn else 0
        rows = b""
        try:
            entry = _kept(dossier, row, old, limit)
            if entry is None or (total is not None and row.end.kpi_sha256):
                ahead = known.get(name)
                if ahead is not None and _holds(dossier, row, ahead[0], limit):
                    entry, rows = ahead
                else:
                    entry, rows = read_case(dossier.folder, name, row.end, limit)
                read += bool(rows)
        except InfrastructureError as error:
            broken[name] = str(error)
            total = kept_fingerprint = None
            continue
        rests_m[name] = entry.rests_m
        if entry.curve and name in drawn:
            curves[name] = caching.unpacked(entry)
        if row.end.kpi_sha256:
            new.entries[name] = entry
        if total is not None:
            total.add(name, row.end, rows)
    new.fingerprint = kept_fingerprint or (total.result(dossier.outcomes) if total else None)
    new.fingerprint_of = wanted
    if read or len(new.entries) != len(old.entries):
        caching.store(dossier.folder, new)
    lines = [broken[row.case.id] for row in dossier.rows if row.case.id in broken]
    damaged = sum(bool(r.end.kpi_sha256) for r in dossier.rows if r.case.id in broken)
    return KpiReading(curves, lines, rests_m, damaged, new.fingerprint, read)


_NOTHING = Entry(caching.Stamp("", 0, 0), 0)


def _kept(dossier: Dossier, row: CaseRow, old: Cache, points: int) -> Entry | None:
    """Entry that an earlier report has made, if it still holds; a case without rows needs no
    reading."""
    if not row.end.kpi_sha256:
        if row.end.outcome == "verdict":
            raise InfrastructureError(f"case {row.case.id}: a verdict without KPI rows")
        return _NOTHING
    entry = old.entries.get(row.case.id)
    return entry if entry is not None and _holds(dossier, row, entry, points) else None


def _holds(dossier: Dossier, row: CaseRow, entry: Entry, points: int) -> bool:
    """Whether the file is as it was when it was read, and its curve, if one is wanted, fits."""
    path = kpi_path(dossier.folder, row.case.id, row.end)
    same = entry.stamp == caching.stamp(path, row.end.kpi_sha256)
    return same and points in (0, entry.points)


def read_case(folder: Path, name: str, end: CaseOutcome, points: int) -> tuple[Entry, bytes]:
    """The KPI file of a case, its curve thinned to ``points`` (0: none), and its canonical byte
    stream.

    Raises:
        InfrastructureError: it is missing, damaged, or not the one that was committed.
    """
    path = kpi_path(folder, name, end)
    stamp = caching.stamp(path, end.kpi_sha256)  # before: a later change is noticed
    table, rows = committed_rows(folder, name, end)
    curve, means = caching.packed(thin(table, points)) if points else (b"", b"")
    rests_m = Track.of(table).rests_m()
    return Entry(stamp or _NOTHING.stamp, table.num_rows, points, curve, means, rests_m), rows


def _outcomes_digest(dossier: Dossier) -> str:
    sha = hashlib.sha256()
    for row in dossier.rows:
        sha.update(repr((row.case.id, label_of(row.end), row.end.kpi_sha256)).encode())
    sha.update(repr(dossier.outcomes.device_classes).encode())
    return sha.hexdigest()
