"""A contact sheet of a dataset: random images with their boxes, for people to look at."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from twin.base.errors import UsageError
from twin.base.files import write_atomic
from twin.base.picture_file import read_picture
from twin.dataset.chance import generator

_COLORS = {
    "car": (80, 220, 80),
    "truck": (60, 180, 255),
    "bus": (255, 150, 60),
    "pedestrian": (70, 70, 255),
    "bicycle": (255, 90, 255),
    "traffic_sign": (60, 240, 240),
}
"""BGR."""
_IGNORED = (150, 150, 150)
_LABEL_PX = 18
_SUFFIXES = (".png", ".jpg")


def check_sheet(path: Path, dataset: Path) -> None:
    """Whether a sheet of ``dataset`` can be written to ``path``; asked before hours of rendering,
    when the dataset need not be there.

    Raises:
        UsageError: another ending, a folder, or in a folder that is not there; one line.
    """
    if path.suffix.lower() not in _SUFFIXES:
        raise UsageError(f"preview {path}: give a file that ends in {' or '.join(_SUFFIXES)}")
    if path.is_dir():
        raise UsageError(f"preview {path}: is a folder; give a file")
    if not path.parent.is_dir() and path.parent.resolve() != dataset.resolve():
        raise UsageError(f"preview {path}: no folder {path.parent}; make it, or give another one")


def write_sheet(path: Path, dataset: Path, *, columns: int, rows: int, seed: int) -> None:
    """Write random images of all splits with boxes: labels in colour, ignored ones in thin grey.

    Raises:
        UsageError: no such file can be written, or no complete dataset; one line.
    """
    check_sheet(path, dataset)
    documents = [
        json.loads(read_regular(p, RUN_FILE_BYTES_MAX))
        for p in sorted(dataset.glob("annotations/*.json"))
    ]
    images = [(image, doc) for doc in documents for image in doc["images"]]
    if not images:
        raise UsageError(f"preview: {dataset} holds no images")
    order = generator(seed, "preview", "preview").permutation(len(images))[: columns * rows]
    cells = [_cell(dataset, *images[i]) for i in order.tolist()]
    cells += [np.zeros_like(cells[0])] * (columns * rows - len(cells))
    sheet = np.vstack([np.hstack(cells[r * columns : (r + 1) * columns]) for r in range(rows)])
    done, data = cv2.imencode(path.suffix.lower(), sheet)
    assert done, "the sheet could not be encoded"
    try:
        write_atomic(path, data.tobytes())
    except OSError as error:
        raise UsageError(f"preview {path}: {error.strerror or error}") from None


def _cell(dataset: Path, image: dict[str, Any], document: dict[str, Any]) -> np.ndarray:
    names = {row["id"]: row["name"] for row in document["categories"]}
    file = dataset / "images" / image["file_name"]
    picture = cv2.cvtColor(read_picture(file), cv2.COLOR_RGB2BGR)
    scale = max(1, round(480 / picture.shape[1]))
    picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    for row in document["annotations"]:
        if row["image_id"] == image["id"]:
            x, y, w, h = (scale * v for v in row["bbox"])
            color = _IGNORED if row["ignore"] else _COLORS[names[row["category_id"]]]
            cv2.rectangle(picture, (x, y), (x + w - 1, y + h - 1), color, 1)
    strip = np.full((_LABEL_PX, picture.shape[1], 3), 24, np.uint8)
    hour = image["hour"]
    text = f"{image['file_name']}  {int(hour):02d}:{round(hour % 1 * 60):02d} {image['weather']}"
    text += f"  cam {image['camera']}"
    cv2.putText(strip, text, (5, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (235,) * 3, 1, cv2.LINE_AA)
    return np.vstack([strip, picture])
