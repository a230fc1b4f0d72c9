"""COCO json files from the labels of single images."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import msgspec

from schemas.messages import OBJECT_CLASSES
from twin.base.files import write_atomic
from twin.dataset.folder import Folder
from twin.dataset.images.cameras import Eye
from twin.dataset.images.cast import Street
from twin.dataset.images.studio import Taken
from twin.dataset.labels import CATEGORIES
from twin.dataset.recipe import DatasetRecipe


def part_of(taken: Taken, recipe: DatasetRecipe, street: Street, eye: Eye) -> dict[str, Any]:
    """What is kept of one image: its COCO entry and its annotations, without ids."""
    shot = taken.shot
    lamps = [name for name in ("low", "high", "fog") if getattr(taken.lights, name)]
    image = {
        "file_name": f"{shot.split}/{shot.index:06d}.{recipe.format}",
        "width": recipe.width,
        "height": recipe.height,
        "split": shot.split,
        "scene": street.name.partition("/")[0],
        "place": street.name,
        "hour": round(shot.minute / 60.0, 3),
        "date": shot.date,
        "weather": shot.weather,
        "conditions": msgspec.to_builtins(shot.conditions),
        "camera": eye.name,
        "lamps": lamps,
        "ego": {
            "x_m": shot.pose.x_m,
            "y_m": shot.pose.y_m,
            "yaw_rad": shot.pose.yaw_rad,
            "z_m": shot.pose.z_m,
            "pitch_rad": shot.pose.pitch_rad,
            "roll_rad": shot.pose.roll_rad,
            "speed_mps": shot.speed_mps,
        },
    }
    return {"image": image, "annotations": taken.annotations}


def write_annotations(
    folder: Folder, recipe: DatasetRecipe, eyes: list[Eye], description: str
) -> dict[str, Any]:
    """Write ``annotations/SPLIT.json`` of all splits; returns what was counted.

    Ids count through all splits, images from 1 and annotations from 1, so files can be joined.
    """
    image_id = annotation_id = 0
    counted: dict[str, Any] = {}
    for split, count in recipe.counts().items():
        images, annotations = [], []
        for index in range(count):
            part = folder.read_part(split, index)
            image_id += 1
            images.append({"id": image_id, **part["image"]})
            for row in part["annotations"]:
                annotation_id += 1
                annotations.append({"id": annotation_id, "image_id": image_id, **row})
        document = {
            "info": {
                "description": description,
                "version": "1",
                "split": split,
                "cameras": {eye.name: _camera(eye) for eye in eyes},
            },
            "licenses": [],
            "images": images,
            "annotations": annotations,
            "categories": CATEGORIES,
        }
        text = json.dumps(document, separators=(",", ":"))
        write_atomic(folder.path / "annotations" / f"{split}.json", text.encode())
        counted[split] = _counts(images, annotations)
    return counted


def _camera(eye: Eye) -> dict[str, Any]:
    spec = eye.camera
    return {
        "hfov_deg": spec.hfov_deg,
        "effects": list(spec.active_effects()),
        "mount": msgspec.to_builtins(eye.mount),
    }


def _counts(images: list[dict[str, Any]], annotations: list[dict[str, Any]]) -> dict[str, Any]:
    labels: Counter[str] = Counter()
    ignored: Counter[str] = Counter()
    for row in annotations:
        name = OBJECT_CLASSES[row["category_id"] - 1]
        (ignored if row["ignore"] else labels)[name] += 1
    return {
        "images": len(images),
        "places": sorted({image["place"] for image in images}),
        "labels": {name: labels[name] for name in OBJECT_CLASSES},
        "ignored": {name: ignored[name] for name in OBJECT_CLASSES},
    }
