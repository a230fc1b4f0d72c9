"""The file of one attempt's drive plane: what its stack saw, byte for byte, and what it answered.

A sequence of blocks, each a little-endian uint32 and as many bytes of MessagePack: one
:class:`RecordHead`, per tick a :class:`RecordSeen` and a :class:`RecordAnswer`, at last a
:class:`RecordEnd`. Every block is written before anything later happens, so a file that was cut off
is readable up to there.
"""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from schemas.case import Case
from schemas.messages import Command, Episode

DRIVE_FILE = "drive.record"
"""Name of the file in the folder of an attempt."""

FILE_BYTES_MAX = 2 << 30
"""Largest file; a longer attempt is cut off there [bytes]."""

BLOCK_BYTES_MAX = 1 << 30
"""Largest block [bytes]."""

Coding = Literal["raw", "zlib", "png"]
"""How an array's bytes are kept, all without loss. ``raw``: as they are, C order. ``zlib``: those
bytes, deflated. ``png``: pictures [H, W, 3] of uint8 as a PNG file of red, green, blue."""


class RecordHead(Struct, frozen=True, tag_field="block", tag="head"):
    """First block: which attempt it is."""

    v: int
    attempt: int
    software: str
    """Software digest of the simulator."""
    device_class: str
    slots: int
    """Slots of the rig; the file holds one of them."""
    case: Case


class RecordArray(Struct, frozen=True):
    """One sensor's array of this slot; the slot's axis is left out."""

    dtype: str
    """Type of the elements, little-endian, as NumPy writes it."""
    shape: list[int]
    coding: Coding
    data: bytes
    count: int = -1
    """Valid rows of ragged data; -1: all."""


class RecordSeen(Struct, frozen=True, tag_field="block", tag="seen"):
    """What was published for one tick of the case."""

    tick: int
    sim_time_ns: int
    sensors: dict[str, RecordArray]
    """Arrays in the order of the tick message."""
    episode: Episode | None = None
    """Episode message, with the first tick."""


class RecordAnswer(Struct, frozen=True, tag_field="block", tag="answer"):
    """The stack's own command for the tick before; an intervention changes it only later."""

    command: Command


class RecordEnd(Struct, frozen=True, tag_field="block", tag="end"):
    """Last block; a file without it was cut off."""

    ticks: int
    sha256: str
    """SHA-256 of all bytes before this block."""
    outcome: str = ""
    verdict: str = ""
    cut: str = ""
    """Why ticks are missing at the end; empty: the attempt is complete."""


RecordBlock = RecordHead | RecordSeen | RecordAnswer | RecordEnd
