"""The hash chain of a journal: what is in it, in this order, and nothing else.

Every fact is a link: SHA-256 over the head before it, its kind, the time it was written and its
bytes. A snapshot is a link, too, over the digest of all images; facts before it are deleted, so the
journal keeps what the chain goes on from (:class:`Cut`). Replies replace each other and cannot be
links; the sum of their digests stands beside the head.

The chain is no secret: whoever can write the file can compute it anew. What makes it evidence is
the signature over its head (:mod:`conductor.trust.manifest`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256

from msgspec import Struct

BEGIN = sha256(b"drivetwin journal").digest()
"""Head of a journal without facts."""

_SUM_BYTES = 32
_MODULUS = 1 << (8 * _SUM_BYTES)


class Cut(Struct, frozen=True):
    """The latest snapshot, as a link of the chain."""

    before: bytes
    """Head before the cut."""
    count: int
    """Links so far, with it."""
    unix_s: float


class Chain(Struct, frozen=True):
    """Where a journal stands."""

    head: bytes = BEGIN
    count: int = 0
    """Links so far, also those that a snapshot has replaced."""
    replies: bytes = bytes(_SUM_BYTES)
    """Sum of the digests of the replies that are kept."""
    cut: Cut | None = None
    """Latest snapshot; None: there was none yet."""

    def facts(self, facts: Sequence[bytes], unix_s: float) -> tuple[Chain, list[bytes]]:
        """Chain after these facts, in this order; and the head after each of them."""
        heads = []
        head = self.head
        when = _when(b"f", unix_s)
        for data in facts:
            head = _link(head, when, data)
            heads.append(head)
        return Chain(head, self.count + len(heads), self.replies, self.cut), heads

    def snapshot(self, images: Mapping[str, bytes], unix_s: float) -> Chain:
        """Chain after a snapshot; ``images`` are the digests of all its images by key."""
        cut = Cut(self.head, self.count + 1, unix_s)
        return Chain(cut_head(cut, images), cut.count, self.replies, cut)

    def replied(self, old: bytes, new: bytes) -> Chain:
        """Chain after a reply with the digest ``new`` has replaced ``old``; empty: there is
        none."""
        total = int.from_bytes(self.replies) - int.from_bytes(old) + int.from_bytes(new)
        return Chain(self.head, self.count, _packed(total), self.cut)


def cut_head(cut: Cut, images: Mapping[str, bytes]) -> bytes:
    """Head after a snapshot of ``images``, digests by key."""
    sha = sha256()
    for key in sorted(images):
        data = key.encode("utf-8", "surrogateescape")
        sha.update(struct.pack("<Q", len(data)) + data + images[key])
    return _link(cut.before, _when(b"s", cut.unix_s), sha.digest())


def image_digest(data: bytes) -> bytes:
    """SHA-256 of one image of a snapshot."""
    return sha256(data).digest()


def reply_digest(worker: str, seq: int, data: bytes) -> bytes:
    """SHA-256 of a row of replies."""
    name = worker.encode("utf-8", "surrogateescape")
    return sha256(struct.pack("<Qq", len(name), seq) + name + data).digest()


def reply_sum(digests: Iterable[bytes]) -> bytes:
    """Sum of the digests of these rows, as in :attr:`Chain.replies`."""
    return _packed(sum(map(int.from_bytes, digests)))


def fact_link(head: bytes, data: bytes, unix_s: float) -> bytes:
    """Head after a fact with these bytes."""
    return _link(head, _when(b"f", unix_s), data)


def _when(kind: bytes, unix_s: float) -> bytes:
    return kind + struct.pack("<d", unix_s)


def _link(head: bytes, when: bytes, data: bytes) -> bytes:
    sha = sha256(head + when)
    sha.update(data)
    return sha.digest()


def _packed(total: int) -> bytes:
    return (total % _MODULUS).to_bytes(_SUM_BYTES)
