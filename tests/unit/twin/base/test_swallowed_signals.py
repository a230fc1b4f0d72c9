"""twin.base.command: a signal that hits code which swallows what it raises is heeded later."""

import subprocess
import sys

import pytest

CODE = """
import os, signal
from twin.base.command import heed_signals, run

def app():
    heed_signals()
    try:
        os.kill(os.getpid(), signal.{name})
        while True:
            pass
    except BaseException:
        pass
    print("went on", flush=True)
    heed_signals()
    print("ignored it", flush=True)

run(app, "twin")
"""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 75)])
def test_what_was_swallowed_is_raised_again(name, code):
    command = [sys.executable, "-c", CODE.format(name=name)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, "went on\n")
    assert done.stderr.count("\n") == 1
