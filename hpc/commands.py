"""Runs other programs: the only module here that does."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from twin.base.errors import InfrastructureError

TIMEOUT_S = 120.0
"""Longest wait for a program; a busy scheduler and a cold shared file system are slow [s]."""


@dataclass(frozen=True, slots=True)
class ProgramEnd:
    """End of a program: its exit code and what it wrote."""

    code: int
    out: str
    err: str

    @property
    def last_words(self) -> str:
        """The line that says most about a failure: the last one on standard error."""
        lines = [line for line in (self.err or self.out).splitlines() if line.strip()]
        return lines[-1].strip() if lines else f"exit code {self.code}"


def exists(program: str) -> bool:
    """Whether the program is on the PATH."""
    return shutil.which(program) is not None


def call(
    *arguments: str, text: str | None = None, folder: Path | None = None, wait_s: float = TIMEOUT_S
) -> ProgramEnd:
    """Run a program to its end, with ``text`` on its standard input.

    Raises:
        InfrastructureError: it is not there, or does not answer.
    """
    try:
        done = subprocess.run(
            arguments,
            input=text if text is not None else "",
            capture_output=True,
            text=True,
            errors="replace",
            timeout=wait_s,
            check=False,
            cwd=folder,
        )
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"`{arguments[0]}` did not answer in {wait_s:.0f} s; try again, or ask the site"
        ) from None
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None
    return ProgramEnd(done.returncode, done.stdout, done.stderr)


def watch(*arguments: str) -> int:
    """Run a program that talks to the user itself; its exit code.

    Raises:
        InfrastructureError: it is not there.
    """
    try:
        return subprocess.run(arguments, check=False).returncode
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None


def become(*arguments: str) -> None:
    """Replace this process.

    Raises:
        InfrastructureError: the program is not there.
    """
    try:
        os.execvp(arguments[0], arguments)
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None
