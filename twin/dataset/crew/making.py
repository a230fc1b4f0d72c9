"""Makes a dataset, or what is missing of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from twin.base.folder_lock import only_writer
from twin.base.software import device_class, software_digest
from twin.dataset.coco import write_annotations
from twin.dataset.crew.crew import render_together
from twin.dataset.crew.messages import Begin
from twin.dataset.crew.renderer import Renderer
from twin.dataset.crew.task import Agenda, Task, divided
from twin.dataset.folder import Folder, Maker
from twin.dataset.images.shot import where
from twin.dataset.recipe import DatasetRecipe
from twin.world.kernel_cache import prepare_kernels

Report = Callable[[int, int], None]
"""Called with the number of finished images and of all images."""


def make_dataset(
    path: Path, recipe: DatasetRecipe, *, slots: int, device: str, report: Report, jobs: int = 1
) -> dict[str, Any]:
    """Render what is missing in ``path`` and complete it; returns ``dataset.yaml`` as plain data.

    The bytes of every file depend on ``recipe``, software and device class alone: not on ``slots``
    and ``jobs``, and not on how often it was interrupted. Call it from the main thread.

    Raises:
        UsageError: the recipe cannot be followed, or does not fit what the folder holds; one line.
        InfrastructureError: another process is writing there, or one of ours died; one line.
    """
    prepare_kernels()
    maker = Maker(software_digest(), device_class(device))
    folder = Folder(path)
    renderer = Renderer(folder, recipe, slots, device)
    folder.read_head()  # before anything is made: a folder that is not ours stays as it is
    with only_writer(path):
        if not folder.open(recipe, maker):
            tasks = list(_missing(folder, recipe, slots))
            done = recipe.count - sum(len(task.indices) for task in tasks)
            report(done, recipe.count)
            try:
                for _ in _rendered(renderer, Begin(str(path), recipe, slots, device), tasks, jobs):
                    done += 1
                    report(done, recipe.count)
            finally:
                folder.sweep()
            text = f"drivetwin: {recipe.scene} and {recipe.other_scene}, seed {recipe.seed}"
            counts = write_annotations(folder, recipe, renderer.eyes, text)
            folder.finish(recipe, maker, {"counts": counts})
        found = folder.read_head()
    assert found is not None
    return found


def _rendered(renderer: Renderer, begin: Begin, tasks: list[Task], jobs: int) -> Iterator[int]:
    jobs = min(jobs, len(tasks))
    if jobs > 1:
        yield from render_together(begin, Agenda(tasks), jobs)
        return
    for task in tasks:
        yield from renderer.render(task)


def _missing(folder: Folder, recipe: DatasetRecipe, slots: int) -> Iterator[Task]:
    """Missing images by street, then by camera: both take time to set up."""
    for split, count in recipe.counts().items():
        found: dict[tuple[int, int], list[int]] = {}
        for index in range(count):
            if not folder.done(recipe, split, index):
                found.setdefault(where(recipe, split, index), []).append(index)
        for (street, eye), indices in sorted(found.items()):
            yield from divided(split, street, eye, indices, slots)
