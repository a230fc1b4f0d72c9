"""The folder of one training: what was asked for, how far it is, what came out.

::

    OUT/training.yaml    parameters, data, software; complete: true when everything is there
    OUT/log.csv          losses and learning rate of every epoch
    OUT/checkpoint.pt    where it goes on; gone when it is complete
    OUT/NAME.onnx        the detector; NAME.cfg: the network as Darknet has it
    OUT/scores.json      of the exported file, by split
    OUT/MODEL.md         the model card

Every file is complete or absent.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import msgspec
import torch
import yaml

from devkit.training.parameters import TrainingParameters, first_difference, parse_parameters
from schemas.files.yaml_file import load_yaml
from twin.base.errors import UsageError
from twin.base.files import write_atomic

HEAD = "training.yaml"
LOG = "log.csv"
CHECKPOINT = "checkpoint.pt"
SCORES = "scores.json"
CARD = "MODEL.md"

FORMAT = 1


class TrainingFolder:
    """See the module."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read_head(self) -> dict[str, Any] | None:
        """``training.yaml`` as plain data; None: there is none.

        Raises:
            UsageError: the folder holds something else, or the file is damaged; one line.
        """
        path = self.path / HEAD
        if not path.exists():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise UsageError(f"{self.path}: exists and holds no {HEAD}; give a new folder")
            return None
        try:
            head = load_yaml(path)
        except (OSError, ValueError) as error:
            raise UsageError(f"{path}: {error}; give a new folder") from None
        good = isinstance(head, dict) and head.get("format") == FORMAT
        if not good or not isinstance(head.get("parameters"), dict):
            raise UsageError(f"{path}: not what 'devkit train' writes; give a new folder")
        return head

    def check(
        self, head: dict[str, Any], parameters: TrainingParameters, maker: dict[str, Any]
    ) -> None:
        """Whether what was begun is what is asked for.

        Raises:
            UsageError: other parameters, data, software or device; one line.
        """
        begun = parse_parameters(head["parameters"], str(self.path / HEAD))
        difference = first_difference(begun, parameters)
        if difference:
            raise UsageError(
                f"{self.path}: begun with {difference}; leave the option away to go on, or give a"
                " new folder"
            )
        for name, now in maker.items():
            if head.get(name) != now:
                raise UsageError(
                    f"{self.path}: begun with {name} {str(head.get(name))[:60]}, here it is"
                    f" {str(now)[:60]}, so the result would differ; give a new folder"
                )

    def write_head(
        self, parameters: TrainingParameters, maker: dict[str, Any], more: dict[str, Any]
    ) -> None:
        """Write ``training.yaml``."""
        head = {
            "format": FORMAT,
            **maker,
            "parameters": msgspec.to_builtins(parameters),
            **more,
        }
        text = yaml.safe_dump(head, sort_keys=False, width=100)
        write_atomic(self.path / HEAD, text.encode())

    def write(self, name: str, data: bytes) -> None:
        """Write a file of the folder."""
        write_atomic(self.path / name, data)

    def save_checkpoint(self, state: dict[str, Any]) -> None:
        """Keep where the training is."""
        buffer = io.BytesIO()
        torch.save(state, buffer)
        self.write(CHECKPOINT, buffer.getvalue())

    def load_checkpoint(self, device: torch.device) -> dict[str, Any] | None:
        """State of the training; None: at its beginning.

        Raises:
            UsageError: the file is damaged; one line.
        """
        path = self.path / CHECKPOINT
        if not path.exists():
            return None
        try:
            state = torch.load(path, map_location=device, weights_only=True)
        except Exception:  # a pickle can be wrong in any way
            state = None
        if not isinstance(state, dict) or "step" not in state:
            raise UsageError(f"{path}: damaged; remove it to begin again, or give a new folder")
        return state

    def remove_checkpoint(self) -> None:
        """Remove the checkpoint: nothing is left to do."""
        (self.path / CHECKPOINT).unlink(missing_ok=True)

    def tidy(self) -> None:
        """Remove what a killed process left half-written."""
        for left in self.path.glob(".*.tmp"):
            left.unlink()
