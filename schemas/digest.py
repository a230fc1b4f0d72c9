"""SHA-256 of parts. It loads no section of the campaign, so that every command may have it."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable


def digest(parts: Iterable[bytes]) -> str:
    """SHA-256 over length-prefixed parts, hexadecimal."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(struct.pack("<Q", len(part)))
        sha.update(part)
    return sha.hexdigest()
