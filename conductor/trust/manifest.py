"""``manifest.json``: what belongs to a finished run, signed by who ran it.

Two manifests stand in a run folder. ``manifest.json`` lists everything that was there when the run
ended, and where its journal stood. ``manifest.derived.json`` lists what reports make of it, which
may be made again at any time (:data:`DERIVED`); it names the manifest that it belongs to.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from conductor.journal.store import FILE_NAME as JOURNAL_FILE
from conductor.trust.signing import Signer, fits
from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.files.resources import PARTS_FOLDER
from schemas.files.rulebook_result import FILE_NAME as RULEBOOK_FILE
from twin.base.errors import InfrastructureError, storage_error
from twin.base.files import write_atomic
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.keys.revoked import FILE_NAME as REVOKED_FILE

RUN_FILE, DERIVED_FILE = "manifest.json", "manifest.derived.json"
BEFORE_FILE = "manifest.before.json"
"""The manifest of a finished run that a conductor has opened again."""
MANIFEST_BYTES_MAX = 1 << 30

DERIVED = frozenset(
    {
        *("report.html", "summary.csv", "summary.parquet", "resources.parquet"),
        *(RULEBOOK_FILE, "plots", "films", ".report"),
    }
)
"""Files and folders in a run folder that are made of the others, by their first name."""
PASSING = frozenset(
    {
        *(RUN_FILE, DERIVED_FILE, BEFORE_FILE, CONDUCTOR_FILE),
        *("conductor.owner", "store.id"),
        *("keys", REVOKED_FILE, "rigs", "spool", PARTS_FOLDER),
    }
)
"""What belongs to a conductor or worker that serves, and to no result. What workers measure counts
when a report has gathered it."""

_SIGNED = b"drivetwin manifest 1\0"
_CHUNK = 64
"""Files that a thread takes at a time."""
_READ_BYTES = 1 << 20


class JournalSum(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the journal stood when the run was signed."""

    file: Literal["conductor.db", "../conductor.db"]
    """Path relative to the run folder."""
    head: str
    """Head of its chain, hexadecimal."""
    count: int
    """Links of the chain."""


class Manifest(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of a manifest; see the module."""

    schema: Literal[1] = 1
    kind: Literal["run", "derived"]
    of: str = ""
    """Signature of the run's manifest, in a derived one."""
    campaign: str = ""
    digest: str = ""
    """Digest of the campaign."""
    fingerprint: str = ""
    journal: JournalSum | None = None
    key: str
    """Public key of who has signed it, hexadecimal."""
    files: dict[str, str]
    """Path, relative to the run folder -> SHA-256 and size [bytes], as in ``ab12... 4711``."""
    signature: str = ""


def signed(manifest: Manifest, signer: Signer) -> Manifest:
    """Manifest with its key and signature."""
    bare = msgspec.structs.replace(manifest, key=signer.public, signature="")
    return msgspec.structs.replace(bare, signature=signer.sign(_bytes_to_sign(bare)))


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write it atomically into the run folder.

    Raises:
        TwinError: the folder cannot be written.
    """
    path = folder / _name(manifest.kind)
    try:
        write_atomic(path, _encode(manifest))
    except OSError as error:
        raise storage_error(error, str(path)) from None


def read_manifest(folder: Path, kind: Literal["run", "derived"] = "run") -> Manifest | None:
    """The manifest of a run folder, whose signature fits the key it names; None: it has none.

    Whether that key is to be trusted is another question.

    Raises:
        InfrastructureError: it is damaged or changed.
    """
    return read_manifest_file(folder / _name(kind), kind)


def read_manifest_file(path: Path, kind: Literal["run", "derived"] = "run") -> Manifest | None:
    """See :func:`read_manifest`."""
    if path.is_symlink():
        raise InfrastructureError(f"{path} is a symbolic link; put the file there")
    try:
        data = read_regular(path, MANIFEST_BYTES_MAX)
        manifest: Manifest = decode_json(data, Manifest)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InfrastructureError(f"{path}: {error.strerror or error}") from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}; restore it") from None
    bare = msgspec.structs.replace(manifest, signature="")
    # Compared byte by byte: what a reader would skip is changed, too.
    if (
        manifest.kind != kind
        or data != _encode(manifest)
        or not fits(manifest.key, manifest.signature, _bytes_to_sign(bare))
    ):
        raise InfrastructureError(
            f"{path}: the signature does not fit: it was changed after it was signed; restore it"
        )
    return manifest


def entries(folder: Path) -> Iterator[tuple[str, os.DirEntry[str]]]:
    """Everything in a run folder but folders and what is :data:`PASSING`: relative path and entry;
    links are not followed.

    Raises:
        OSError: a folder cannot be read.
    """
    for entry in os.scandir(folder):
        if entry.name not in PASSING:
            yield from _below(entry, entry.name)


def _below(entry: os.DirEntry[str], name: str) -> Iterator[tuple[str, os.DirEntry[str]]]:
    if entry.is_dir(follow_symlinks=False):
        for inner in os.scandir(entry.path):
            yield from _below(inner, f"{name}/{inner.name}")
    elif not (entry.name.startswith(".") and entry.name.endswith(".tmp")):
        yield name, entry


def is_derived(name: str) -> bool:
    """Whether a file is one that reports make."""
    return name.partition("/")[0] in DERIVED


def file_sum(path: Path | str) -> str:
    """SHA-256 and size of a plain file, as a manifest has them.

    Raises:
        OSError: it cannot be read, or is a link or no file.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "no plain file", str(path))
        if status.st_size < _READ_BYTES:  # of three in four one read is enough
            data = os.read(descriptor, _READ_BYTES)
            if len(data) == status.st_size:
                return f"{hashlib.sha256(data).hexdigest()} {len(data)}"
            os.lseek(descriptor, 0, os.SEEK_SET)
        sha, size = hashlib.sha256(), 0
        while data := os.read(descriptor, _READ_BYTES):
            sha.update(data)
            size += len(data)
        return f"{sha.hexdigest()} {size}"
    finally:
        os.close(descriptor)


def file_sums(
    folder: Path, names: Collection[str], told: Callable[[int], None] = lambda _: None
) -> dict[str, str]:
    """Sums of many files of a folder, read in parallel; of one that cannot be read the reason.

    Args:
        folder: run folder.
        names: relative paths.
        told: receives numbers of files that are done, as they are.
    """
    root = str(folder)
    ordered = list(names)
    chunks = [ordered[at : at + _CHUNK] for at in range(0, len(ordered), _CHUNK)]

    def sums_of(chunk: list[str]) -> list[tuple[str, str]]:
        pairs = []
        for name in chunk:
            try:
                pairs.append((name, file_sum(f"{root}/{name}")))
            except OSError as error:
                pairs.append((name, error.strerror or str(error)))
        return pairs

    sums: dict[str, str] = {}
    with ThreadPoolExecutor(min(8, len(os.sched_getaffinity(0)) + 1)) as pool:
        for chunk_sums in pool.map(sums_of, chunks):
            sums.update(chunk_sums)
            told(len(chunk_sums))
    return sums


def listed(folder: Path, choose: Callable[[str], bool]) -> dict[str, str]:
    """Sums of the files of a run folder that a new manifest is to list.

    Raises:
        InfrastructureError: one is a link, no plain file, or cannot be read.
    """
    try:
        chosen = [(name, entry) for name, entry in entries(folder) if choose(name)]
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    odd = [name for name, entry in chosen if odd_entry(entry) or not name.isprintable()]
    if odd:
        raise InfrastructureError(
            f"{folder}: cannot be signed: '{escape(odd[0], 200)}' is a link, no plain file or has "
            "an odd name; remove it"
        )
    sums = file_sums(folder, sorted(name for name, _ in chosen))
    for name, value in sums.items():
        if " " not in value or len(value.split()[0]) != 64:
            raise InfrastructureError(f"{folder / name}: {value}")
    return sums


def odd_entry(entry: os.DirEntry[str]) -> bool:
    """Whether an entry is a link or no plain file."""
    return entry.is_symlink() or not entry.is_file(follow_symlinks=False)


def changed(folder: Path, manifest: Manifest, names: Iterable[str]) -> list[str]:
    """Names of ``names`` that the manifest lists and that are not as they were signed."""
    wrong = []
    for name in names:
        if name not in manifest.files:
            continue
        try:
            same = file_sum(folder / name) == manifest.files[name]
        except OSError:
            same = False
        if not same:
            wrong.append(name)
    return wrong


def journal_of(folder: Path) -> Path | None:
    """The journal of a run folder: in it, or of the conductor in whose folder it lies."""
    for path in (folder / JOURNAL_FILE, folder / ".." / JOURNAL_FILE):
        if path.is_file() and not path.is_symlink():
            return path
    return None


def _name(kind: str) -> str:
    return RUN_FILE if kind == "run" else DERIVED_FILE


def _bytes_to_sign(bare: Manifest) -> bytes:
    return _SIGNED + msgspec.json.encode(bare)


def _encode(manifest: Manifest) -> bytes:
    return msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n"
