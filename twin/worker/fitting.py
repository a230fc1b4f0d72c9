"""How many slots a rig gets on a GPU, before it starts."""

from __future__ import annotations

import msgspec

from schemas.campaign import Case
from twin.base.gpu.slot_count import MemoryCount

GPU_SLOTS = 128
"""Slots of a worker on a GPU unless the user says otherwise, where they fit: with more it gets
little faster, and other workers get less to do."""


def fitting(device: str, slots: int, case: Case) -> int:
    """At most ``slots``, and no more than fit into what is free on ``device``."""
    options = ("--case", "-", "--slots", str(slots), "--device", device)
    fits = MemoryCount(msgspec.json.encode(case), options).slots()
    return slots if fits is None else min(slots, fits)
