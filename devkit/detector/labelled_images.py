"""A dataset of ``twin dataset`` as a detector's classes see it: files, boxes, conditions.

The COCO files are read as they are on disk; ``docs/dataset.md`` says what is in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from devkit.detector.evaluate import Truth
from schemas.digest import digest
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.files.yaml_file import load_yaml
from schemas.messages import OBJECT_CLASSES
from schemas.validation import suggest
from twin.base.errors import UsageError

HEAD = "dataset.yaml"

SPLITS = ("train", "held_out", "other_scene")

TESTS = ("held_out", "other_scene")
"""Splits that no training sees; together they are ``all``."""

MODERATE_HEIGHT, MODERATE_VISIBILITY, MODERATE_TRUNCATION = 25 / 375, 0.5, 0.3
"""See :attr:`LabelledImages.moderate` [-]."""

NO_CLASS = -1
"""Class of a box whose category belongs to no class: it may be anything."""

DEFAULT_CLASSES = "car,truck=truck+bus,pedestrian,traffic_sign"
"""Classes of trained detectors. Bicycles belong to no class."""


@dataclass(frozen=True, slots=True)
class DetectorClass:
    """A class of a detector and the categories of a dataset that belong to it."""

    label: str
    categories: tuple[str, ...]


def parse_classes(text: str) -> tuple[DetectorClass, ...]:
    """``LABEL,LABEL=CATEGORY+CATEGORY``; a label alone is the category of that name.

    Raises:
        UsageError: nothing between two marks, or a label or category twice.
    """
    classes = []
    for part in text.split(","):
        label, _, categories = part.strip().partition("=")
        names = tuple(name.strip() for name in (categories or label).split("+"))
        if not label or not all(names):
            raise UsageError(f"classes '{text}': give names as in {DEFAULT_CLASSES}")
        classes.append(DetectorClass(label.strip(), names))
    for what, words in (
        ("label", [one.label for one in classes]),
        ("category", [name for one in classes for name in one.categories]),
    ):
        twice = next((name for name in words if words.count(name) > 1), None)
        if twice is not None:
            raise UsageError(f"classes '{text}': {what} '{twice}' stands there twice")
    return tuple(classes)


def classes_for(names: Sequence[str], text: str | None, model: str) -> tuple[DetectorClass, ...]:
    """Classes of a detector that are scored.

    Args:
        names: what the detector tells apart.
        text: as for :func:`parse_classes`; None: names that are categories, and buses are trucks
            unless the detector knows both. Other names are not scored: nothing can be them.
        model: stands before the error.

    Raises:
        UsageError: the detector has no such class, or none of a dataset's.
    """
    if text is not None:
        classes = parse_classes(text)
    else:
        bus = "truck" in names and "bus" not in names
        classes = tuple(
            DetectorClass(name, ("truck", "bus") if bus and name == "truck" else (name,))
            for name in names
            if name in OBJECT_CLASSES
        )
        if not classes:
            raise UsageError(
                f"{model}: none of its classes is a category ({', '.join(OBJECT_CLASSES)}); give"
                " --classes, e.g. car,person=pedestrian"
            )
    for one in classes:
        if one.label not in names:
            raise UsageError(f"{model}: no class '{one.label}'; {suggest(one.label, list(names))}")
    return classes


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImages:
    """N images with M boxes, in the order of the files."""

    names: tuple[str, ...]
    """Labels of the classes."""
    paths: tuple[Path, ...]
    size_px: np.ndarray
    """int64 [N, 2]: width, height."""
    hour: np.ndarray
    """float64 [N]: local time, 0 to 24."""
    weather: tuple[str, ...]
    """A preset's name or ``custom``, per image."""
    image: np.ndarray
    """int64 [M]: index of the image."""
    class_id: np.ndarray
    """int64 [M]: index into ``names``, or :data:`NO_CLASS`."""
    box_px: np.ndarray
    """float64 [M, 4]: x and y of the upper left corner, width, height."""
    ignored: np.ndarray
    """bool [M]: neither an object to be found nor background."""
    visibility: np.ndarray
    """float64 [M]: share of its pixels that nothing hides."""
    truncation: np.ndarray
    """float64 [M]: share of it outside the image."""
    distance_m: np.ndarray
    """float64 [M]: distance from the camera [m]."""

    @property
    def moderate(self) -> np.ndarray:
        """bool [M]: what KITTI's level "moderate" asks for (Geiger et al., 2012): a box at least 25
        of 375 pixels high, at most partly hidden (here half), at most 30 % outside the image."""
        high = self.box_px[:, 3] >= MODERATE_HEIGHT * self.size_px[self.image, 1]
        clear = (self.visibility >= MODERATE_VISIBILITY) & (self.truncation <= MODERATE_TRUNCATION)
        moderate: np.ndarray = high & clear & ~self.ignored
        return moderate

    def truth(self, ignored: np.ndarray | None = None) -> Truth:
        """Truth for :func:`devkit.detector.evaluate.evaluate`: a box of no class is ignored.

        Args:
            ignored: bool [M], instead of the data's own.
        """
        ignored = self.ignored if ignored is None else ignored
        loose = np.flatnonzero(self.class_id == NO_CLASS)
        bound = np.flatnonzero(self.class_id != NO_CLASS)
        rows = np.concatenate([bound, np.repeat(loose, len(self.names))])
        any_class = np.tile(np.arange(len(self.names)), len(loose))
        return Truth(
            image=self.image[rows],
            class_id=np.concatenate([self.class_id[bound], any_class]),
            box_px=self.box_px[rows],
            ignored=ignored[rows],
        )


@dataclass(frozen=True, slots=True)
class DatasetHead:
    """What ``dataset.yaml`` says."""

    path: Path
    recipe: dict[str, Any]
    software: str
    digest: str
    """SHA-256 of the file, so of all that decides the dataset's bytes."""
    images: dict[str, int]
    """Number of images, by split."""

    def command(self) -> str:
        """The ``twin dataset`` command that makes it again, as far as it differs from the usual."""
        recipe, parts = self.recipe, [f"twin dataset {self.path.name}"]
        for key in ("count", "seed"):
            parts.append(f"--{key} {recipe[key]}")
        parts.append(f"--size {recipe['width']}x{recipe['height']}")
        for key in ("split_shares", "streets"):
            values = ",".join(f"{recipe[key][split]:g}" for split in SPLITS)
            parts.append(f"--{key.replace('_', '-')} {values}")
        for key in ("scene", "other_scene", "vehicle", "camera", "cameras", "format", "quality"):
            parts.append(f"--{key.replace('_', '-')} {recipe[key]}")
        parts += [f"--rule {key}={value:g}" for key, value in recipe["rules"].items()]
        return " ".join(parts)


_RECIPE_KEYS = {
    *("count", "seed", "width", "height", "split_shares", "streets", "rules"),
    *("scene", "other_scene", "vehicle", "camera", "cameras", "format", "quality"),
}


def read_head(folder: Path) -> DatasetHead:
    """``dataset.yaml`` of a complete dataset.

    Raises:
        UsageError: no such folder, no dataset, or not complete; one line.
    """
    path = folder / HEAD
    if not path.is_file():
        raise UsageError(f"{folder}: no dataset, {HEAD} is missing; make one with 'twin dataset'")
    try:
        head = load_yaml(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: {error}") from None
    recipe = head.get("recipe") if isinstance(head, dict) else None
    if not isinstance(recipe, dict) or head.get("format") != 1 or _RECIPE_KEYS - set(recipe):
        raise UsageError(f"{path}: not what 'twin dataset' writes; make the dataset again")
    if not head.get("complete"):
        raise UsageError(f"{folder}: not complete; 'twin dataset {folder}' goes on with it")
    counts = head.get("counts") or {}
    images = {split: counts.get(split, {}).get("images", 0) for split in SPLITS}
    software = str(head.get("software"))
    return DatasetHead(
        folder, recipe, software, digest([read_regular(path, RUN_FILE_BYTES_MAX)]), images
    )


def read_labelled(
    folder: Path, splits: Sequence[str], classes: Sequence[DetectorClass]
) -> LabelledImages:
    """Images and boxes of some splits.

    Raises:
        UsageError: a file is missing or damaged, a category is unknown, or there is no image.
    """
    documents = [_read(folder / "annotations" / f"{split}.json") for split in splits]
    images = [image for document in documents for image in document.images]
    if not images:
        raise UsageError(f"{folder}: no images in {' and '.join(splits)}; give another split")
    boxes = [box for document in documents for box in document.annotations]
    class_of = _class_of(folder, documents, classes)
    index_of = {image.id: index for index, image in enumerate(images)}
    strays = [box for box in boxes if box.image_id not in index_of]
    if strays:
        raise UsageError(f"{folder}: annotation {strays[0].id} is of no image; damaged")
    class_id = np.array([class_of[box.category_id] for box in boxes], np.int64)
    return LabelledImages(
        names=tuple(one.label for one in classes),
        paths=tuple(folder / "images" / image.file_name for image in images),
        size_px=np.array([(image.width, image.height) for image in images], np.int64),
        hour=np.array([image.hour for image in images]),
        weather=tuple(image.weather for image in images),
        image=np.array([index_of[box.image_id] for box in boxes], np.int64),
        class_id=class_id,
        box_px=np.array([box.bbox for box in boxes], np.float64).reshape(-1, 4),
        ignored=np.array([bool(box.ignore) for box in boxes], bool) | (class_id == NO_CLASS),
        visibility=np.array([box.visibility for box in boxes]),
        truncation=np.array([box.truncation for box in boxes]),
        distance_m=np.array([box.distance_m for box in boxes]),
    )


class _Image(Struct, frozen=True):
    id: int
    file_name: str
    width: int
    height: int
    hour: float
    weather: str


class _Box(Struct, frozen=True):
    id: int
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    ignore: int
    visibility: float
    truncation: float
    distance_m: float


class _Category(Struct, frozen=True):
    id: int
    name: str


class _Document(Struct, frozen=True):
    images: list[_Image]
    annotations: list[_Box]
    categories: list[_Category]


def _read(path: Path) -> _Document:
    try:
        return decode_json(read_regular(path, RUN_FILE_BYTES_MAX), _Document)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    except JsonError as error:
        raise UsageError(f"{path}: not an annotation file of 'twin dataset': {error}") from None


def _class_of(
    folder: Path, documents: Sequence[_Document], classes: Sequence[DetectorClass]
) -> dict[int, int]:
    """Category id -> index of the class."""
    known = {one.id: one.name for document in documents for one in document.categories}
    wanted = {name: index for index, one in enumerate(classes) for name in one.categories}
    for name in wanted:
        if name not in known.values():
            raise UsageError(f"{folder}: no category '{name}'; {suggest(name, [*known.values()])}")
    return {key: wanted.get(name, NO_CLASS) for key, name in known.items()}
