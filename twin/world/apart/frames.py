"""Frames on the pipe from a parser's process: a head in JSON, then the bytes of its arrays."""

from __future__ import annotations

import math
import os
import select
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from schemas.files.json_text import JsonError, decode_json
from twin.world.apart.checks import AnswerError

HEAD_BYTES_MAX = 32 << 20
"""Largest head of a frame [bytes]; it has some hundred for each part of a mesh."""
ARRAYS_MAX = 1 << 19
"""Most arrays of a frame."""
AXES_MAX = 4
"""Most axes of an array."""
DTYPES = ("uint8", "int32", "int64", "float32", "float64")
"""Types of arrays."""

_LENGTH = struct.Struct("<I")


class FrameHead(msgspec.Struct, forbid_unknown_fields=True):
    """What stands before the arrays."""

    error: str = ""
    """Why there is no answer; empty: there is one."""
    tree: Any = None
    arrays: list[tuple[str, list[int]]] = []
    """Type and shape of each array that follows."""


def write_frame(write: Callable[[memoryview], object], tree: Any, arrays: Sequence[Any]) -> None:
    """Write an answer.

    Raises:
        AnswerError: it is larger than who reads it takes.
    """
    plain = [np.ascontiguousarray(array) for array in arrays]
    head = FrameHead(tree=tree, arrays=[(array.dtype.name, list(array.shape)) for array in plain])
    data = msgspec.json.encode(head)
    if len(data) > HEAD_BYTES_MAX or len(plain) > ARRAYS_MAX:
        raise AnswerError(f"more than {ARRAYS_MAX} parts and pictures")
    write(memoryview(_LENGTH.pack(len(data)) + data))
    for array in plain:
        write(array.reshape(-1).view(np.uint8).data)


def write_error(write: Callable[[memoryview], object], error: str) -> None:
    """Write why there is no answer."""
    data = msgspec.json.encode(FrameHead(error=error))
    write(memoryview(_LENGTH.pack(len(data)) + data))


@dataclass(slots=True)
class FrameReader:
    """Reads frames of somebody who is not trusted, until a deadline."""

    descriptor: int
    until_s: float
    """``time.monotonic`` at which it is given up [s]."""
    bytes_left: int
    """Most that is read on [bytes]."""

    def ready(self) -> None:
        """Wait for the byte by which the process says that it has begun.

        Raises:
            EOFError: it ended before.
            TimeoutError: the deadline has passed.
        """
        self._read(1)

    def frame(self) -> tuple[FrameHead, list[np.ndarray]]:
        """The next frame, and its arrays.

        Raises:
            AnswerError: there is something else, or more than may be.
            EOFError: the process has ended.
            TimeoutError: the deadline has passed.
        """
        (length,) = _LENGTH.unpack(self._read(_LENGTH.size).tobytes())
        if length > HEAD_BYTES_MAX:
            raise AnswerError(f"a head of {length} bytes")
        try:
            head: FrameHead = decode_json(self._read(length).tobytes(), FrameHead)
        except JsonError:
            raise AnswerError("a head that cannot be read") from None
        if len(head.arrays) > ARRAYS_MAX:
            raise AnswerError(f"{len(head.arrays)} arrays")
        return head, [self._array(dtype, shape) for dtype, shape in head.arrays]

    def _array(self, dtype: str, shape: list[int]) -> np.ndarray:
        if dtype not in DTYPES or len(shape) > AXES_MAX or any(size < 0 for size in shape):
            raise AnswerError("an array of a type or shape that is not read")
        count = math.prod(shape) * np.dtype(dtype).itemsize
        return self._read(count).view(dtype).reshape(shape)

    def _read(self, count: int) -> np.ndarray:
        """The next ``count`` bytes, uint8 [count]."""
        if count > self.bytes_left:
            raise AnswerError("more bytes than may be")
        self.bytes_left -= count
        try:
            found = np.empty(count, np.uint8)  # memory is taken as it fills
        except MemoryError:
            raise AnswerError("more bytes than there is memory") from None
        rest = found.data
        waiting = select.poll()
        waiting.register(self.descriptor, select.POLLIN)
        while rest:
            left_s = self.until_s - time.monotonic()
            if left_s <= 0.0 or not waiting.poll(left_s * 1000.0):
                raise TimeoutError
            read = os.readv(self.descriptor, [rest])
            if not read:
                raise EOFError
            rest = rest[read:]
        return found
