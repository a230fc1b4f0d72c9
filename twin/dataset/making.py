"""Makes a dataset, or what is missing of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import warp as wp

from twin.dataset.cameras import Eye, eyes_of
from twin.dataset.cast import Street, streets_of
from twin.dataset.coco import part_of, write_annotations
from twin.dataset.folder import Folder, Maker
from twin.dataset.recipe import Recipe
from twin.dataset.shot import plan_shot, where
from twin.dataset.studio import Studio
from twin.fabric.errors import UsageError
from twin.fabric.files import only_writer
from twin.fabric.software import device_class, software_digest
from twin.vehicle.vehicle_file import Vehicle, load_vehicle
from twin.world.kernel_cache import prepare_kernels

Report = Callable[[int, int], None]
"""Called with the number of finished images and of all images."""


@dataclass(frozen=True, slots=True)
class _Group:
    """Images of one street and camera that are missing."""

    street: Street
    eye: int
    indices: tuple[int, ...]


def make_dataset(
    path: Path, recipe: Recipe, *, slots: int, device: str, report: Report
) -> dict[str, Any]:
    """Render what is missing in ``path`` and complete it; returns ``dataset.yaml`` as plain data.

    The bytes of every file depend on ``recipe``, software and device class alone: not on ``slots``,
    and not on how often it was interrupted.

    Raises:
        UsageError: the recipe cannot be followed, or does not fit what the folder holds; one line.
        InfrastructureError: another process is writing there.
    """
    prepare_kernels()
    maker = Maker(software_digest(), device_class(device))
    vehicle = _vehicle(recipe)
    eyes = eyes_of(recipe, vehicle)
    streets = {s: streets_of(recipe, s) for s, n in recipe.counts().items() if n}
    folder = Folder(path)
    folder.read_head()  # before anything is made: a folder that is not ours stays as it is
    with only_writer(path):
        if not folder.open(recipe, maker):
            try:
                _render(folder, recipe, vehicle, eyes, streets, slots, device, report)
            except ValueError as error:
                raise UsageError(f"dataset: {error}") from None
            text = f"drivetwin: {recipe.scene} and {recipe.other_scene}, seed {recipe.seed}"
            counts = write_annotations(folder, recipe, eyes, text)
            folder.finish(recipe, maker, {"counts": counts})
        found = folder.read_head()
    assert found is not None
    return found


def _vehicle(recipe: Recipe) -> Vehicle:
    try:
        return load_vehicle(recipe.vehicle)
    except ValueError as error:
        raise UsageError(f"dataset: {error}") from None


def _render(
    folder: Folder,
    recipe: Recipe,
    vehicle: Vehicle,
    eyes: list[Eye],
    streets: dict[str, list[Street]],
    slots: int,
    device: str,
    report: Report,
) -> None:
    groups = list(_missing(folder, recipe, streets))
    done = recipe.count - sum(len(group.indices) for group in groups)
    report(done, recipe.count)
    for _, own in groupby(groups, key=lambda group: group.street.name):
        together = list(own)
        street = together[0].street
        studio = Studio(recipe, street, vehicle, eyes, slots, wp.get_device(device))
        for group in together:
            for first in range(0, len(group.indices), slots):
                indices = group.indices[first : first + slots]
                among = streets[street.split]
                shots = [plan_shot(recipe, vehicle, among, street.split, i) for i in indices]
                for taken in studio.take(shots):
                    part = part_of(taken, recipe, street, eyes[group.eye])
                    data = encoded(taken.image, recipe)
                    folder.write(recipe, street.split, taken.shot.index, data, part)
                    done += 1
                    report(done, recipe.count)


def _missing(folder: Folder, recipe: Recipe, streets: dict[str, list[Street]]) -> Iterator[_Group]:
    """By street, then by camera: both take time to set up."""
    for split, count in recipe.counts().items():
        found: dict[tuple[int, int], list[int]] = {}
        for index in range(count):
            if not folder.done(recipe, split, index):
                found.setdefault(where(recipe, split, index), []).append(index)
        for (street, eye), indices in sorted(found.items()):
            yield _Group(streets[split][street], eye, tuple(indices))


def encoded(image: np.ndarray, recipe: Recipe) -> bytes:
    """The picture as a file; uint8 [H, W, 3], RGB."""
    options = [cv2.IMWRITE_JPEG_QUALITY, recipe.quality] if recipe.format == "jpg" else []
    done, data = cv2.imencode(f".{recipe.format}", image[..., ::-1], options)
    assert done, "the picture could not be encoded"
    return data.tobytes()
