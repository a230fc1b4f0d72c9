"""What an integer network consists of.

A *map* is an int8 array [rows, columns, channels] per image; a step reads maps and makes the next
one, in the order of the network. Real numbers are multiplied in as ``(value * factor + half) >>
shift`` with a factor below 2^31, in int64: to the nearest, halves upwards. The shift of a negative
number rounds down (it is arithmetic).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import Meta, Struct

CHANNELS_MAX = 8192
"""Most channels of a map."""
LINE_MAX = 8192
"""Most rows or columns of a map."""
STEPS_MAX = 1000
"""Most steps of a network."""
MAP_MAX = 1 << 26
"""Most levels of all maps of an image together [bytes]."""
ROOM_MAX = 1 << 28
"""Most float32 of all kernels together, and of the rows that one convolution reads at once."""
PRODUCTS_MAX = 1 << 38
"""Most products of an image: some seconds of a core; YOLOv3 at 608x608 has 2^36."""

Index = Annotated[int, Meta(ge=0, le=STEPS_MAX)]
Level = Annotated[int, Meta(ge=-128, le=127)]
Factor = Annotated[int, Meta(ge=-(2**31) + 1, le=2**31 - 1)]
Shift = Annotated[int, Meta(ge=1, le=62)]
Size = Annotated[int, Meta(ge=1, le=32)]
Pad = Annotated[int, Meta(ge=0, le=32)]
Channels = Annotated[int, Meta(ge=1, le=CHANNELS_MAX)]


class Windows(Struct, frozen=True, forbid_unknown_fields=True):
    """How windows go over a map."""

    size: Size
    """Rows and columns of a window."""
    stride: Size
    """Rows and columns from one window to the next."""
    pads: tuple[Pad, Pad, Pad, Pad]
    """Rows above, columns to the left, rows below, columns to the right of the map."""

    def lines(self, rows: int, columns: int) -> tuple[int, int]:
        """Rows and columns of windows over a map of such a size; below 1: none fits."""
        top, left, bottom, right = self.pads
        down = (rows + top + bottom - self.size) // self.stride + 1
        return down, (columns + left + right - self.size) // self.stride + 1


class IntegerConvolution(
    Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="convolution"
):
    """Sums of products, and a factor by sign: none, ReLU or leaky ReLU.

    Beyond the border the map has its zero, whose part of every sum is in the biases.
    """

    given: Index
    """The map that is read; 0 is the picture."""
    windows: Windows
    outs: Channels
    kernels: bytes
    """int8 [outs, size, size, channels], -127 to 127."""
    biases: bytes
    """int32 [outs], little endian."""
    positive: bytes
    """int32 [outs]: factors of sums from 0 up."""
    negative: bytes
    """int32 [outs]: factors of sums below 0."""
    shifts: bytes
    """int8 [outs]: 1 to 62."""
    zero: Level


class IntegerHead(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="head"):
    """A convolution whose sums are an output: sum times scale, as float32."""

    given: Index
    windows: Windows
    outs: Channels
    kernels: bytes
    biases: bytes
    scales: bytes
    """float64 [outs], little endian."""
    output: Annotated[str, Meta(min_length=1, max_length=1000)]


class IntegerPool(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="pool"):
    """The largest level of every window; what lies beyond the border does not count."""

    given: Index
    windows: Windows


class IntegerSum(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="sum"):
    """Two maps of one shape: ``zero + round((a - zero_a) factor_a + (b - zero_b) factor_b)``."""

    first: Index
    second: Index
    factors: tuple[Factor, Factor]
    shift: Shift
    zero: Level


class JoinPart(Struct, frozen=True, forbid_unknown_fields=True):
    """Channels of a joined map, from another map."""

    given: Index
    factor: Factor
    shift: Shift
    """The level is ``zero + round((given - its zero) factor)``."""
    repeat: Size = 1
    """Every pixel becomes so many rows and columns."""
    fold: Size = 1
    """Every so many rows and columns become channels, as in Darknet's reorg."""


class IntegerJoin(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="join"):
    """Maps beside each other, channel after channel."""

    parts: Annotated[list[JoinPart], Meta(min_length=1, max_length=16)]
    zero: Level


Step = IntegerConvolution | IntegerHead | IntegerPool | IntegerSum | IntegerJoin


def given_of(step: Step) -> Sequence[int]:
    """Maps that a step reads."""
    if isinstance(step, IntegerSum):
        return step.first, step.second
    if isinstance(step, IntegerJoin):
        return [part.given for part in step.parts]
    return (step.given,)


class IntegerNetwork(Struct, frozen=True, forbid_unknown_fields=True):
    """A network and what it was made of. Map 0 is the picture: its levels less 128, three
    channels; map n is what step n - 1 makes."""

    description: Annotated[str, Meta(max_length=1 << 20)]
    """Of the detector, JSON: :class:`devkit.detector.description.DetectorDescription`."""
    origin: Annotated[str, Meta(max_length=1000)]
    """What it was made of and how, for people."""
    steps: Annotated[list[Step], Meta(min_length=1, max_length=STEPS_MAX)]
    format: Literal["drivetwin integer network"] = "drivetwin integer network"
    v: Literal[1] = 1
