"""A stack in a process of its own: started, watched, and ended with all that it started.

A foreign stack knows nothing of lifelines. So a process of ours stands above it: it adopts what
the stack leaves behind (PR_SET_CHILD_SUBREAPER), and when its lifeline is cut or the stack ends, it
ends every descendant. A stack that forks without end is stopped at ``PROCESSES_MAX``.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import secrets
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import psutil

from schemas import DRIVE_MINOR, SCHEMA_VERSION
from twin.base.errors import InfrastructureError, StackFaultError
from twin.base.process import PARENT_VARIABLE, how_it_ended, left_by_itself

PROCESSES_MAX = 256
"""Most processes that a foreign stack may run at once."""

LOOK_S = 0.2
"""Time between two counts of processes [s]."""

ROUNDS_MAX = 100
"""Most rounds of ending descendants; new ones may appear meanwhile."""

MARK_VARIABLE = "TWIN_SCRIPT"
"""Variable in the environment of a script and all that it starts: tells them from what else we
started."""

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


def drive_variables(
    *,
    connect: str,
    namespace: str,
    rig: str,
    slots: int,
    parameters: Mapping[str, Any],
    key: str = "",
) -> dict[str, str]:
    """What a foreign stack finds in its environment; documented in docs/drive-plane.md."""
    return {
        "TWIN_DRIVE_CONNECT": connect,
        "TWIN_DRIVE_NAMESPACE": namespace,
        "TWIN_DRIVE_RIG": rig,
        "TWIN_DRIVE_SLOTS": str(slots),
        "TWIN_DRIVE_VERSION": f"{SCHEMA_VERSION}.{DRIVE_MINOR}",
        "TWIN_DRIVE_KEY": key,
        "TWIN_STACK_PARAMETERS": json.dumps(dict(parameters)),
    }


class ForeignProcess:
    """A command of somebody else, and everything it starts."""

    def __init__(
        self, command: Sequence[str], variables: Mapping[str, str], folder: str | None = None
    ) -> None:
        """Say what it is.

        Args:
            command: words of the command line.
            variables: added to this process's environment.
            folder: working folder; None: ours.
        """
        self._folder = folder
        self._command = list(command)
        self._mark = secrets.token_hex(8)
        self._variables = {**variables, MARK_VARIABLE: self._mark}
        self._child: subprocess.Popen[bytes] | None = None
        self.name = os.path.basename(command[0])  # noqa: PTH119 - a word, not a file of ours

    def tell(self, variables: Mapping[str, str]) -> None:
        """Add variables to the environment in which it is started next."""
        self._variables |= variables

    def start(self) -> None:
        """Start it, in a session of its own.

        Raises:
            InfrastructureError: there is no such command, or it may not be run.
        """
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        # Python would keep back what it prints to a file, and lose it if it is killed.
        environment = {"PYTHONUNBUFFERED": "1", **os.environ, **self._variables}
        environment.pop(PARENT_VARIABLE, None)

        def bind() -> None:
            # What we ignore it would ignore as well, with all that it starts.
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

        try:
            self._child = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                # What it prints goes where our own messages go: into the rig's log.
                stdout=sys.stderr.fileno(),
                stderr=sys.stderr.fileno(),
                env=environment,
                cwd=self._folder,
                start_new_session=True,
                preexec_fn=bind,  # system calls only: a thread of ours may hold any lock
            )
        except OSError as error:
            raise InfrastructureError(
                f"stack command {self._command[0]!r}: {error.strerror or error}; give a command "
                "that the worker finds on its PATH, or an absolute path"
            ) from None
        _OWN.add(self._child.pid)

    def check(self) -> None:
        """Do nothing while it runs as it should.

        Raises:
            StackFaultError: it has ended by itself.
            InfrastructureError: something ended it, or it runs too many processes.
        """
        code = self._child.poll()
        if code is not None:
            kind = StackFaultError if left_by_itself(code) else InfrastructureError
            raise kind(f"command {self.name!r} ended: {how_it_ended(code)}")
        if len(_descendants()) > PROCESSES_MAX:
            raise InfrastructureError(
                f"command {self.name!r} runs more than {PROCESSES_MAX} processes"
            )

    def wait(self) -> int:
        """Wait for its end; the exit code.

        Raises:
            InfrastructureError: it runs too many processes.
        """
        while True:
            try:
                return self._child.wait(LOOK_S)
            except subprocess.TimeoutExpired:
                self.check()

    def end(self) -> None:
        """End it and what it started, also in sessions of its own."""
        if self._child is None:
            return
        _end(self._family)
        self._child.wait()

    def _family(self) -> list[psutil.Process]:
        leader = self._child.pid
        descendants = _descendants()
        return [
            p
            for p in descendants
            if p.pid == leader or _session(p) == leader or _mark(p) == self._mark
        ]

    def restart(self) -> None:
        """End it and start it again, as if for the first time."""
        self.end()
        self.start()


class Ending:
    """The end of everything that this process started, and of what remains of it: once."""

    def __init__(self, after: Callable[[], None]) -> None:
        """``after``: runs when every process has ended."""
        self._after = after
        self._lock = threading.Lock()
        self._done = False

    def __call__(self) -> None:
        """Whoever comes second waits for the first: it would end what that one runs."""
        with self._lock:
            if not self._done:
                end_descendants()
                self._after()
                self._done = True


def run_command(script: ForeignProcess, ending: Ending) -> int:
    """Run a foreign stack to its end; its exit code."""
    script.start()
    try:
        code = script.wait()
    finally:
        ending()
    if code < 0:  # as if it had been our own end, so that the worker tells the signal
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError, ValueError):
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code if code >= 0 else 128 - code


def watch_lifeline(*, supervised: bool, ending: Ending) -> None:
    """End everything when the worker is gone, or when asked to if there is none."""

    def leave() -> None:
        try:
            ending()
        finally:
            os._exit(0)

    if not supervised:
        signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=leave).start())
        return
    # The scheduler may signal everybody at once; the worker decides.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait() -> None:
        while os.read(0, 65536):
            pass
        leave()

    threading.Thread(target=wait, name="lifeline", daemon=True).start()


def end_descendants() -> None:
    """Kill every process below this one."""
    _end(_descendants)


def _end(look: Callable[[], list[psutil.Process]]) -> None:
    """Kill what is found until nothing is: first stop them, so that none starts another."""
    for _ in range(ROUNDS_MAX):
        processes = look()
        if not processes:
            return
        for process in processes:
            _signal(process, signal.SIGSTOP)
        for process in processes:
            _signal(process, signal.SIGKILL)
        psutil.wait_procs(processes, timeout=1.0)


def _descendants() -> list[psutil.Process]:
    alive = []
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if process.status() != psutil.STATUS_ZOMBIE:
                alive.append(process)
            else:
                _reap(process.pid)
    return alive


def _session(process: psutil.Process) -> int:
    with contextlib.suppress(ProcessLookupError):
        return os.getsid(process.pid)
    return 0


def _mark(process: psutil.Process) -> str:
    with contextlib.suppress(psutil.Error):
        return str(process.environ().get(MARK_VARIABLE, ""))
    return ""


def _reap(pid: int) -> None:
    """An orphan that we adopted; those of ``subprocess`` are waited for there."""
    with contextlib.suppress(ChildProcessError, psutil.Error):
        if psutil.Process(pid).ppid() == os.getpid() and pid not in _OWN:
            os.waitpid(pid, os.WNOHANG)


_OWN: set[int] = set()
"""Processes that are waited for by their ``Popen``."""


def _signal(process: psutil.Process, number: int) -> None:
    with contextlib.suppress(psutil.Error):
        process.send_signal(number)
