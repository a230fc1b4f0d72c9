"""What commands that write a file have in common."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from twin.base.errors import UsageError


def check_out(out: Path, *suffixes: str) -> None:
    """Raise UsageError unless ``out`` can become a file of such a name; makes its folder."""
    if out.suffix.lower() not in suffixes:
        raise UsageError(f"{out}: expected a file name that ends in {' or '.join(suffixes)}")
    try:
        out.absolute().parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from None


def write_whole(out: Path, data: bytes) -> None:
    """Write a file.

    Raises:
        UsageError: it cannot be written.
    """
    try:
        out.write_bytes(data)
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from None


def needed(module: str, option: str, extra: str = "export") -> Any:
    """A module of the optional group ``extra``.

    Raises:
        UsageError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UsageError(
            f"{option} needs the package {module.partition('.')[0]}; "
            f"install it with: pip install 'drivetwin[{extra}]'"
        ) from None
