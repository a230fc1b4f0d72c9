"""A conductor ends without a word."""

from __future__ import annotations

import subprocess
import sys

SERVE_AND_STOP = """
import sys, threading
from pathlib import Path
from conductor.serve.shell import Conductor

for index in range(12):
    conductor = Conductor(Path(sys.argv[1]) / str(index), listen="tls/127.0.0.1:0")
    thread = threading.Thread(target=conductor.serve)
    thread.start()
    assert conductor.started.wait(300)
    conductor.stop()
    thread.join()
"""


def test_conductors_end_in_silence(tmp_path, monkeypatch):
    """Six at once: it took a busy machine for Zenoh to panic as its routers parted."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    children = [
        subprocess.Popen(
            [sys.executable, "-c", SERVE_AND_STOP, str(tmp_path / str(index))],
            stderr=subprocess.PIPE,
            text=True,
        )
        for index in range(6)
    ]
    written = [child.communicate(timeout=600)[1] for child in children]
    assert written == [""] * 6
    assert [child.returncode for child in children] == [0] * 6
