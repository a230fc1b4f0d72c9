"""Renders tasks into the folder of a dataset, and keeps the street it was in."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import warp as wp

from twin.base.errors import UsageError
from twin.dataset.coco import part_of
from twin.dataset.crew.task import Task
from twin.dataset.folder import Folder
from twin.dataset.images.cameras import Eye, eyes_of
from twin.dataset.images.cast import Street, streets_of
from twin.dataset.images.shot import plan_shot
from twin.dataset.images.studio import Studio
from twin.dataset.recipe import DatasetRecipe
from twin.vehicle.vehicle_file import Vehicle, load_vehicle
from twin.world.kernel_cache import prepare_kernels


class Renderer:
    """One process's part of a dataset."""

    def __init__(self, folder: Folder, recipe: DatasetRecipe, slots: int, device: str) -> None:
        """Build what the pictures are rendered with.

        Raises:
            UsageError: the recipe cannot be followed; one line.
        """
        prepare_kernels()
        self._folder, self._recipe, self._slots = folder, recipe, slots
        self._device = device
        self._vehicle = _vehicle(recipe)
        self.eyes: list[Eye] = eyes_of(recipe, self._vehicle)
        self.streets: dict[str, list[Street]] = {
            split: streets_of(recipe, split) for split, n in recipe.counts().items() if n
        }
        self._open: tuple[tuple[str, int], Studio] | None = None

    def render(self, task: Task) -> Iterator[int]:
        """Render and write the images of ``task``; yields the number of each when it is there.

        Raises:
            UsageError: scene, lens or number of slots cannot be used; one line.
        """
        recipe, among = self._recipe, self.streets[task.split]
        try:
            studio = self._studio(task)
            for first in range(0, len(task.indices), self._slots):
                indices = task.indices[first : first + self._slots]
                shots = [plan_shot(recipe, self._vehicle, among, task.split, i) for i in indices]
                for taken in studio.take(shots):
                    part = part_of(taken, recipe, among[task.street], self.eyes[task.eye])
                    data = encoded(taken.image, recipe)
                    self._folder.write(recipe, task.split, taken.shot.index, data, part)
                    yield taken.shot.index
        except ValueError as error:
            raise UsageError(f"dataset: {error}") from None

    def _studio(self, task: Task) -> Studio:
        if self._open is None or self._open[0] != task.place:
            self._open = None
            street = self.streets[task.split][task.street]
            device = wp.get_device(self._device)
            studio = Studio(self._recipe, street, self._vehicle, self.eyes, self._slots, device)
            self._open = task.place, studio
        return self._open[1]


def _vehicle(recipe: DatasetRecipe) -> Vehicle:
    try:
        return load_vehicle(recipe.vehicle)
    except ValueError as error:
        raise UsageError(f"dataset: {error}") from None


def encoded(image: np.ndarray, recipe: DatasetRecipe) -> bytes:
    """The picture as a file; uint8 [H, W, 3], RGB."""
    options = [cv2.IMWRITE_JPEG_QUALITY, recipe.quality] if recipe.format == "jpg" else []
    done, data = cv2.imencode(f".{recipe.format}", image[..., ::-1], options)
    assert done, "the picture could not be encoded"
    return data.tobytes()
