"""A dataset for the detector of dark spots in ``tiny_networks``."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import yaml

RECIPE = (
    *("count", "seed", "width", "height", "split_shares", "streets", "rules", "scene"),
    *("other_scene", "vehicle", "camera", "cameras", "format", "quality"),
)


def write_dark_spots(folder: Path) -> Path:
    """Pictures of 32x32, white with a dark square in one of 16 cells, which is a car."""
    (folder / "annotations").mkdir(parents=True)
    head = {"format": 1, "complete": True, "recipe": dict.fromkeys(RECIPE, 1), "software": "a"}
    (folder / "dataset.yaml").write_text(yaml.safe_dump(head))
    for split, cells in (("train", range(16)), ("held_out", range(0, 16, 3)), ("other_scene", [5])):
        (folder / "images" / split).mkdir(parents=True)
        images, boxes = [], []
        for cell in cells:
            y, x = 8 * (cell // 4), 8 * (cell % 4)
            picture = np.full((32, 32, 3), 255, np.uint8)
            picture[y : y + 8, x : x + 8] = 0
            name = f"{split}/{cell}.png"
            cv2.imwrite(str(folder / "images" / name), picture)
            key = cell + 100 * (split == "other_scene")
            place = {"file_name": name, "width": 32, "height": 32, "hour": 12.0}
            images.append({"id": key, "weather": "clear", **place})
            corner = [max(x - 2, 0), max(y - 2, 0)]
            size = [min(x + 10, 32) - corner[0], min(y + 10, 32) - corner[1]]
            seen = {"ignore": 0, "visibility": 1.0, "truncation": 0.0, "distance_m": 9.0}
            box = {"id": key, "image_id": key, "category_id": 1, "bbox": corner + size, **seen}
            boxes.append(box)
        content = {
            "images": images,
            "annotations": boxes,
            "categories": [{"id": 1, "name": "car"}],
        }
        (folder / "annotations" / f"{split}.json").write_text(json.dumps(content))
    return folder
