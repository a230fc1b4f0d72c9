"""Files of a git repository, by the command ``hpc fetch``: asked as any user would ask it.

It stands here because a conductor pins a campaign's commit by it and a stack's host runs in what it
returns; neither imports ``hpc``.
"""

from __future__ import annotations

import subprocess
import sys

import msgspec

from schemas.sections.foreign import Repository
from twin.base.cache import cache_folder
from twin.base.errors import InfrastructureError


class Fetched(msgspec.Struct, frozen=True):
    """Answer of ``hpc fetch repository --output json``, as far as it is needed."""

    folder: str
    """Folder of the repository's files, built and read-only."""
    commit: str


def fetch(repository: Repository) -> Fetched:
    """The files of ``repository``; nothing is done if they are there already.

    Raises:
        InfrastructureError: they cannot be had; what the command said.
    """
    words = [sys.executable, "-m", "hpc", "fetch", "repository"]
    words += ["--ref", repository.ref, "--setup", repository.setup, "--output", "json"]
    words += ["--cache", str(cache_folder()), "--", repository.url]
    done = subprocess.run(words, capture_output=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().removeprefix("hpc: ")
        raise InfrastructureError(reason or f"hpc fetch: exit code {done.returncode}")
    return msgspec.json.decode(done.stdout, type=Fetched)
