"""Objects that are named by their content, and the files of attempts made of them.

```
objects/ab/abcd...                         content, named by its SHA-256
attempts/CAMPAIGN/CASE/DIGEST              files of an attempt: name -> object
attempts/CAMPAIGN/CASE/TOKEN               the same, of one that failed before its first tick
results/WORKER/SEQ-DIGEST                  sealed results of one request of a worker
```

`DIGEST` of an attempt is the digest of its manifest, which its commit names too. So nothing is
written twice with different contents, and no write needs a condition.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import msgspec
from msgspec import Struct

from schemas import SCHEMA_VERSION
from schemas.files.judging import RECORD_FILE, attempt_digest
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Result, Sealed
from twin.base.errors import InfrastructureError
from twin.stores.protocol import DamagedObjectError, ResultStore

OBJECT_BYTES_MAX = 1 << 30
"""Largest file of an attempt that a store takes, or that is read back [bytes]."""
INDEX_BYTES_MAX = 1 << 16
"""Largest list of an attempt's files [bytes]."""
PACK_BYTES_MAX = 1 << 26
"""Largest pack of sealed results [bytes]."""

FILES = ("kpi.parquet", "log.txt", "judge.json", "interventions.jsonl", "realtime.csv")
"""Files of an attempt that a store is given when it is committed."""

_DIGEST = re.compile(r"[0-9a-f]{64}")
EMPTY = hashlib.sha256(b"").hexdigest()
"""Name of the content of an empty file, for which there is no object."""


class LostFilesError(InfrastructureError):
    """Files of an attempt are gone before they were put: its result must not be committed."""


class StoredFile(Struct, frozen=True):
    """One file of an attempt."""

    sha256: str
    size: int
    """Length [bytes]."""


class StoredAttempt(Struct, frozen=True):
    """Files of one attempt."""

    campaign: str
    case: str
    attempt: int
    token: int
    files: dict[str, StoredFile]
    v: int = SCHEMA_VERSION


class ResultPack(Struct, frozen=True):
    """Results that a worker has put before it committed them."""

    results: list[Sealed]
    v: int = SCHEMA_VERSION


def sha256_of(data: bytes) -> str:
    """Name of a content."""
    return hashlib.sha256(data).hexdigest()


def object_name(sha256: str) -> str:
    """Name of the object with this content.

    Raises:
        DamagedObjectError: it is no digest.
    """
    if not _DIGEST.fullmatch(sha256):
        raise DamagedObjectError("a digest in the store has not 64 hexadecimal digits")
    return f"objects/{sha256[:2]}/{sha256}"


def put_object(store: ResultStore, data: bytes) -> str:
    """Put a content; its digest."""
    sha256 = sha256_of(data)
    if data:
        store.put(object_name(sha256), data)
    return sha256


def get_object(store: ResultStore, sha256: str, size_max: int = OBJECT_BYTES_MAX) -> bytes:
    """The content with this digest, whoever wrote it.

    Raises:
        DamagedObjectError: what is there is another content, or larger.
        StoreError: it is not there, or the store does not answer.
    """
    name = object_name(sha256)
    data = b"" if sha256 == EMPTY else store.get(name, size_max)
    if sha256_of(data) != sha256:
        raise DamagedObjectError(f"{store.url}/{name}: its content is another one than its name")
    return data


def mark_of(result: Result) -> str:
    """What names an attempt among those of its case."""
    return result.manifest_sha256 or str(result.token)


def attempt_name(campaign: str, case: str, mark: str) -> str:
    """Name of the list of an attempt's files."""
    return f"attempts/{campaign}/{case}/{mark}"


def put_attempt(store: ResultStore, folder: Path, result: Result, attempt: int) -> None:
    """Put what ``folder`` has of the files of an attempt, then their list.

    Raises:
        OSError: a file cannot be read.
        LostFilesError: they are not the ones of the result: nobody could use them.
        StoreError: the store does not answer.
    """
    files = {}
    proofs = dict.fromkeys(("log.txt", RECORD_FILE), b"")
    for name in FILES:
        path = folder / name
        if path.is_file() and not path.is_symlink():
            data = path.read_bytes()
            files[name] = StoredFile(put_object(store, data), len(data))
            if name in proofs:
                proofs[name] = data
    digest = attempt_digest(result.kpi_sha256, proofs["log.txt"], proofs[RECORD_FILE])
    if result.manifest_sha256 and (
        digest != result.manifest_sha256 or (result.kpi_sha256 and "kpi.parquet" not in files)
    ):
        raise LostFilesError(
            f"{folder}: files are missing or changed since case {result.case} has ended; it runs "
            "again; look who removes them"
        )
    stored = StoredAttempt(result.campaign, result.case, attempt, result.token, files)
    name = attempt_name(result.campaign, result.case, mark_of(result))
    store.put(name, msgspec.json.encode(stored) + b"\n")


def get_attempt(store: ResultStore, campaign: str, case: str, mark: str) -> StoredAttempt:
    """The list of an attempt's files.

    Raises:
        DamagedObjectError: it is none, or of another attempt.
        StoreError: it is not there, or the store does not answer.
    """
    name = attempt_name(campaign, case, mark)
    try:
        stored = msgspec.json.decode(store.get(name, INDEX_BYTES_MAX), type=StoredAttempt)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        raise DamagedObjectError(f"{store.url}/{name}: no list of files") from None
    if (stored.campaign, stored.case) != (campaign, case):
        raise DamagedObjectError(f"{store.url}/{name}: of another case")
    return stored


def put_pack(store: ResultStore, worker: str, seq: int, sealed: list[Sealed]) -> None:
    """Put the results of one request of a worker."""
    data = encode(ResultPack(sealed))
    store.put(f"results/{worker}/{seq:012d}-{sha256_of(data)[:32]}", data)


def pack_of(name: str) -> tuple[str, int] | None:
    """Worker and number of the request whose results an object holds; None: it is no pack."""
    match = re.fullmatch(r"results/([^/]+)/([0-9]{12})-[0-9a-f]{32}", name)
    return (match[1], int(match[2])) if match else None


def get_pack(store: ResultStore, name: str) -> list[Sealed]:
    """The sealed results of a pack; nothing of one that is damaged.

    Raises:
        StoreError: it is not there, or the store does not answer.
    """
    data = store.get(name, PACK_BYTES_MAX)
    if not name.endswith(sha256_of(data)[:32]):
        return []
    try:
        pack: ResultPack = decode(data, ResultPack, PACK_BYTES_MAX)
    except WireError:
        return []
    return pack.results
