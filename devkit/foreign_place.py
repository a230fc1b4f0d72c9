"""Where a foreign stack runs: in the files of a repository, in a container, or right here.

Fetching and entering are the business of ``hpc``, which is asked by processes of its own.
"""

from __future__ import annotations

import sys

from schemas.foreign import Foreign
from twin.fabric.fetch import fetch


def placed(foreign: Foreign) -> tuple[list[str], str | None]:
    """The command line that starts ``foreign``, and its working folder (None: ours).

    Raises:
        InfrastructureError: its files cannot be had.
    """
    folder = fetch(foreign.repository).folder if foreign.repository is not None else None
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
