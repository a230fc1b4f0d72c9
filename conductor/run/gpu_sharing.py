"""Processes that compute on one GPU side by side instead of in turns.

Simulators and stacks are processes of their own. Without help a GPU gives each of them slices of
time, and while one draws pictures the others stand still, however little they need. NVIDIA's
Multi-Process Service (MPS) lets their kernels run at the same time. It comes with the driver and
needs no rights: a run starts one of its own and ends it, and touches nobody else's.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from twin.base.gpu.first_use import PIPES_VARIABLE
from twin.base.process import end, spawn

PROGRAM = "nvidia-cuda-mps-control"

LOGS_VARIABLE = "CUDA_MPS_LOG_DIRECTORY"
"""Environment variable of CUDA: where its service writes what it does."""

SWITCH_VARIABLE = "TWIN_MPS"
"""Environment variable: ``off`` for processes that take turns, to compare."""

QUIT_S = 10
"""How long the service may take to start, and processes to leave it at its end [s]."""

# The service outlives whoever started it. This shell ends it when its standard input, the lifeline,
# is cut: at the end of a run, and when `conductor run` is killed.
_SCRIPT = f"""
unset CUDA_VISIBLE_DEVICES
timeout {QUIT_S} {PROGRAM} -d > "$0/start" 2>&1 || exit 1
echo started
echo "start_server -uid $(id -u)" | {PROGRAM} > "$0/server" 2>&1 &
cat > "$0/lifeline"
echo "quit -t {QUIT_S}" | timeout {QUIT_S + 5} {PROGRAM} > "$0/quit" 2>&1
rm -rf "$0"
"""
# The server of this user would else be started when the first process begins to compute.
# With CUDA_VISIBLE_DEVICES the service would count devices anew, and its clients once more.


@contextlib.contextmanager
def side_by_side(device: str) -> Iterator[Callable[[], None]]:
    """Processes started meanwhile share their GPU, where MPS is; else they take turns, and if it is
    there but does not start, a line says so. A service that the user started is used as it is.

    ``device``: on a CPU nothing happens. Yields what may be called when nobody computes any more:
    the service takes its time to end, in which others can work.
    """
    wanted = device.startswith("cuda") and os.environ.get(SWITCH_VARIABLE, "") != "off"
    if not wanted or PIPES_VARIABLE in os.environ or shutil.which(PROGRAM) is None:
        yield lambda: None
        return
    folder = tempfile.mkdtemp(prefix="drivetwin-mps-")  # short: sockets are in it
    variables = {PIPES_VARIABLE: folder, LOGS_VARIABLE: folder}
    shell = spawn(["/bin/sh", "-c", _SCRIPT, folder], environment=variables, pipe_output=True)
    lifeline = shell.stdin
    assert lifeline is not None
    assert shell.stdout is not None
    try:
        if shell.stdout.readline().strip() == b"started":
            os.environ.update(variables)
        else:
            print(f"processes on a GPU take turns: {_reason(folder)}", file=sys.stderr)
        yield lambda: _let_go(lifeline)
    finally:
        _let_go(lifeline)
        with contextlib.suppress(subprocess.TimeoutExpired):
            shell.wait(2 * QUIT_S)
        end(shell)
        shutil.rmtree(folder, ignore_errors=True)


def _let_go(lifeline: IO[bytes]) -> None:
    """Have the service end; nobody is to look for it from here on."""
    for name in (PIPES_VARIABLE, LOGS_VARIABLE):
        os.environ.pop(name, None)
    lifeline.close()


def _reason(folder: str) -> str:
    """What the service said last."""
    with contextlib.suppress(OSError):
        log_lines = (Path(folder) / "start").read_text(errors="replace").split("\n")
        if lines := [line.strip() for line in log_lines if line.strip()]:
            return f"{PROGRAM}: {lines[-1][:200]}"
    return f"{PROGRAM} does not start"
