"""Code of a stranger in a parser's process: what it tries, and how it gets there."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

from attacks import Found, refused_if
from theatre import Theatre

READS_S = 60.0
"""A file is read, or refused, within this time [s]."""

ATTEMPTS = """
import os, socket
from pathlib import Path
import numpy as np

def reached(path, beside=""):
    secret, port, pid = path.read_text().split()
    done = []
    def attempt(name, action):
        try:
            action()
            done.append(name)
        except (OSError, MemoryError):
            pass
    attempt("read a key", lambda: Path(secret).read_text())
    if beside:
        attempt("read what lies beside it", lambda: (path.parent / beside).read_text())
    attempt("read /etc/shadow", lambda: Path("/etc/shadow").read_text())
    attempt("changed its file", lambda: path.write_text("x"))
    attempt("wrote a file", lambda: Path(secret + ".new").write_text("x"))
    attempt("connected", lambda: socket.create_connection(("127.0.0.1", int(port)), 5))
    attempt("signalled a process", lambda: os.kill(int(pid), 0))
    attempt("took 50 GB", lambda: np.ones(50 << 27))
    return ", ".join(done) or "nothing"
"""
"""Begins the module that takes over; ``reached`` says what came off."""

_ROOT = Path(__file__).resolve().parents[2]


def read_by(
    theatre: Theatre, reader: str, parser: str, name: str
) -> subprocess.CompletedProcess[str]:
    """A reader whose parser is a stranger's.

    Args:
        theatre: where it happens.
        reader: Python; gets the paths of the file and of the module that takes over.
        parser: Python behind :data:`ATTEMPTS`; the module is called ``taken_over``.
        name: of the file that is read.
    """
    module = theatre.write("taken_over.py", ATTEMPTS + parser)
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        file = theatre.write(name, f"{theatre.secret} {port} {os.getpid()}")
        return subprocess.run(
            [sys.executable, "-c", reader, str(file), str(module)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (theatre.folder, _ROOT)))},
            capture_output=True,
            text=True,
            timeout=READS_S,
            check=False,
        )


def theft(theatre: Theatre, reader: str, parser: str, name: str, by: str) -> Found:
    """What a stranger's parser came to, which says what it reached and why there was no sandbox.

    Args:
        theatre: where it happens.
        reader: see :func:`read_by`; prints both as JSON.
        parser: see :func:`read_by`.
        name: of the file that is read.
        by: what holds it, where it reached nothing.
    """
    done = read_by(theatre, reader, parser, name)
    if done.returncode:
        return Found("open", f"the reader broke: {done.stderr.strip().splitlines()[-1:]}")
    reached, unprotected = json.loads(done.stdout)
    if unprotected:
        return Found("not run", "no bubblewrap")
    return refused_if(reached == "nothing", by, f"it {reached}")
