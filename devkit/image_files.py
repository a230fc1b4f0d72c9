"""Many image files at once, on all cores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from twin.fabric.errors import UsageError

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
        waiting = [pool.submit(_read, path) for path in (turns[0] if turns else [])]
        for number in range(len(turns)):
            ready = [one.result() for one in waiting]
            following = turns[number + 1] if number + 1 < len(turns) else []
            waiting = [pool.submit(_read, path) for path in following]
            yield ready


def _read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if image is None:
        raise UsageError(f"{path}: not an image that OpenCV reads")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
