"""How a command is started in a sandbox."""

from __future__ import annotations

import contextlib
import os
import platform
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, NoReturn, Self

from twin.base.process import PARENT_VARIABLE, UNKNOWN, spawn
from twin.sandbox.inside import INSIDE_VARIABLE, PROCESSES_MAX, SHARES_VARIABLE
from twin.sandbox.system_calls import filter_of
from twin.sandbox.view import SandboxView, arguments, environment

PROGRAM = "bwrap"
"""The command of bubblewrap."""

# A scheduler that ends a job signals everybody at once; the worker decides, and bubblewrap would
# not wait for it. What a process ignores is ignored by what it becomes.
_UNSIGNALLED = ("sh", "-c", 'trap "" TERM INT; exec "$@"', "sh")

FIRST_PROCESS = "1"
"""Number of the process in the sandbox that starts all others: bwrap's own."""

SIGNAL_CODES_MIN = 128
"""An exit code above it is that of a process which a signal ended."""


class Sandboxed:
    """A command line that starts ``command`` in a sandbox, while the block lasts."""

    def __init__(self, command: Sequence[str], view: SandboxView) -> None:
        """Say what is to run, and what it sees."""
        self._filter = filter_of(platform.machine(), containers=view.containers)
        self._command, self._view = list(command), view
        self._descriptor = -1
        self.environment = {
            **environment(view, os.environ),
            PARENT_VARIABLE: UNKNOWN if "processes" in view.shared else FIRST_PROCESS,
            INSIDE_VARIABLE: "1",
            SHARES_VARIABLE: ",".join(view.shared),
        }
        """All variables of the process."""

    def __enter__(self) -> Self:
        """Open what the command line names."""
        if self._filter is not None:
            self._descriptor = os.memfd_create("filter", os.MFD_CLOEXEC)
            os.write(self._descriptor, self._filter)
            os.lseek(self._descriptor, 0, os.SEEK_SET)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """The command has been started, or never will be."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What the process has to inherit."""
        return (self._descriptor,) if self._descriptor >= 0 else ()

    @property
    def words(self) -> list[str]:
        """The command line."""
        calls = ["--seccomp", str(self._descriptor)] if self._descriptor >= 0 else []
        return [*_UNSIGNALLED, PROGRAM, *arguments(self._view), *calls, "--", *self._command]


def enter(command: Sequence[str], view: SandboxView) -> NoReturn:
    """Become ``command`` in a sandbox.

    Raises:
        OSError: bubblewrap cannot be started.
    """
    with Sandboxed(command, view) as box:
        for descriptor in box.descriptors:
            os.set_inheritable(descriptor, True)
        os.execvpe(box.words[0], box.words, box.environment)


class Inside(subprocess.Popen[bytes]):
    """A process in a sandbox, as its parent holds it: what it holds is bubblewrap's."""

    _killed = False

    def is_crowded(self) -> bool:
        """Whether more than :data:`PROCESSES_MAX` processes are in it."""
        waiting, count = [self.pid], 0
        while waiting and count <= PROCESSES_MAX:
            process = waiting.pop()
            count += 1
            with contextlib.suppress(OSError):
                for thread in Path(f"/proc/{process}/task").iterdir():
                    waiting += map(int, (thread / "children").read_text().split())
        return count > PROCESSES_MAX

    def kill(self) -> None:
        """Kill the process and all that it started; when it has been waited for, nothing is left.

        Killing bubblewrap itself would leave that to a moment later.
        """
        if self.poll() is not None:
            return
        again, self._killed = self._killed, True
        with contextlib.suppress(OSError, ValueError):
            path = Path(f"/proc/{self.pid}/task/{self.pid}/children")
            for first in map(int, path.read_text().split() if not again else ()):
                os.kill(first, signal.SIGKILL)
                self.send_signal(signal.SIGCONT)  # one that stands still tells of no end
                return
        super().kill()


class Entering(Inside):
    """A process that fetches what it needs, and then enters a sandbox."""

    def kill(self) -> None:
        """Kill it; what it started ends with its lifeline."""
        subprocess.Popen.kill(self)


def spawn_inside(command: Sequence[str], view: SandboxView, log: IO[bytes]) -> Inside:
    """:func:`twin.base.process.spawn` in a sandbox. Only from the main thread."""
    with Sandboxed(command, view) as box:
        child = spawn(
            box.words,
            whole=box.environment,
            log=log,
            descriptors=box.descriptors,
            kind=Inside,
        )
    assert isinstance(child, Inside)
    return child


def own_code(child: subprocess.Popen[bytes], code: int) -> int:
    """The exit code of a process as :class:`subprocess.Popen` tells it, if it is in a sandbox: the
    code of that is 128 more than the signal that ended it."""
    number = code - SIGNAL_CODES_MIN
    return -number if isinstance(child, Inside) and 0 < number <= 64 else code
