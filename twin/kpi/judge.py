"""Comes to the verdict of a committed attempt again, from its files alone; no Warp is loaded."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa

from schemas import SCHEMA_VERSION
from schemas.escape import escape
from schemas.files.judging import (
    RECORD_BYTES_MAX,
    RECORD_FILE,
    Claim,
    Judgement,
    JudgeRecord,
    attempt_digest,
)
from schemas.files.regular_file import read_regular
from schemas.kinds.kpi import KpiKind
from schemas.kinds.scenario import kind_of
from schemas.sections.scenario import Scenario
from twin.base.errors import InfrastructureError
from twin.kpi import verdict as judging
from twin.kpi.computed import computed_column
from twin.kpi.judge_record import hit_of, state_of, surroundings_of
from twin.kpi.robustness import formula_scalars
from twin.records.kpi_file import kpi_sha256, read_kpi
from twin.scenario.families import replay

LOG_BYTES_MAX = 1 << 30
_NUMBER = re.compile(r"\d+\.\d+")
DIFFERENCES_MAX = 8
"""Most that are told of one attempt."""


class TableRows:
    """Rows that were read from a file, as :class:`twin.kpi.recorder.CaseRows` gives them."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self._values: dict[str, np.ndarray] = {}
        self.rows: int = table.num_rows

    def column(self, name: str) -> np.ndarray:
        """Values of a column [rows]; 0 where missing."""
        if name not in self._values:
            data = self._table.column(name).combine_chunks()
            if data.null_count:
                data = data.fill_null(pa.scalar(0, data.type) if name != "aeb" else False)
            self._values[name] = data.to_numpy(zero_copy_only=False)
        return self._values[name]

    def name(self, column: str, row: int) -> str:
        """A value of a column of names; empty where missing."""
        return self._table.column(column)[row].as_py() or ""

    def valid(self, name: str) -> np.ndarray:
        """Validity of a nullable column [rows]."""
        valid: np.ndarray = self._table.column(name).combine_chunks().is_valid().to_numpy(False)
        return valid


def examine(claim: Claim) -> Judgement:
    """Whether a claim follows from the files of its attempt; bad files are differences, too."""
    try:
        differences, known = _compare(claim)
    except Exception as error:  # files that others can write may hold anything
        words = str(error) if isinstance(error, InfrastructureError) else repr(error)
        differences, known = [escape(" ".join(words.split()), 300)], True
    agreement = "differs" if differences else "agrees" if known else "no record"
    return Judgement(
        folder=claim.folder,
        case=claim.case,
        found=agreement,
        differences=differences[:DIFFERENCES_MAX],
    )


def _compare(claim: Claim) -> tuple[list[str], bool]:
    """Differences, and whether there is a record to judge by."""
    folder = _attempt_folder(claim)
    table = read_kpi(_plain_file(folder / "kpi.parquet"))
    log = _read(folder / "log.txt", LOG_BYTES_MAX)
    sealed = folder / RECORD_FILE
    data = _read(sealed, RECORD_BYTES_MAX) if sealed.exists() or sealed.is_symlink() else b""
    rows_sha256 = kpi_sha256(table)
    if rows_sha256 != claim.kpi_sha256:
        return [f"KPI rows give {rows_sha256[:12]}, committed {claim.kpi_sha256[:12]}"], True
    digest = attempt_digest(rows_sha256, log, data)
    if digest != claim.manifest_sha256:
        return [f"log.txt or {RECORD_FILE} is not what was committed"], True
    if not data:
        return [], False
    record = msgspec.json.decode(data, type=JudgeRecord)
    return _judged(claim, record, TableRows(table)), True


def _judged(claim: Claim, record: JudgeRecord, rows: TableRows) -> list[str]:
    if record.v != SCHEMA_VERSION:
        return [f"{RECORD_FILE} is of version {record.v}, this program knows {SCHEMA_VERSION}"]
    differences = []
    if record.case != claim.case:
        differences.append(f"{RECORD_FILE} is that of case {record.case}")
    if claim.scenario is not None and _limits(record.scenario) != _limits(claim.scenario):
        differences.append(f"the scenario in {RECORD_FILE} is not that of the campaign")
    collisions = int(rows.column("collisions")[-1])
    if record.collisions != collisions:
        differences.append(
            f"{RECORD_FILE} counts {record.collisions} collisions, the rows {collisions}"
        )
    state, hit = state_of(record), hit_of(record)
    run = replay(record.scenario, surroundings_of(record), rows)
    kind = kind_of(record.scenario)
    differences += _of_columns(kind.columns, rows)
    # What is computed and not claimed, the version that ran the case did not have.
    known = [scalar for scalar in kind.scalars if scalar.name in claim.scalars]
    scalars = judging.scalars(rows, state, run, hit, known)
    scalars |= formula_scalars(record.formula or "", rows)
    differences += _of_values("scalar", claim.scalars, scalars)
    if claim.outcome != "verdict":
        return differences
    differences += _of_values("name", claim.names, judging.names(rows, state, hit))
    mine = judging.judge(rows, state, run, hit)
    if mine.verdict != claim.verdict:
        reason = mine.reasons[0] if mine.reasons else ""
        differences.insert(
            0, f"the rows come to '{mine.verdict}' ({reason}), committed '{claim.verdict}'"
        )
    elif not _alike(claim.reasons[: len(mine.reasons)], mine.reasons):
        differences.append(f"the reason is '{mine.reasons[0]}', committed {claim.reasons[:1]}")
    return [escape(line, 300) for line in differences]


def _of_columns(kinds: Sequence[KpiKind], rows: TableRows) -> list[str]:
    """Columns that do not follow from the others, as they were computed."""
    mistakes = []
    for kind in kinds:
        if kind.implementation:
            recorded = np.where(rows.valid(kind.name), rows.column(kind.name), np.nan)
            mine = computed_column(kind, rows)
            if not np.allclose(recorded, mine, rtol=1e-9, atol=1e-12, equal_nan=True):
                mistakes.append(f"column {kind.name} does not follow from the others")
    return mistakes


def _of_values(what: str, committed: dict[str, Any], computed: dict[str, Any]) -> list[str]:
    return [
        f"{what} {name} is {computed.get(name)!r}, committed {committed.get(name)!r}"
        for name in sorted({*committed, *computed})
        if not _same(committed.get(name), computed.get(name))
    ]


def _same(one: Any, other: Any) -> bool:
    """Equal, but for last bits of a number, which sums and sines need not have in common on two
    processors."""
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12) or one != one != other
    return bool(one == other)


def _alike(one: Sequence[str], other: Sequence[str]) -> bool:
    """Whether sentences are the same; a number in them may be rounded the other way."""
    if len(one) != len(other):
        return False
    for first, second in zip(one, other, strict=True):
        if _NUMBER.split(first) != _NUMBER.split(second):
            return False
        pairs = zip(_NUMBER.findall(first), _NUMBER.findall(second), strict=True)
        if not all(math.isclose(float(a), float(b), abs_tol=1.1 * _step(a)) for a, b in pairs):
            return False
    return True


def _step(number: str) -> float:
    """A one in the last place of a number as it is printed."""
    return 10.0 ** -len(number.partition(".")[2])


def _limits(scenario: Scenario) -> Scenario:
    """A scenario without the places of its files: a campaign may have moved."""
    files = dict.fromkeys(kind_of(scenario).files, "-")
    return msgspec.structs.replace(scenario, scene="", vehicle="", **files)


def _attempt_folder(claim: Claim) -> Path:
    """Below the campaign folder, and no link on the way."""
    root = Path(claim.folder)
    parts = Path(claim.attempt_dir).parts
    if not parts or Path(claim.attempt_dir).is_absolute() or ".." in parts:
        raise InfrastructureError(f"attempt folder '{claim.attempt_dir}' is outside {root}")
    folder = root
    for part in parts:
        folder = folder / part
        if folder.is_symlink():
            raise InfrastructureError(f"{folder} is a symbolic link")
    return folder


def _plain_file(path: Path) -> Path:
    if path.is_symlink() or not path.is_file():
        raise InfrastructureError(f"{path} is missing, or no plain file")
    return path


def _read(path: Path, most: int) -> bytes:
    try:
        return read_regular(_plain_file(path), most)
    except OSError as error:
        raise InfrastructureError(f"{path}: {error.strerror or error}") from None
