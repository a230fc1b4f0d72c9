"""``log.txt`` of an attempt: what happened, and what its stack printed meanwhile.

A simulator writes it with the KPIs of a case that has ended (:mod:`twin.rig.attempt`); a worker
writes it alone, for an attempt whose rig ended first.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from msgspec import structs

from schemas.digest import digest
from schemas.identity import stack_name
from schemas.wire.control import Lease, Result
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.rig.stack_output import ELSEWHERE, Kept


def write_failure(lease: Lease, reason: str, output: Kept | None) -> Result:
    """The result of a case whose stack failed before the case began: it has a log and no KPIs.

    Raises:
        TwinError: the folder cannot be written (disk full, no permission).
    """
    log = write_log(lease, f"failed: {reason}", output)
    log_sha = hashlib.sha256(log).hexdigest()
    return structs.replace(
        failure(lease, reason),
        attempt_dir=lease.attempt_dir,
        manifest_sha256=digest([b"log.txt", log_sha.encode()]),
    )


def failure(lease: Lease, reason: str) -> Result:
    """Result of a failed attempt without a log."""
    return Result(
        campaign=lease.case.variation.campaign,
        case=lease.case.id,
        token=lease.token,
        outcome="failed",
        verdict="",
        reasons=[reason],
    )


def write_log(lease: Lease, end: str, output: Kept | None) -> bytes:
    """Write the log of an attempt without KPIs; its bytes.

    Args:
        lease: of the attempt.
        end: how it ended, in a line.
        output: what the stack printed; None: it is on another host.

    Raises:
        TwinError: the folder cannot be written (disk full, no permission).
    """
    path = Path(lease.out) / lease.attempt_dir / "log.txt"
    log = joined([*head(lease), end], output).encode()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, log)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return log


def head(lease: Lease) -> list[str]:
    """The first lines: which case it is."""
    case = lease.case
    variation = case.variation
    kind = type(variation.perception).__struct_config__.tag
    tell = f", told {', '.join(variation.tell)}" if variation.tell else ""
    hour, minute = divmod(variation.time_of_day_min, 60)
    return [
        f"case {case.id} of campaign {variation.campaign}, seed {variation.seed}",
        f"perception {variation.model} ({kind}), weather {variation.weather}, "
        f"{hour:02d}:{minute:02d}",
        f"the stack knows it as {stack_name(case)}{tell}",
    ]


def joined(lines: list[str], output: Kept | None) -> str:
    """The text of a log: what happened, then what the stack printed."""
    return "\n".join(lines) + "\n" + (f"{ELSEWHERE}\n" if output is None else output.text())
