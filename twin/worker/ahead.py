"""The wait of a worker that was started before the conductor listens."""

from __future__ import annotations

import os
import sys

from schemas.json_text import JsonError, decode_json
from twin.fabric.ahead import Told
from twin.fabric.endpoint import allow_plain, is_exposed
from twin.fabric.errors import UsageError
from twin.worker.sim_process import SimulatorProcess, start_simulator


def await_told(*, simulator: bool) -> tuple[Told, SimulatorProcess | None]:
    """Wait to be told whom to serve; from then on standard output and error go to the log.

    Args:
        simulator: have one load meanwhile.

    Raises:
        SystemExit: there is nobody to serve.
        UsageError: standard input says something else.
    """
    loading = start_simulator() if simulator else None
    line = sys.stdin.buffer.readline()
    if not line:
        if loading is not None:
            loading.discard()
        sys.exit(0)
    try:
        told: Told = decode_json(line, Told)
    except JsonError as error:
        raise UsageError(f"--connect -: standard input: {error}") from None
    if is_exposed(told.connect):
        allow_plain()
    if told.log:
        log = os.open(told.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
    return told, loading
