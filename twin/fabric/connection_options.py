"""The options of every command that connects to a conductor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import is_command
from twin.fabric.endpoint import allow_plain, demand_keys

KeyOption = Annotated[
    Path | None,
    typer.Option(
        "--key",
        envvar="TWIN_KEY",
        help="Key file (mode 0600) or folder of keys, for tls/ endpoints; "
        "default: your own of that conductor, which --state or --run finds.",
    ),
]
"""The option of every command that connects."""


def _allow_plain(value: bool) -> bool:
    if value:
        allow_plain()
    elif is_command():
        demand_keys()
    return value


InsecureOption = Annotated[
    bool,
    typer.Option(
        "--insecure",
        callback=_allow_plain,
        help="Plain TCP without keys: whoever reaches the port, on loopback every user of this "
        "host, may read and command, and so run code as you.",
    ),
]
"""Beside :data:`KeyOption`; works by itself, for the whole process."""
