"""The rows of a certificate, and the leaves of the tree over them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection
from typing import Annotated

from msgspec import Meta, Struct

from conductor.certify.merkle import leaf_hash
from schemas.campaign import ID_CHARS_MAX

TEXT_CHARS_MAX = 1000
"""Longest text in a certificate's head or row [characters]."""
ENTRIES_MAX = 1000
"""Most entries of a list or mapping in a certificate's head."""

Sha = Annotated[str, Meta(pattern="^[0-9a-f]{64}\\Z")]
OptionalSha = Annotated[str, Meta(pattern="^([0-9a-f]{64})?\\Z")]
Text = Annotated[str, Meta(max_length=TEXT_CHARS_MAX)]


class Row(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What is said of one case."""

    case: Annotated[str, Meta(min_length=1, max_length=ID_CHARS_MAX)]
    outcome: Text
    """Outcome, with verdict: ``verdict/pass``."""
    kpi: OptionalSha
    """SHA-256 over the KPI values; empty: there are none."""
    device: Annotated[int, Meta(ge=-1, lt=ENTRIES_MAX)]
    """Place of its device class in the head's `made_in.device_classes`; -1: it has none."""

    @property
    def has_result(self) -> bool:
        """Whether the case came to something that running it again must come to, too."""
        return self.outcome.partition("/")[0] in ("verdict", "failed")


def leaf_of(row: Row, device_class: str) -> bytes:
    """Hash of a row's leaf: case, outcome, the 32 bytes of the KPI digest (or none) and device
    class, each after its length as 64 bits, little-endian."""
    parts = (row.case.encode(), row.outcome.encode(), bytes.fromhex(row.kpi), device_class.encode())
    return leaf_hash(b"".join(struct.pack("<Q", len(part)) + part for part in parts))


def leaves_of(rows: Collection[Row], device_classes: list[str]) -> list[bytes]:
    """Leaves of all rows, in their order."""
    return [leaf_of(row, device_classes[row.device] if row.device >= 0 else "") for row in rows]


def counts_of(rows: Collection[Row]) -> dict[str, int]:
    """Number of rows by outcome."""
    return dict(sorted(Counter(row.outcome for row in rows).items()))
