"""Shapes and zeros of an integer network's maps, and everything that can be wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from devkit.detector.description import DetectorDescription
from devkit.detector.integer.steps import (
    CHANNELS_MAX,
    LINE_MAX,
    MAP_MAX,
    PRODUCTS_MAX,
    ROOM_MAX,
    IntegerConvolution,
    IntegerHead,
    IntegerNetwork,
    IntegerPool,
    IntegerSum,
    JoinPart,
    Step,
    given_of,
)

LEVEL_MAX = 128
"""Largest magnitude of a level."""

PIXELS_CPU = 12
"""Most neighbouring pixels that a CPU computes together."""
LANES = 16
"""Channels that a CPU computes together."""
BAND_ROWS = 8
"""Most rows of a CPU's thread."""


@dataclass(frozen=True, slots=True)
class LevelShape:
    """Shape of a map of one image; of a head: of its output."""

    rows: int
    columns: int
    channels: int
    zero: int
    """Level of the real number 0."""
    head: bool = False
    """It holds sums, which no step reads."""

    @property
    def stored(self) -> int:
        """Channels in memory: four of them are a word."""
        return -(-self.channels // 4) * 4

    @property
    def stored_shape(self) -> tuple[int, int, int]:
        """Rows, columns and channels in memory."""
        return self.rows, self.columns, self.stored


def map_shapes(network: IntegerNetwork, description: DetectorDescription) -> list[LevelShape]:
    """Shapes of all maps, with everything checked that a kernel relies on.

    Raises:
        ValueError: the network would read or write beside its maps, or overflow; one line.
    """
    shapes = [LevelShape(description.height, description.width, 3, -128)]
    for number, step in enumerate(network.steps, 1):
        try:
            given = []
            for index in given_of(step):
                if index >= number or shapes[index].head:
                    raise ValueError(f"reads map {index}, which is not made before it")
                given.append(shapes[index])
            shape = _made(step, given)
            _check_size(shape)
        except ValueError as error:
            raise ValueError(f"step {number}: {error}") from None
        shapes.append(shape)
    total = sum(s.rows * s.columns * s.stored * (4 if s.head else 1) for s in shapes)
    if total > MAP_MAX:
        raise ValueError(f"its maps have {total} levels per image, allowed: {MAP_MAX}")
    _check_room(network, shapes)
    return shapes


def _check_room(network: IntegerNetwork, shapes: list[LevelShape]) -> None:
    """A small file must not take a large memory, nor long."""
    numbers, room, products = 0, 0, 0
    for number, step in enumerate(network.steps, 1):
        if isinstance(step, IntegerConvolution | IntegerHead):
            given, made = shapes[step.given], shapes[number]
            kernels = -(-step.outs // LANES) * LANES * step.windows.size**2 * given.stored
            numbers += kernels
            products += kernels * made.rows * made.columns
            room = max(room, room_floats(step, given, made))
    if max(numbers, room) > ROOM_MAX:
        raise ValueError(f"its kernels need {max(numbers, room)} numbers, allowed: {ROOM_MAX}")
    if products > PRODUCTS_MAX:
        raise ValueError(f"it has {products} products per image, allowed: {PRODUCTS_MAX}")


def room_floats(step: IntegerConvolution | IntegerHead, given: LevelShape, made: LevelShape) -> int:
    """Numbers that a CPU's thread needs room for."""
    size, stride = step.windows.size, step.windows.stride
    across = -(-made.columns // PIXELS_CPU) * PIXELS_CPU
    rows = (min(BAND_ROWS, made.rows) - 1) * stride + size
    return rows * ((across - 1) * stride + size) * given.stored


def _check_size(shape: LevelShape) -> None:
    fits = min(shape.rows, shape.columns) >= 1 and max(shape.rows, shape.columns) <= LINE_MAX
    if not fits or shape.channels > CHANNELS_MAX:
        raise ValueError(
            f"makes a map of {shape.rows}x{shape.columns}, {shape.channels} channels;"
            f" allowed: 1 to {LINE_MAX} rows and columns, {CHANNELS_MAX} channels"
        )


def _made(step: Step, given: list[LevelShape]) -> LevelShape:
    first = given[0]
    if isinstance(step, IntegerConvolution | IntegerHead):
        rows, columns = step.windows.lines(first.rows, first.columns)
        _check_sums(step, first.channels)
        if isinstance(step, IntegerHead):
            return LevelShape(rows, columns, step.outs, 0, head=True)
        return LevelShape(rows, columns, step.outs, step.zero)
    if isinstance(step, IntegerPool):
        if max(step.windows.pads) >= step.windows.size:
            raise ValueError(f"pads {list(step.windows.pads)} hold whole windows")
        rows, columns = step.windows.lines(first.rows, first.columns)
        return LevelShape(rows, columns, first.channels, first.zero)
    if isinstance(step, IntegerSum):
        second = given[1]
        one, other = ((s.rows, s.columns, s.channels) for s in (first, second))
        if one != other:
            raise ValueError(f"adds maps of {list(one)} and {list(other)}")
        return LevelShape(*one, step.zero)
    parts = [_part_shape(part, shape) for part, shape in zip(step.parts, given, strict=True)]
    sizes = {(rows, columns) for rows, columns, _ in parts}
    if len(sizes) != 1:
        raise ValueError(f"joins maps of {sorted(sizes)}")
    rows, columns = sizes.pop()
    return LevelShape(rows, columns, sum(channels for _, _, channels in parts), step.zero)


def _part_shape(part: JoinPart, given: LevelShape) -> tuple[int, int, int]:
    """Rows, columns and channels of a part."""
    fold = part.fold
    if given.rows % fold or given.columns % fold or given.channels % (fold * fold):
        raise ValueError(f"folds {fold}x{fold} of {given.rows}x{given.columns}x{given.channels}")
    rows, columns = given.rows // fold * part.repeat, given.columns // fold * part.repeat
    return rows, columns, given.channels * fold * fold


def _check_sums(step: IntegerConvolution | IntegerHead, channels: int) -> None:
    """Sums must fit into 32 bits whatever the map holds."""
    if max(step.windows.pads) >= step.windows.size:
        raise ValueError(f"pads {list(step.windows.pads)} hold whole windows")
    needed = step.outs * step.windows.size**2 * channels
    lengths = {"kernels": needed, "biases": 4 * step.outs}
    if isinstance(step, IntegerConvolution):
        lengths |= {"positive": 4 * step.outs, "negative": 4 * step.outs, "shifts": step.outs}
    else:
        lengths["scales"] = 8 * step.outs
    for name, length in lengths.items():
        if len(getattr(step, name)) != length:
            raise ValueError(f"{name}: {len(getattr(step, name))} bytes, expected {length}")
    kernels = np.frombuffer(step.kernels, np.int8).reshape(step.outs, -1)
    biases = np.frombuffer(step.biases, "<i4").astype(np.int64)
    if kernels.min() < -127:
        raise ValueError("kernels: -128, allowed: -127 to 127")
    if (np.abs(kernels.astype(np.int64)).sum(axis=1) * LEVEL_MAX + np.abs(biases)).max() >= 2**31:
        raise ValueError("its sums may exceed 32 bits")
    if isinstance(step, IntegerHead):
        if not np.isfinite(np.frombuffer(step.scales, "<f8")).all():
            raise ValueError("scales: not finite")
        return
    shifts = np.frombuffer(step.shifts, np.int8)
    if shifts.min() < 1 or shifts.max() > 62:
        raise ValueError(f"shifts: {shifts.min()} to {shifts.max()}, allowed: 1 to 62")
    for name in ("positive", "negative"):
        if np.frombuffer(getattr(step, name), "<i4").min() < 0:
            raise ValueError(f"{name}: below 0")
