"""What must be known of a detector's ONNX file to turn its outputs into boxes.

Models written by ``devkit import-darknet`` carry it in their metadata; for any other model of the
same kind of heads the user gives it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.validation import convert_all
from twin.base.errors import UsageError

METADATA_KEY = "drivetwin.detector"
"""Key of the description in the metadata of an ONNX file; the value is JSON."""

FILE_BYTES_MAX = 1 << 20
"""Largest description [bytes]."""

Positive = Annotated[float, Meta(gt=0, le=1e6)]


class GridHead(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="grid"):
    """An output of YOLOv2 or v3: a grid of cells with boxes around A anchors, raw.

    The array is [N, A (5 + C), rows, columns]; the 5 + C channels of an anchor are x, y, width,
    height, objectness and one per class, before any activation.
    """

    output: str
    """Name of the output in the ONNX file."""
    anchors_px: Annotated[list[tuple[Positive, Positive]], Meta(min_length=1, max_length=100)]
    """(width, height) at the network's input size [px], above 0 to 1e6."""
    scores: Literal["softmax", "logistic"] = "logistic"
    """Function that makes probabilities of class scores: ``softmax`` in YOLOv2, ``logistic`` in
    YOLOv3."""
    scale_xy: Annotated[float, Meta(ge=1, le=10)] = 1.0
    """Stretch of the centre's range around its cell [-], 1 (off, YOLOv2 and v3) to 10."""

    def channels(self, classes: int) -> int:
        """Channels of the output."""
        return len(self.anchors_px) * (5 + classes)


class BoxHead(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="boxes"):
    """An output of K finished boxes, as many exporters write it.

    The channels of a box are the x and y of its centre, width, height [px of the network's input],
    objectness if there is one, and one probability per class.
    """

    output: str
    """Name of the output in the ONNX file."""
    layout: Literal["rows", "columns"] = "rows"
    """``rows``: [N, K, channels]; ``columns``: [N, channels, K]."""
    objectness: bool = True
    """Whether there is one; the confidence is its product with the class's probability."""

    def channels(self, classes: int) -> int:
        """Channels of the output."""
        return 4 + self.objectness + classes


Head = GridHead | BoxHead


class DetectorDescription(Struct, frozen=True, forbid_unknown_fields=True):
    """A detector: its input and its heads. Images go in as [N, 3, height, width]."""

    width: Annotated[int, Meta(ge=1, le=8192)]
    """Width of the network's input [px], 1 to 8192."""
    height: Annotated[int, Meta(ge=1, le=8192)]
    """Height of the network's input [px], 1 to 8192."""
    names: Annotated[list[str], Meta(min_length=1, max_length=10_000)]
    """Labels of the classes, in the order of the channels."""
    heads: Annotated[list[Head], Meta(min_length=1, max_length=100)]
    v: Literal[1] = 1
    channel_order: Literal["rgb", "bgr"] = "rgb"
    scale: Annotated[float, Meta(gt=0, le=1)] = 1.0 / 255.0
    """Factor of image levels, above 0 to 1 [-]."""

    def encode(self) -> str:
        """Description as JSON, for the metadata."""
        return msgspec.json.encode(self).decode()


def decode_description(text: str, where: str) -> DetectorDescription:
    """The description in ``text``, JSON.

    Raises:
        ValueError: one line that begins with ``where``.
    """
    try:
        data = decode_json(text)
    except JsonError as error:
        raise ValueError(f"{where}: not JSON: {error}") from None
    value, mistakes = convert_all(data, DetectorDescription)
    if value is None:
        raise ValueError(mistakes[0].line(where))
    return value


def read_description(path: Path) -> DetectorDescription:
    """The description in a JSON file.

    Raises:
        UsageError: one line naming the file.
    """
    try:
        return decode_description(read_regular(path, FILE_BYTES_MAX).decode(), str(path))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: not UTF-8 text (byte {error.start})") from None
    except ValueError as error:
        raise UsageError(str(error)) from None
