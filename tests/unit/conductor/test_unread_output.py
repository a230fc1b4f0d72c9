"""Whoever reads the output of a command may leave (``| head``): that is no verdict."""

import os
import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "command", ["twin --help", "twin --version", "conductor campaigns", "conductor explain"]
)
def test_unread_output_is_no_verdict(command):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as nobody:
        done = subprocess.run(
            [sys.executable, "-m", *command.split()], stdout=nobody, stderr=subprocess.PIPE
        )
    expected = 2 if command == "conductor explain" else 128 + signal.SIGPIPE
    assert done.returncode == expected
    assert (b"Usage" in done.stderr) == (expected == 2)
    assert b"Traceback" not in done.stderr
