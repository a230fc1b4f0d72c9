"""Files that are complete or absent, whatever is killed while they are written; file systems."""

from __future__ import annotations

import ctypes
import os
import secrets
from pathlib import Path

SHARED = (
    *("nfs", "nfs4", "lustre", "gpfs", "beegfs", "ceph", "fuse.ceph", "cifs", "smb3", "panfs"),
    *("orangefs", "pvfs2", "fuse.glusterfs", "fuse.sshfs", "afs", "9p", "virtiofs", "wekafs"),
)
"""File systems that several hosts see."""
IN_MEMORY = ("tmpfs", "ramfs")
"""File systems that are gone after a restart."""


def write_atomic(
    path: Path, data: bytes | bytearray | memoryview, *, mode: int = 0o666, sync: bool = True
) -> None:
    """Write a file that is complete or absent, also after a power cut; its folder must exist.

    Args:
        path: the file.
        data: its content.
        mode: who may read and write it, less the umask, from the first byte on.
        sync: False for many files: whoever writes them calls :func:`sync_files` when all are
            there; after a power cut before that one of them may be empty.

    Raises:
        OSError: it cannot be written; what stood there before still stands.
    """
    # Random, because two hosts may write to one folder under the same pid.
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    if not sync:
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def sync_files(folder: Path) -> None:
    """Bring everything written to the file system of ``folder`` to the disk.

    Raises:
        OSError: it cannot be written.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if library.syncfs(descriptor) != 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), str(folder))
    finally:
        os.close(descriptor)


def filesystem(folder: Path) -> str:
    """Type of the file system that holds ``folder``."""
    import psutil  # takes 10 ms, and every command loads this module

    path = folder.resolve()
    mounts = {Path(mount.mountpoint): mount.fstype for mount in psutil.disk_partitions(all=True)}
    return next(
        (mounts[ancestor] for ancestor in (path, *path.parents) if ancestor in mounts), "unknown"
    )


def nearest_existing(folder: Path) -> Path:
    """The folder, or the nearest one above it that exists."""
    return next(ancestor for ancestor in (folder, *folder.parents) if ancestor.exists())
