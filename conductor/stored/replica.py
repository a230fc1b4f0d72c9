"""The replica of a journal in a store: what it is made of, and how it is read back.

```
journal/000002/head     marked record: which objects make the journal, and where its chain stands
objects/ab/abcd...      packs of a snapshot's images, replies, and parts of the tail
```

Every object but the head is named by its content. Only the owner of a claim writes its head, so
the head needs no condition; the order of its writes and of the look for a successor decides what a
successor sees (:mod:`conductor.stored.replicator`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

import msgspec
from msgspec import Struct

from conductor.journal.chain import Chain
from conductor.journal.written import JournalPart, Reply, Row
from conductor.stored.seals import StoreSeal
from twin.stores.apart import put_content
from twin.stores.objects import get_object
from twin.stores.protocol import DamagedObjectError, MissingObjectError, ResultStore

HEAD_BYTES_MAX = 1 << 24
"""Largest head of a replica [bytes]."""
PART_BYTES_MAX = 1 << 30
"""Largest object of a replica [bytes]."""
PIECE_BYTES = 1 << 20
"""An object of a replica becomes about as large, unless a single fact is larger [bytes]."""
AHEAD = 4
"""Objects of a replica that are fetched while earlier ones are written."""

S = TypeVar("S", bound=Struct)


class ImagePack(Struct, frozen=True, array_like=True):
    """Images of a snapshot; later packs replace those of earlier ones by their keys."""

    images: list[tuple[str, bytes]]


class TailPart(Struct, frozen=True, array_like=True):
    """What was written after the snapshot, a part of it."""

    facts: list[Row]
    replies: list[Reply]


class ReplicaHead(Struct, frozen=True, kw_only=True):
    """Where a journal stands in the store."""

    claim: int
    beat: int
    """Counts the writes: while it grows, its owner lives."""
    packs: list[str]
    """Digests of :class:`ImagePack` objects, in order."""
    base: str
    """Digest of a :class:`TailPart` with the replies at the snapshot; empty: none."""
    tail: list[str]
    """Digests of :class:`TailPart` objects, in order."""
    chain: Chain
    released: bool = False
    """Whether its owner has ended in good order."""

    @property
    def objects(self) -> set[str]:
        """Digests of all objects that make it."""
        return {*self.packs, *self.tail, self.base} - {""}


def head_name(claim: int) -> str:
    """Name of a claim's head."""
    return f"journal/{claim:06d}/head"


def marked_head(seal: StoreSeal, head: ReplicaHead) -> bytes:
    """A head as it is written."""
    return seal.marked(head_name(head.claim), msgspec.msgpack.encode(head))


def read_head(store: ResultStore, seal: StoreSeal, claim: int) -> ReplicaHead | None:
    """The head of a claim; None: its owner has not written one.

    Raises:
        TwinError: it cannot be believed, or the store does not answer.
    """
    name = head_name(claim)
    try:
        content = seal.read(name, HEAD_BYTES_MAX)
        head = msgspec.msgpack.decode(content, type=ReplicaHead)
    except MissingObjectError:
        return None
    except (msgspec.MsgspecError, UnicodeDecodeError):
        raise DamagedObjectError(f"{store.url}/{name}: damaged") from None
    if head.claim != claim:
        raise DamagedObjectError(f"{store.url}/{name}: of another claim")
    return head


def put_pack_of(store: ResultStore, images: list[tuple[str, bytes]]) -> str:
    """Put images; their digest."""
    return put_content(store, msgspec.msgpack.encode(ImagePack(images)))


def put_part(store: ResultStore, facts: list[Row], replies: Sequence[Reply]) -> str:
    """Put a part of the tail; its digest."""
    return put_content(store, msgspec.msgpack.encode(TailPart(facts, list(replies))))


def merged_part(store: ResultStore, digests: Sequence[str]) -> str:
    """One part instead of several that follow each other; its digest."""
    facts: list[Row] = []
    replies: dict[str, Reply] = {}
    for digest in digests:
        part = _read(store, digest, TailPart)
        facts += part.facts
        # A reply that was forgotten stays named, for the parts before the merged ones.
        replies.update((reply[0], reply) for reply in part.replies)
    return put_part(store, facts, list(replies.values()))


def read_replica(store: ResultStore, head: ReplicaHead) -> Iterator[JournalPart]:
    """All of the journal that ``head`` stands for, an object at a time.

    Raises:
        TwinError: an object is missing or damaged, or the store does not answer.
    """

    def read(named: tuple[str, bool]) -> JournalPart:
        digest, is_pack = named
        if is_pack:
            return JournalPart(images=_read(store, digest, ImagePack).images)
        part = _read(store, digest, TailPart)
        return JournalPart(part.facts, [], part.replies)

    tail = [head.base] * bool(head.base) + head.tail
    names = iter([(digest, True) for digest in head.packs] + [(digest, False) for digest in tail])
    with ThreadPoolExecutor(AHEAD) as pool:
        coming = [pool.submit(read, name) for name in islice(names, AHEAD)]
        while coming:
            part = coming.pop(0).result()
            coming += [pool.submit(read, name) for name in islice(names, 1)]
            yield part


def _read(store: ResultStore, digest: str, type_: type[S]) -> S:
    try:
        return msgspec.msgpack.decode(get_object(store, digest, PART_BYTES_MAX), type=type_)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        raise DamagedObjectError(f"{store.url}: object {digest} is no part of a journal") from None
