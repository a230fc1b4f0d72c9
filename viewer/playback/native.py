"""The native Rerun viewer: where its binary is, whether it can show or render anything here."""

from __future__ import annotations

import getpass
import importlib.util
import os
import shlex
import socket
import sys
from pathlib import Path

from twin.base.errors import InfrastructureError


def binary() -> Path:
    """The viewer's own binary; the ``rerun`` script is a wrapper that outlives its child's end.

    Raises:
        InfrastructureError: it is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    folders = list(spec.submodule_search_locations or []) if spec else []
    for folder in folders:
        path = Path(folder) / ("rerun.exe" if sys.platform == "win32" else "rerun")
        if path.is_file():
            return path
    raise InfrastructureError("the rerun viewer is not installed; install rerun-sdk again")


def has_display() -> bool:
    """A window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port() -> int:
    """A port of the loopback interface that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def here() -> str:
    """``user@host`` of this machine, as a laptop's ssh would say it."""
    return f"{getpass.getuser()}@{socket.gethostname()}"


def tunnel_commands(port: int, laptop_port: int = 9876) -> list[str]:
    """Commands for a laptop behind ssh that show what is served on loopback ``port`` here."""
    return [
        f"ssh -N -L {laptop_port}:127.0.0.1:{port} {here()}",
        f"rerun --connect rerun+http://127.0.0.1:{laptop_port}/proxy",
    ]


def fetch_commands(path: Path) -> list[str]:
    """Commands for a laptop that show a file of this machine."""
    return [
        f"scp {here()}:{shlex.quote(str(path.absolute()))} .",
        f"rerun {shlex.quote(path.name)}",
    ]
