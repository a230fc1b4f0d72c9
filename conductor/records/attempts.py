"""Attempt folders of a campaign: below it, and never somewhere else by ``..`` or a link."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from twin.base.errors import InfrastructureError

LOG_FILE = "log.txt"
"""What happened in an attempt, and what its stack printed."""


def attempt_folder(folder: Path, attempt_dir: str) -> Path:
    """The folder ``attempt_dir`` of the campaign in ``folder``.

    Raises:
        InfrastructureError: it lies outside, by its name or through a symbolic link.
    """
    relative = PurePosixPath(attempt_dir)
    if "\0" in attempt_dir or relative.is_absolute() or ".." in relative.parts:
        raise InfrastructureError(f"attempt folder '{attempt_dir}' is outside {folder}")
    path = folder / relative
    if leads_away(folder, path):
        raise InfrastructureError(
            f"attempt folder '{attempt_dir}' leads out of {folder} through a symbolic link; "
            "remove the link"
        )
    return path


def attempt_file(folder: Path, attempt_dir: str, name: str) -> Path:
    """The file ``name`` in such a folder, whether it is there or not.

    Raises:
        InfrastructureError: it lies outside, by the folder's name or through a symbolic link.
    """
    path = attempt_folder(folder, attempt_dir) / name
    if path.is_symlink():
        raise InfrastructureError(f"{path} is a symbolic link; put the file there")
    return path


def leads_away(folder: Path, path: Path) -> bool:
    """Whether something below ``folder`` on the way to ``path``, or ``path`` itself, is a link that
    leads elsewhere; what does not exist yet leads nowhere."""
    root = Path(os.path.realpath(folder))
    return Path(os.path.realpath(path)) != root / path.relative_to(folder)
