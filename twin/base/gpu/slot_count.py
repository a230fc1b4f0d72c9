"""Number of slots that fit on a GPU, by the simulator's own count: a process that is asked once."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence

from twin.base.process import spawn

TIMEOUT_S = 60.0
"""Longest time to build the scene and add up [s]."""


class MemoryCount:
    """``twin memory`` with ``options``, of a campaign or a case, JSON on its input; it counts while
    the caller does something else. Only from the main thread, with which it ends."""

    def __init__(self, of: bytes, options: Sequence[str]) -> None:
        command = [sys.executable, "-m", "twin", "memory", *options, "--output", "json"]
        self._process: subprocess.Popen[bytes] | None = None
        with contextlib.suppress(OSError), tempfile.TemporaryFile() as stdin:
            stdin.write(of)
            stdin.seek(0)
            self._process = spawn(command, given=stdin, pipe_output=True)

    def slots(self) -> int | None:
        """Number of slots that fit; None: unknown, and a rig that does not fit says so itself."""
        if self._process is None:
            return None
        try:
            answer, _ = self._process.communicate(timeout=TIMEOUT_S)
            fits = json.loads(answer)["slots_max"]
        except (subprocess.TimeoutExpired, ValueError, KeyError):
            return None
        finally:
            self.discard()
        return fits if isinstance(fits, int) else None

    def discard(self) -> None:
        """End the count: nobody asks any more."""
        if self._process is not None:
            with self._process:
                self._process.kill()
