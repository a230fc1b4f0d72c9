"""The trial whether a sandbox works here, in a process that is ended meanwhile."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import signal
from types import SimpleNamespace
from twin.sandbox.possible import _tried

def ended(*_):
    raise {error}

signal.signal(signal.SIGTERM, ended)
command = "trap '' TERM; kill -TERM $PPID; sleep 0.2; echo ends > $0"
trial = SimpleNamespace(words=["sh", "-c", command, {path!r}], environment={{}}, descriptors=())
try:
    _tried(trial)
except BaseException as error:
    print(type(error).__name__)
"""


@pytest.mark.parametrize("error", ["SystemExit", "RuntimeError"])
def test_a_signal_waits_for_the_trial(tmp_path, error):
    """Half of a bubblewrap that is killed in its first milliseconds would stay behind."""
    path = tmp_path / "ends"
    code = CODE.format(error=error, path=str(path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{error}\n", "")
    assert path.read_text() == "ends\n"
