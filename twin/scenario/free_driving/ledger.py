"""The list of all parts of free driving that were made: every part that ran counts."""

from __future__ import annotations

import json
from pathlib import Path

from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.scenario.free_driving.chance import part_seed
from twin.scenario.free_driving.part import part_files

LEDGER_FILE = "parts.jsonl"
"""A line per part, in the order in which they were made."""


def make_part(folder: Path, commit: str, part: int) -> Path:
    """Write a part into ``folder`` and into its list; the folder of the part.

    A part that is there already stays as it is.

    Raises:
        UsageError: its folder holds something else, as the part of another commit.
        InfrastructureError: the disk lets us down.
    """
    target = folder / f"part-{part:02}"
    files = part_files(commit, part)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            path = target / name
            if path.exists() and path.read_bytes() != data:
                raise UsageError(
                    f"{path}: of another commit, or changed; a part that ran counts, so give "
                    "another --out for a new series"
                )
        _enter(folder, commit, part)
        for name, data in files.items():
            if not (target / name).exists():
                write_atomic(target / name, data, sync=False)
    except OSError as error:
        raise storage_error(error, str(target)) from None
    return target


def _enter(folder: Path, commit: str, part: int) -> None:
    """Add a part to the list before it runs."""
    path = folder / LEDGER_FILE
    lines = path.read_text().splitlines() if path.exists() else []
    line = json.dumps({"part": part, "commit": commit, "seed": part_seed(commit, part)})
    if line not in lines:
        write_atomic(path, "".join(f"{row}\n" for row in [*lines, line]).encode())
