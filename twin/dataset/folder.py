"""A dataset on disk: where everything lies, what was asked for, what is done."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import yaml

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.files.yaml_file import load_yaml
from twin.base.errors import InfrastructureError, UsageError
from twin.base.files import sync_files, write_atomic
from twin.base.folder_lock import after_all_writers, one_of_the_writers
from twin.dataset.recipe import DatasetRecipe, parse_recipe

HEAD = "dataset.yaml"
_PARTS = ".parts"


@dataclass(frozen=True, slots=True)
class Maker:
    """Who made a dataset; both decide its bytes."""

    software: str
    """:func:`twin.base.software.software_digest`."""
    device_class: str


class Folder:
    """The folder of one dataset."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head_path = path / HEAD

    def read_head(self) -> dict[str, Any] | None:
        """``dataset.yaml`` as plain data; None: there is none.

        Raises:
            UsageError: the folder holds something else, or the file is damaged; one line.
        """
        if not self.head_path.exists():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise UsageError(
                    f"{self.path}: exists and holds no {HEAD}; give a new or empty folder"
                )
            return None
        try:
            head = load_yaml(self.head_path)
        except ValueError as error:
            raise UsageError(f"{error}; give a new folder") from None
        if not isinstance(head, dict) or not isinstance(head.get("recipe"), dict):
            raise UsageError(f"{self.head_path}: has no recipe; give a new folder")
        return head

    def write_head(self, recipe: DatasetRecipe, maker: Maker, more: dict[str, Any]) -> None:
        """Write ``dataset.yaml``."""
        head = {
            "format": 1,
            "software": maker.software,
            "device_class": maker.device_class,
            "recipe": msgspec.to_builtins(recipe),
            **more,
        }
        text = yaml.safe_dump(head, sort_keys=False, width=100)
        write_atomic(self.head_path, text.encode())

    def open(self, recipe: DatasetRecipe, maker: Maker) -> bool:
        """Make the folder ready for more images; returns whether it is complete already.

        Raises:
            UsageError: it was begun with other parameters, software or device; one line.
        """
        head = self.read_head()
        if head is None:
            self.path.mkdir(parents=True, exist_ok=True)
            self.write_head(recipe, maker, {"complete": False})
        else:
            self._check(head, recipe, maker)
        if head is not None and head.get("complete"):
            self._drop_parts()
            return True
        for folder in ("annotations", _PARTS, *(f"images/{split}" for split in recipe.counts())):
            (self.path / folder).mkdir(parents=True, exist_ok=True)
        with after_all_writers(self.path / _PARTS):  # processes of a killed command are gone
            self.sweep()
        return False

    def sweep(self) -> None:
        """Remove what processes left that ended while they wrote."""
        for left in self.path.rglob(".*.tmp"):
            left.unlink(missing_ok=True)

    def writing(self) -> contextlib.AbstractContextManager[None]:
        """Context of a process that writes images for the only writer."""
        return one_of_the_writers(self.path / _PARTS)

    def _check(self, head: dict[str, Any], recipe: DatasetRecipe, maker: Maker) -> None:
        stored = parse_recipe(head["recipe"], str(self.head_path))
        for name in recipe.__struct_fields__:
            begun, given = getattr(stored, name), getattr(recipe, name)
            if begun != given:
                raise UsageError(
                    f"{self.path}: begun with {name} {_shown(begun)}, given {_shown(given)}; "
                    "leave the option away to go on, or give a new folder"
                )
        for name, now in (("software", maker.software), ("device_class", maker.device_class)):
            if head.get(name) != now:
                raise UsageError(
                    f"{self.path}: begun with {name} {str(head.get(name))[:40]}, here it is "
                    f"{now[:40]}, so the images would differ; give a new folder"
                )

    def image_path(self, recipe: DatasetRecipe, split: str, index: int) -> Path:
        """Path of an image."""
        return self.path / "images" / split / f"{index:06d}.{recipe.format}"

    def part_path(self, split: str, index: int) -> Path:
        """Path of its labels until all images are there."""
        return self.path / _PARTS / f"{split}-{index:06d}.json"

    def done(self, recipe: DatasetRecipe, split: str, index: int) -> bool:
        """Whether an image and its labels are there; labels are written last.

        A file without a byte is what a power cut leaves.
        """
        with contextlib.suppress(FileNotFoundError):
            paths = self.part_path(split, index), self.image_path(recipe, split, index)
            return all(path.stat().st_size for path in paths)
        return False

    def write(self, recipe: DatasetRecipe, split: str, index: int, image: bytes, part: Any) -> None:
        """Keep a finished image and its labels."""
        write_atomic(self.image_path(recipe, split, index), image, sync=False)
        text = json.dumps(part, separators=(",", ":"))
        write_atomic(self.part_path(split, index), text.encode(), sync=False)

    def read_part(self, split: str, index: int) -> Any:
        """Labels of a finished image.

        Raises:
            InfrastructureError: they are damaged; one line.
        """
        path = self.part_path(split, index)
        try:
            return decode_json(read_regular(path, RUN_FILE_BYTES_MAX))
        except JsonError:
            raise InfrastructureError(
                f"{path}: damaged, as by a power cut; remove it and run the same command again"
            ) from None

    def finish(self, recipe: DatasetRecipe, maker: Maker, more: dict[str, Any]) -> None:
        """Say that everything is there, and tidy up."""
        sync_files(self.path)
        self.write_head(recipe, maker, {"complete": True, **more})
        self._drop_parts()

    def _drop_parts(self) -> None:
        parts = self.path / _PARTS
        if parts.is_dir():
            for path in parts.iterdir():
                path.unlink()
            parts.rmdir()


def _shown(value: Any) -> str:
    return str(msgspec.to_builtins(value))
