"""Many image files at once, on all cores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from twin.base.picture_file import read_picture

TOGETHER = 64
"""Images that are read before the first of them is used."""


def read_images(paths: Sequence[Path]) -> Iterator[list[np.ndarray]]:
    """The images in turns of up to :data:`TOGETHER`, uint8 [H, W, 3], RGB; the next turn is read
    meanwhile.

    Raises:
        UsageError: a file is missing or no image.
    """
    turns = [paths[first : first + TOGETHER] for first in range(0, len(paths), TOGETHER)]
    with ThreadPoolExecutor() as pool:
        waiting = [pool.submit(read_picture, path) for path in (turns[0] if turns else [])]
        for number in range(len(turns)):
            ready = [one.result() for one in waiting]
            following = turns[number + 1] if number + 1 < len(turns) else []
            waiting = [pool.submit(read_picture, path) for path in following]
            yield ready
