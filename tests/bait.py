"""What a cheating stack looks for, set up so that it could be found."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

WORD = "a-secret-of-the-cloud"
"""Stands in the environment of whoever runs the campaign."""


@contextlib.contextmanager
def baited(name: str, mode: dict[str, Any], **targets: object) -> Iterator[dict[str, Any]]:
    """A campaign's ``autonomy`` with the stack that cheats, told about its ``targets``.

    While the context is open a port, an abstract socket and shared memory are there for it.
    """
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.socket(socket.AF_UNIX) as abstract,
        tempfile.NamedTemporaryFile(dir="/dev/shm") as shared,
    ):
        unique = f"{name}-{os.getpid()}"
        abstract.bind(f"\0{unique}")
        abstract.listen()
        places = {
            "shared": Path(shared.name).name,
            "port": server.getsockname()[1],
            "abstract": unique,
            "word": WORD,
        }
        yield {
            "stack": "cheating_stack:CheatingStack",
            "parameters": {"targets": json.dumps({**targets, **places})},
            **mode,
        }
