"""``twin dataset``: what the command line says."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.base.errors import UsageError
from twin.base.progress import progress
from twin.dataset.crew.making import make_dataset
from twin.dataset.folder import Folder
from twin.dataset.recipe import SPLITS, DatasetRecipe, parse_recipe
from twin.dataset.sheet import check_sheet, write_sheet
from twin.dataset.tally import print_tally, tally

_GPU_JOBS = 4
_BATCH = {True: (1 << 20, 16), False: (1 << 24, 64)}
"""Batches on a CPU and on a GPU: pixels of a batch, and most images of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetRequest:
    """A dataset as it is asked for; None and empty ones are what the folder says, or the usual."""

    out: Path
    plain: dict[str, Any]
    """Keys of :class:`twin.dataset.recipe.DatasetRecipe` with plain values, or None."""
    size: str | None = None
    """``WIDTHxHEIGHT``"""
    split_shares: str | None = None
    """Three numbers with commas."""
    streets: str | None = None
    rules: tuple[str, ...] = ()
    """``KEY=NUMBER`` each."""
    slots: int | None = None
    """Default: as many as fill a batch; 16 images of 320x192 on a CPU, 64 on a GPU."""
    jobs: int | None = None
    """Processes. Default: as many as there are cores, on a GPU at most 4."""
    device: str = "cpu"
    preview: Path | None = None


def run_dataset(request: DatasetRequest) -> dict[str, Any]:
    """Make the dataset, write the preview; returns ``dataset.yaml`` as plain data.

    Raises:
        TwinError: a mistake in the request, or the folder cannot be used; one line.
    """
    head = Folder(request.out).read_head()
    data = dict(head["recipe"]) if head else {}
    data |= {key: value for key, value in request.plain.items() if value is not None}
    if request.size is not None:
        data["width"], data["height"] = _numbers("size", request.size, "x", 2, int)
    for name in ("split_shares", "streets"):
        text = getattr(request, name)
        if text is not None:
            values = _numbers(
                name.replace("_", "-"), text, ",", 3, int if name == "streets" else float
            )
            data[name] = dict(zip(SPLITS, values, strict=True))
    if request.rules:
        data["rules"] = {**data.get("rules", {}), **dict(_rule(text) for text in request.rules)}
    recipe = parse_recipe(data, "dataset")
    if request.preview is not None:
        check_sheet(request.preview, request.out)
    on_cpu, cores = request.device == "cpu", len(os.sched_getaffinity(0))
    with progress("dataset", "rendering", "images") as report:
        found = make_dataset(
            request.out,
            recipe,
            slots=request.slots or _usual_slots(recipe, on_cpu),
            jobs=request.jobs or (cores if on_cpu else min(cores, _GPU_JOBS)),
            device=request.device,
            report=report,
        )
    if request.preview is not None:
        write_sheet(request.preview, request.out, columns=4, rows=5, seed=recipe.seed)
    return found


def _usual_slots(recipe: DatasetRecipe, on_cpu: bool) -> int:
    pixels, most = _BATCH[on_cpu]
    return max(1, min(most, pixels // (recipe.width * recipe.height)))


def show_dataset(request: DatasetRequest, *, as_json: bool) -> None:
    """Make the dataset and print what it holds: a table, or one JSON object.

    Raises:
        TwinError: as :func:`run_dataset`.
    """
    run_dataset(request)
    found = tally(request.out)
    if as_json:
        print(json.dumps({"dataset": str(request.out), **found}))
        return
    print_tally(found)
    print(request.out)


def _numbers(option: str, text: str, mark: str, count: int, type_: type) -> list[Any]:
    parts = text.split(mark)
    with contextlib.suppress(ValueError):
        if len(parts) == count:
            return [type_(part) for part in parts]
    example = {"size": "320x192", "split-shares": "0.8,0.1,0.1", "streets": "6,2,1"}[option]
    raise UsageError(f"--{option} '{text}': give {count} numbers, as in {example}")


def _rule(text: str) -> tuple[str, Any]:
    key, _, number = text.partition("=")
    with contextlib.suppress(ValueError):
        value = float(number)
        whole = key.strip().endswith("_px_min") and value.is_integer()
        return key.strip(), int(value) if whole else value
    raise UsageError(f"--rule '{text}': give KEY=NUMBER, as in visibility_min=0.3")
