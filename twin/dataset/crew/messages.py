"""What the processes of a dataset say to each other: JSON lines on standard input and output."""

from __future__ import annotations

import msgspec
from msgspec import Struct

from twin.dataset.crew.task import Task
from twin.dataset.recipe import DatasetRecipe


class Begin(Struct, frozen=True, tag="begin"):
    """First message to a child: what all its tasks are about."""

    folder: str
    recipe: DatasetRecipe
    slots: int
    device: str


class ChildWork(Struct, frozen=True, tag="work"):
    """Message to a child: its next task."""

    task: Task


class ChildReady(Struct, frozen=True, tag="ready"):
    """Message from a child: it waits for a task."""


class ImageWritten(Struct, frozen=True, tag="written"):
    """Message from a child: an image and its labels are there."""

    index: int


class Trouble(Struct, frozen=True, tag="trouble"):
    """Last message from a child: why it cannot go on, one line."""

    text: str
    usage: bool
    """The user can change it."""


_TO_CHILD = msgspec.json.Decoder(Begin | ChildWork)
_FROM_CHILD = msgspec.json.Decoder(ChildReady | ImageWritten | Trouble)


def line_of(message: Struct) -> bytes:
    """Line of a message, as it is written."""
    return msgspec.json.encode(message) + b"\n"


def read_order(line: bytes) -> Begin | ChildWork:
    """What a child is told."""
    return _TO_CHILD.decode(line)


def read_answer(line: bytes) -> ChildReady | ImageWritten | Trouble:
    """What a child says."""
    return _FROM_CHILD.decode(line)
