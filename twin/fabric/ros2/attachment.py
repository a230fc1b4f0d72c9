"""What every message of rmw_zenoh carries beside its payload. Pure.

A sequence number, the time of sending and the sender's identifier, in the format that rmw_zenoh's
design page gives: int64, int64 and an array of 16 bytes with its length before it, little endian,
33 bytes in all. Packages of Jazzy before rmw_zenoh 0.2.4 (April 2025) put names between the fields;
they are recognised and refused.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

GID_BYTES = 16
"""Length of an identifier [bytes]."""

_LAYOUT = struct.Struct("<qqB16s")
_OLD = b"\x0fsequence_number"


class AttachmentError(ValueError):
    """Bytes that are no attachment of these releases; one line."""


@dataclass(frozen=True, slots=True)
class Attachment:
    """What is sent with a message."""

    sequence: int
    """Counts the messages of a publisher, or the requests of a client; from 1."""
    stamp_ns: int
    """When it was sent [ns]. Ours is sim time; that of a node is its wall clock, and nobody here
    looks at it."""
    gid: bytes
    """Identifier of the publisher or client, 16 bytes."""

    def encoded(self) -> bytes:
        """The 33 bytes."""
        return _LAYOUT.pack(self.sequence, self.stamp_ns, GID_BYTES, self.gid)


def parse_attachment(data: bytes) -> Attachment:
    """What came with a message.

    Raises:
        AttachmentError: it is none; one line.
    """
    if data.startswith(_OLD):
        raise AttachmentError(
            "its attachment has the names of rmw_zenoh before 0.2.4; update ROS 2 Jazzy's packages"
        )
    if len(data) != _LAYOUT.size:
        raise AttachmentError(f"its attachment has {len(data)} bytes, expected {_LAYOUT.size}")
    sequence, stamp_ns, length, gid = _LAYOUT.unpack(data)
    if length != GID_BYTES:
        raise AttachmentError(f"its attachment has an identifier of {length} bytes, expected 16")
    return Attachment(sequence, stamp_ns, gid)
