"""What comes from a result store: by whoever may write its bucket, and by somebody with the key."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import msgspec
from fuzz_target import Target

from conductor.core.state import Config
from conductor.journal.chain import Chain, image_digest, reply_digest
from conductor.journal.store import Journal, JournalError
from conductor.serve.engine import ConductorEngine
from conductor.stored.owner import StoreClaims
from conductor.stored.replica import (
    ImagePack,
    ReplicaHead,
    TailPart,
    head_name,
    marked_head,
    read_head,
)
from conductor.stored.seals import StoreSeal
from conductor.stored.successor import bring_back, bring_journal
from schemas.files.judging import attempt_digest
from schemas.wire.control import Result
from twin.base.errors import TwinError
from twin.stores.objects import attempt_name, get_attempt, get_pack, put_object, sha256_of
from twin.stores.protocol import DamagedObjectError, MissingObjectError

CASE = ("alpha", "repeat_0")
"""Campaign and case of the attempts that are read."""
MARK = attempt_digest("", b"a log\n", b"")


class MemoryStore:
    """A result store that is a mapping."""

    url = "memory"

    def __init__(self) -> None:
        self.objects: dict[str, bytes] = {}

    def put(self, name: str, data: bytes) -> None:
        """See :class:`twin.stores.protocol.ResultStore`."""
        self.objects[name] = data

    def create(self, name: str, data: bytes) -> bool:
        """See the protocol."""
        return self.objects.setdefault(name, data) == data

    def get(self, name: str, size_max: int = 1 << 26) -> bytes:
        """See the protocol."""
        if name not in self.objects:
            raise MissingObjectError(f"{name}: is not there")
        if len(self.objects[name]) > size_max:
            raise DamagedObjectError(f"{name}: more than {size_max} bytes")
        return self.objects[name]

    def names(self, prefix: str) -> list[str]:
        """See the protocol."""
        return sorted(name for name in self.objects if name.startswith(prefix))

    def delete(self, name: str) -> None:
        """See the protocol."""
        self.objects.pop(name, None)


def _owner(data: bytes) -> object:
    """A claim: its mark and content as they lie there, and a content whose mark fits."""
    store = MemoryStore()
    seal = StoreSeal(store, None)
    name = "owner/000001"
    store.put(name, seal.marked(name, data))
    claims = StoreClaims(store, seal)
    made = claims.read(1)
    claims.latest()
    return made


def _marked(data: bytes) -> object:
    """A record as somebody without the key writes it."""
    store = MemoryStore()
    store.put("owner/000001", data)
    return StoreSeal(store, None).read("owner/000001", 1 << 14)


def _head(data: bytes) -> object:
    """A head, with the mark of its owner; nothing that it names is there."""
    store = MemoryStore()
    seal = StoreSeal(store, None)
    store.put(head_name(1), seal.marked(head_name(1), data))
    head = read_head(store, seal, 1)
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        try:
            bring_journal(store, seal, 1, Path(folder))
        except MissingObjectError:
            pass
    return head


def _replica(kind: str) -> Callable[[bytes], object]:
    """An object of a journal, which a head with the mark of its owner names: it is written to a
    file, folded and served."""

    def run(data: bytes) -> object:
        store = MemoryStore()
        seal = StoreSeal(store, None)
        chain, data = _fitting(kind, data)
        digest = put_object(store, data)
        packs, tail = ([digest], []) if kind == "pack" else ([], [digest])
        head = ReplicaHead(claim=1, beat=1, packs=packs, base="", tail=tail, chain=chain)
        store.put(head_name(1), marked_head(seal, head))
        with tempfile.TemporaryDirectory(dir="/dev/shm") as name:
            folder = Path(name)
            bring_journal(store, seal, 1, folder)
            journal = Journal(folder)
            try:
                ConductorEngine(journal, Config(folder=str(folder)), 0)
            finally:
                journal.close()
        return digest

    return run


def _fitting(kind: str, data: bytes) -> tuple[Chain, bytes]:
    """The chain that fits an object, and the object with its links: only its owner could write
    it, and what he likes to write comes behind the chain."""
    chain = Chain()
    try:
        if kind == "pack":
            pack = msgspec.msgpack.decode(data, type=ImagePack)
            digests = {key: image_digest(image) for key, image in pack.images}
            return chain.snapshot(digests, 1.0), data
        part = msgspec.msgpack.decode(data, type=TailPart)
        rows = []
        for unix_s, fact, _ in part.facts:
            chain, (link,) = chain.facts([fact], unix_s)
            rows.append((unix_s, fact, link))
        for worker, seq, reply in part.replies:
            if reply:
                chain = chain.replied(b"", reply_digest(worker, seq, reply))
        return chain, msgspec.msgpack.encode(TailPart(rows, part.replies))
    except (msgspec.MsgspecError, UnicodeError, struct.error):
        return chain, data


def _attempt(data: bytes) -> object:
    """The list of an attempt's files, which are then brought back."""
    store = MemoryStore()
    store.put(attempt_name(*CASE, MARK), data)
    made = get_attempt(store, *CASE, MARK)
    result = Result(
        *CASE, 1, "verdict", "pass", attempt_dir="cases/a/attempt-1", manifest_sha256=MARK
    )
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        try:
            bring_back(store, Path(folder), result)
        except TwinError:
            pass
        assert not [path for path in Path(folder).rglob("*") if path.is_file()]
    return made


def _results(data: bytes) -> object:
    """Sealed results, under the name that fits them."""
    store = MemoryStore()
    name = f"results/w1/000000000001-{sha256_of(data)[:32]}"
    store.put(name, data)
    found = get_pack(store, name)
    if not found:
        raise DamagedObjectError("no results")
    return found


TARGETS = {
    "store-owner": Target(_owner, (TwinError,)),
    "store-mark": Target(_marked, (TwinError,)),
    "store-head": Target(_head, (TwinError,)),
    "store-pack": Target(_replica("pack"), (TwinError, JournalError), cost=10),
    "store-tail": Target(_replica("tail"), (TwinError, JournalError), cost=10),
    "store-attempt": Target(_attempt, (TwinError,)),
    "store-results": Target(_results, (TwinError,)),
}
"""Target by name."""
