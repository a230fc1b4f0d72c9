"""The wait of a worker that was started before the conductor listens."""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from typing import IO

from schemas.files.json_text import JsonError, decode_json
from twin.base.errors import UsageError
from twin.base.worker_start import WorkerStart
from twin.fabric.endpoint import allow_plain, is_tls
from twin.fabric.rig_folder import RigFolder
from twin.rig.sim_process import start_simulator
from twin.worker.rig_child import RigChild
from twin.worker.stack_process import load_stack


@dataclass(frozen=True, slots=True)
class Loading:
    """Processes that load for the first rig."""

    simulator: RigChild
    stack: RigChild
    folder: RigFolder
    """Folder in which the two will meet."""
    stack_log: IO[bytes]
    """Log that the stack writes and the simulator reads, also if another stack takes its place."""

    def discard(self) -> None:
        """End them; they have not been told anything."""
        self.simulator.discard()
        self.stack.discard()
        self.folder.close()
        self.stack_log.close()


def begin_loading(device: str) -> Loading:
    """Have the processes of a rig that computes on ``device`` load."""
    folder, log = RigFolder(), tempfile.TemporaryFile()  # noqa: SIM115
    stack = load_stack(device, folder.path, log)
    return Loading(start_simulator(device, log), stack, folder, log)


def await_start(loading: Loading | None) -> WorkerStart:
    """Wait to be told whom to serve; from then on standard output and error go to the log.

    Raises:
        SystemExit: there is nobody to serve; ``loading`` is ended.
        UsageError: standard input says something else.
    """
    line = sys.stdin.buffer.readline()
    if not line:
        if loading is not None:
            loading.discard()
        sys.exit(0)
    try:
        start: WorkerStart = decode_json(line, WorkerStart)
    except JsonError as error:
        raise UsageError(f"--connect -: standard input: {error}") from None
    if not is_tls(start.connect):  # as somebody typed it there
        allow_plain()
    if start.log:
        log = os.open(start.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
    return start
