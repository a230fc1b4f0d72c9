"""Where a foreign stack runs: in the files of a repository, in a container, or right here.

Fetching and entering are the business of ``hpc``, which is asked by processes of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys

from schemas.foreign import Foreign, Repository
from twin.fabric.cache import cache_folder
from twin.fabric.errors import InfrastructureError


def placed(foreign: Foreign) -> tuple[list[str], str | None]:
    """The command line that starts ``foreign``, and its working folder (None: ours).

    Raises:
        InfrastructureError: its files cannot be had.
    """
    folder = fetched(foreign.repository) if foreign.repository is not None else None
    if foreign.image is None:
        return list(foreign.command), folder
    image = foreign.image
    words = [sys.executable, "-m", "hpc", "enter", "--container", image.path]
    words += ["--runtime", image.runtime]
    for path in image.binds:
        words += ["--bind", path]
    if image.gpus:
        words.append("--gpus")
    return [*words, "--", *foreign.command], folder


def fetched(repository: Repository) -> str:
    """The folder of its files, read-only; nothing is done if they are there already."""
    words = [sys.executable, "-m", "hpc", "fetch", "repository"]
    words += ["--ref", repository.ref, "--setup", repository.setup, "--output", "json"]
    words += ["--cache", str(cache_folder()), "--", repository.url]
    done = subprocess.run(words, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        raise InfrastructureError(done.stderr.strip().removeprefix("hpc: ") or "hpc fetch failed")
    return str(json.loads(done.stdout)["folder"])
