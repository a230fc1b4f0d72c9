"""A stand-in for ``ssh`` that forwards for real, first on the path of what a test starts."""

import json
import os
import sys
from pathlib import Path

FAKE = Path(__file__).parent / "unit" / "viewer" / "live" / "fake_ssh.py"


def put_first(folder, monkeypatch):
    """Install it into a folder of its own; what it was called with so far, by a function."""
    (folder / "bin").mkdir()
    script = folder / "bin" / "ssh"
    script.write_text(f'#!/bin/sh\nexec {sys.executable} {FAKE} "$@"\n')
    script.chmod(0o755)
    log = folder / "ssh.log"
    log.touch()
    monkeypatch.setenv("PATH", f"{folder / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("FAKE_SSH_LOG", str(log))
    return lambda: [json.loads(line) for line in log.read_text().splitlines()]
