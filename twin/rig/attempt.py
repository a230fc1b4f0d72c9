"""The attempt folder: ``cases/<case>/attempt-<n>/{kpi.parquet,log.txt}``."""

from __future__ import annotations

from pathlib import Path

import msgspec

from schemas.files.judging import RECORD_FILE, attempt_digest
from schemas.wire.control import Lease, Result
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.kpi.rows_file import rows_sha256, write_rows
from twin.rig.attempt_log import head, joined
from twin.rig.pacing import CSV_FILE, Paced
from twin.rig.slot import Finished
from twin.rig.stack_output import Kept


def write_attempt(
    lease: Lease, finished: Finished, wall_s: float, output: Kept | None = None
) -> Result:
    """Write KPIs, the judge's record and log of a finished case; the result is ready to be
    committed.

    Args:
        lease: of the attempt.
        finished: how its case ended.
        wall_s: what it took [s].
        output: what the stack printed; None: it is on another host.

    Raises:
        TwinError: the folder cannot be written (disk full, no permission).
    """
    relative = lease.attempt_dir
    folder = Path(lease.out) / relative
    log = _log_text(lease, finished, output).encode()
    record = b""
    if finished.record is not None:
        record = msgspec.json.encode(finished.record) + b"\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_rows(finished.table, folder / "kpi.parquet")
        if record:
            write_atomic(folder / RECORD_FILE, record)
        write_atomic(folder / "log.txt", log)
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    sha = rows_sha256(finished.table)
    return Result(
        campaign=lease.case.variation.campaign,
        case=lease.case.id,
        token=lease.token,
        outcome=finished.outcome,
        verdict=finished.verdict,
        scalars=finished.scalars,
        reasons=finished.reasons,
        names=finished.names,
        attempt_dir=relative,
        kpi_sha256=sha,
        manifest_sha256=attempt_digest(sha, log, record),
        wall_s=wall_s,
    )


def write_pace(lease: Lease, paced: Paced) -> None:
    """Write what happened at each tick of an attempt that ran by the wall clock.

    Raises:
        TwinError: the folder cannot be written (disk full, no permission).
    """
    path = Path(lease.out) / lease.attempt_dir / CSV_FILE
    try:
        write_atomic(path, paced.table.encode())
    except OSError as error:
        raise storage_error(error, str(path)) from None


def _log_text(lease: Lease, finished: Finished, output: Kept | None) -> str:
    """Log of an attempt: events in sim time only, then the stack's output, which may not repeat."""
    lines = head(lease)
    for name, value in finished.scalars.items():
        lines.append(f"{name}: {'-' if value is None else value}")
    lines += [f"{name}: {value}" for name, value in finished.names.items()]
    lines += finished.reasons
    lines.append(f"{finished.outcome}: {finished.verdict}")
    return joined(lines, output)
