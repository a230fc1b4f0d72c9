"""Records that only a conductor of the same key can write: a store is open to whoever may write it.

The mark is HMAC-SHA256 with a key made from the conductor's private key, over the record's name and
content; so a record counts at its own place only.
"""

from __future__ import annotations

import hashlib
import hmac

from twin.base.errors import UsageError
from twin.fabric.keys.key_file import MemberKey
from twin.stores.protocol import DamagedObjectError, ResultStore

_CONTEXT = b"drivetwin store\0"
_MARK_CHARS = 64


class OtherKeyError(UsageError):
    """A record in the store was written with another key, or was changed."""


class StoreSeal:
    """Writes and reads marked records of one store.

    Args:
        store: the store.
        key: the conductor's key; None: plain TCP, where everybody may be the conductor.
    """

    def __init__(self, store: ResultStore, key: MemberKey | None) -> None:
        private = key.private if key is not None else b""
        self._secret = hashlib.sha256(_CONTEXT + private).digest()
        self._store = store

    def marked(self, name: str, content: bytes) -> bytes:
        """The record as it is written."""
        return self._mark(name, content) + b"\n" + content

    def read(self, name: str, size_max: int) -> bytes:
        """Content of a record.

        Raises:
            OtherKeyError: it was written with another key, or changed.
            DamagedObjectError: it is no record.
            StoreError: it is not there, or the store does not answer.
        """
        data = self._store.get(name, size_max)
        mark, content = data[:_MARK_CHARS], data[_MARK_CHARS + 1 :]
        if len(mark) < _MARK_CHARS or data[_MARK_CHARS : _MARK_CHARS + 1] != b"\n":
            raise DamagedObjectError(f"{self._store.url}/{name}: damaged")
        if not hmac.compare_digest(mark, self._mark(name, content)):
            raise OtherKeyError(
                f"{self._store.url}/{name}: written by a conductor with another key, or changed by "
                "somebody; give --key of the conductor that wrote it, or another --store"
            )
        return content

    def _mark(self, name: str, content: bytes) -> bytes:
        signed = name.encode() + b"\0" + content
        return hmac.new(self._secret, signed, hashlib.sha256).hexdigest().encode()
