"""Writes and reads the record of an attempt's drive plane, see :mod:`schemas.files.drive_record`.

The simulator writes it and `devkit` reads it, so it stands where both may import it.
"""

from __future__ import annotations

import hashlib
import io
import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from schemas import SCHEMA_VERSION
from schemas.escape import escape
from schemas.files.drive_record import (
    BLOCK_BYTES_MAX,
    DRIVE_FILE,
    RecordAnswer,
    RecordArray,
    RecordBlock,
    RecordEnd,
    RecordHead,
    RecordSeen,
)
from schemas.files.regular_file import open_regular
from schemas.first_stage import head_of
from twin.base.errors import UsageError
from twin.base.picture_file import DAMAGED

_LENGTH = struct.Struct("<I")
_SMALL_BYTES = 256
"""Below this deflate gains nothing [bytes]."""


def coded(values: NDArray[Any], count: int = -1) -> RecordArray:
    """One slot's array of a sensor, made small; exact."""
    dtype = values.dtype.newbyteorder("<").str
    shape = list(values.shape)
    if values.dtype == np.uint8 and values.ndim == 3 and values.shape[2] == 3 and values.size:
        return RecordArray(dtype, shape, "png", _png(values), count)
    data = values.astype(dtype, copy=False).tobytes()
    if len(data) < _SMALL_BYTES:
        return RecordArray(dtype, shape, "raw", data, count)
    return RecordArray(dtype, shape, "zlib", zlib.compress(data, 1), count)


def _png(pixels: NDArray[Any]) -> bytes:
    """A picture [H, W, 3] as PNG, without deflate's search for repetitions.

    Noise of a camera repeats nothing: measured 1.75 times smaller in 2.8 ms (320x180), where the
    search gives 1.56 in 4.0 ms.
    By OpenCV, which takes 0.6 of Pillow's time; workers may be without it.
    """
    try:
        import cv2
    except ModuleNotFoundError:
        file = io.BytesIO()
        picture = Image.fromarray(pixels)
        picture.save(file, "PNG", compress_level=1, compress_type=zlib.Z_HUFFMAN_ONLY)
        return file.getvalue()
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    fine, png = cv2.imencode(".png", np.ascontiguousarray(pixels[:, :, ::-1]), options)
    assert fine
    return png.tobytes()


def decoded(array: RecordArray) -> NDArray[Any]:
    """The array again.

    Raises:
        ValueError: its bytes are damaged.
    """
    dtype = np.dtype(array.dtype)
    size = math.prod(array.shape) * dtype.itemsize
    if not 0 <= size <= BLOCK_BYTES_MAX:  # a few bytes may claim gigabytes of zeros
        raise ValueError(f"an array of {size} bytes, at most {BLOCK_BYTES_MAX}")
    if array.coding == "png":
        return _from_png(array)
    if array.coding == "zlib":
        unpack = zlib.decompressobj()
        data = unpack.decompress(array.data, size + 1)
    else:
        data = array.data
    if len(data) != size:
        raise ValueError(f"an array of {len(data)} bytes, its shape says {size}")
    return np.frombuffer(data, dtype).reshape(array.shape)


def _from_png(array: RecordArray) -> NDArray[Any]:
    # Pillow, since OpenCV takes a damaged chunk at its word: 59 bytes made it fill 4 GB.
    try:
        with Image.open(io.BytesIO(array.data), formats=["PNG"]) as picture:
            # Before it is unpacked: a few bytes may claim gigabytes of picture.
            if [picture.height, picture.width, len(picture.getbands())] == array.shape:
                return np.array(picture)
    except DAMAGED:
        pass
    raise ValueError("a picture cannot be decoded")


class RecordWriter:
    """Appends blocks to one file; every block is in the file when the call returns."""

    def __init__(self, path: Path, head: RecordHead) -> None:
        """Begin the file with ``head``.

        Raises:
            OSError: it cannot be written.
        """
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[bytes] = path.open("wb", buffering=0)
        self._sha = hashlib.sha256()
        self._encode = msgspec.msgpack.Encoder().encode
        self.size = 0
        """Size of the file [bytes]."""
        self.ticks = 0
        try:
            self.write(head)
        except OSError:
            self.close()
            path.unlink()  # without its head it says nothing, and stands in the way of the others
            raise

    def write(self, block: RecordBlock) -> None:
        """Append a block.

        Raises:
            OSError: it cannot be written; a reader leaves out what there is of it.
        """
        data = self._encode(block)
        whole = memoryview(_LENGTH.pack(len(data)) + data)
        self._sha.update(whole)
        self.size += len(whole)
        while whole:  # a disk that is nearly full takes a part
            whole = whole[self._file.write(whole) :]
        self.ticks += isinstance(block, RecordSeen)

    def end(self, outcome: str, verdict: str, cut: str) -> None:
        """Write the last block.

        Raises:
            OSError: it cannot be written.
        """
        self.write(RecordEnd(self.ticks, self._sha.hexdigest(), outcome, verdict, cut))
        self.close()

    def close(self) -> None:
        """Leave the file as it is."""
        self._file.close()


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """One tick of an attempt."""

    seen: RecordSeen
    answer: RecordAnswer | None
    """Answer of the stack; None: the attempt ended before there was one."""


class RecordReader:
    """Reads one file, tick by tick."""

    def __init__(self, path: Path) -> None:
        """Read the head.

        Args:
            path: the file, or the folder of its attempt.

        Raises:
            UsageError: no such file, or none of these; one line.
        """
        self.path = path / DRIVE_FILE if path.is_dir() else path
        self._decode = msgspec.msgpack.Decoder(RecordBlock).decode
        self.read_bytes = 0
        """Bytes of the file that have been read."""
        self.end: RecordEnd | None = None
        """End of the record, known when all ticks were read; None: the file was cut off."""
        try:
            with open_regular(self.path) as file:
                head = next(self._blocks(file), None)
        except FileNotFoundError:
            raise UsageError(
                f"{self.path}: no such record; campaigns with `recording: {{drive: all}}` leave one"
                " per attempt"
            ) from None
        except OSError as error:
            raise UsageError(f"{self.path}: {error.strerror}") from None
        if not isinstance(head, RecordHead):
            raise UsageError(f"{self.path}: no record of a drive: it does not begin with its case")
        if head.v != SCHEMA_VERSION:
            raise UsageError(
                f"{self.path}: schema version {head.v} given, this side speaks {SCHEMA_VERSION}; "
                "install the version that wrote it"
            )
        self.head = head

    def ticks(self) -> Iterator[RecordedTick]:
        """All ticks from the first on.

        Raises:
            UsageError: the file is damaged; one line.
        """
        open_tick: RecordSeen | None = None
        with open_regular(self.path) as file:
            for block in self._blocks(file):
                if isinstance(block, RecordAnswer) and open_tick is not None:
                    yield RecordedTick(open_tick, block)
                    open_tick = None
                elif isinstance(block, RecordSeen):
                    if open_tick is not None:
                        yield RecordedTick(open_tick, None)
                    open_tick = block
                elif isinstance(block, RecordEnd):
                    self.end = block
        if open_tick is not None:
            yield RecordedTick(open_tick, None)

    def _blocks(self, file: IO[bytes]) -> Iterator[RecordBlock]:
        """Whole blocks of a file; what was cut off is left out."""
        sha = hashlib.sha256()
        while len(length := file.read(_LENGTH.size)) == _LENGTH.size:
            (size,) = _LENGTH.unpack(length)
            if size > BLOCK_BYTES_MAX:
                raise UsageError(f"{self.path}: damaged: a block of {size} bytes")
            data = file.read(size)
            if len(data) < size:
                return
            try:
                block = self._decode(data) if file.tell() > _LENGTH.size + size else _head(data)
            except (msgspec.MsgspecError, ValueError, RecursionError) as error:
                words = escape(str(error) or "nested too deeply")
                raise UsageError(
                    f"{self.path}: damaged, or no record of a drive: {words}"
                ) from None
            if isinstance(block, RecordEnd) and block.sha256 != sha.hexdigest():
                raise UsageError(f"{self.path}: damaged: its bytes are not those that were written")
            sha.update(length)
            sha.update(data)
            self.read_bytes = file.tell()
            yield block


def _head(data: bytes) -> RecordBlock:
    """The first block, also as release 0.1 wrote it."""
    head: RecordBlock = msgspec.convert(head_of(msgspec.msgpack.decode(data)), RecordBlock)
    return head
