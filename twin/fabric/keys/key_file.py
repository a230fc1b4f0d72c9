"""A member's key: one private file that says to which fabric, and as what, its holder belongs.

The file is PEM: a certificate whose name is fabric and role, its private key, and the certificate
of the authority that signed it; before them may stand where the conductor is. The same bytes in
one line of base64 are as good, for where a line is easier to carry than a file.
"""

from __future__ import annotations

import base64
import binascii
import datetime
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.base.errors import UsageError
from twin.fabric.keys.roles import Role, split_name

if TYPE_CHECKING:
    from cryptography import x509

FOLDER_NAME = "keys"
"""Folder of keys that conductors of earlier versions made, beside their ``conductor.json``."""

LINE_MARK = b"drivetwin-key:"
"""Begins a key in one line."""

ENDPOINT_MARK, NAMESPACE_MARK = "endpoint: ", "namespace: "
"""Begin the lines before the certificate that say where the conductor is."""

ROLE_MARK = "role: "
"""Begins the line there that tells people what the key may; the certificate decides."""

FILE_BYTES_MAX = 65536


class UnfitKeyError(UsageError):
    """A key file is there, but cannot be used as it is; waiting does not help."""


class ExpiredKeyError(UnfitKeyError):
    """A key that was fit once."""


class WrongRoleError(UsageError):
    """A key is fit, but of a role that may not do what was tried."""


@dataclass(frozen=True, slots=True, repr=False)
class MemberKey:
    """The content of a key file; never shown, not even in a traceback."""

    path: Path
    """Absolute path, which other processes are told."""
    authority: bytes
    """Certificate of the fabric's authority, PEM."""
    certificate: bytes
    """Certificate that the key's holder shows, PEM."""
    private: bytes
    """The private key of that certificate, PEM."""
    fabric: str
    """Begins the names of all certificates of this fabric, and of no other."""
    role: Role
    endpoint: str = ""
    """Endpoint of the conductor when the key was made; empty: unknown."""
    namespace: str = ""
    """Namespace of the conductor when the key was made; empty: unknown."""

    def __repr__(self) -> str:
        return f"Key({self.path})"


def key_path(path: Path, role: Role) -> Path:
    """The file that ``path`` means for a process of ``role``: itself, or one in that folder."""
    return path / f"{role}.key" if path.is_dir() else path


def load_key(path: Path, role: Role) -> MemberKey:
    """Read a key file, or from a folder of keys that of ``role``.

    A file may be of another role: what that may not do is refused when it is tried.

    Raises:
        UnfitKeyError: it is not private, damaged or not valid today.
        UsageError: there is none.
    """
    path = key_path(path.absolute(), role)
    return as_key(path, _unfolded(path, read_private(path)))


def as_key(path: Path, data: bytes) -> MemberKey:
    """The key whose file is, or would be, ``path`` with the content ``data``.

    Raises:
        UnfitKeyError: it is damaged or not valid today.
    """
    # Late: most commands run without a key.
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization
    from cryptography.x509.oid import NameOID

    try:
        certificate, authority = x509.load_pem_x509_certificates(data)
        private = serialization.load_pem_private_key(data[data.index(b"-----BEGIN PRIV") :], None)
        certificate.verify_directly_issued_by(authority)
        if private.public_key() != certificate.public_key():
            raise ValueError
        name = str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)
        fabric, role = split_name(name)
        head = data[: data.index(b"-----BEGIN")].decode().splitlines()
    except Exception:  # the library's errors could quote the file
        raise UnfitKeyError(
            f"{path}: damaged, or no key file of `conductor invite`; copy it again, "
            "or ask for a new one"
        ) from None
    check_validity(path, certificate.not_valid_before_utc, certificate.not_valid_after_utc)
    pem = serialization.Encoding.PEM
    return MemberKey(
        path,
        authority=authority.public_bytes(pem),
        certificate=certificate.public_bytes(pem),
        private=private.private_bytes(
            pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ),
        fabric=fabric,
        role=role,
        endpoint=_said(head, ENDPOINT_MARK),
        namespace=_said(head, NAMESPACE_MARK),
    )


def read_certificate(path: Path) -> x509.Certificate:
    """The certificate of a key file, also of one that is not fit any more.

    Raises:
        UsageError: it cannot be read, or holds none.
    """
    from cryptography import x509

    try:
        with path.open("rb") as file:
            data = _unfolded(path, file.read(FILE_BYTES_MAX))
        return x509.load_pem_x509_certificates(data)[0]
    except OSError as error:
        raise UsageError(f"{path}: key file: {error.strerror}") from None
    except ValueError:
        raise UnfitKeyError(f"{path}: no key file: it holds no certificate") from None


def shared(key: MemberKey) -> Path:
    """What other processes of its owner are told: the folder of keys, or ``key`` where it lies
    alone."""
    folder = key.path.parent
    return folder if (folder / f"{Role.worker}.key").exists() else key.path


def as_line(data: bytes) -> bytes:
    """A key file's content in one line."""
    return LINE_MARK + base64.urlsafe_b64encode(data)


def read_private(path: Path) -> bytes:
    """The file's bytes, if nobody else may read or write it.

    Raises:
        UnfitKeyError: somebody may, or it is no file.
        UsageError: there is none.
    """
    try:
        # O_NONBLOCK: a pipe of that name must not hold us up.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise UsageError(
            f"{path}: no such key file; a conductor keeps its keys in its user's own folder, where "
            "--state FOLDER finds them, and `conductor invite` makes one for a role"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: key file: {error.strerror}") from None
    try:
        _check_private(path, os.fstat(descriptor))
        return os.read(descriptor, FILE_BYTES_MAX)
    finally:
        os.close(descriptor)


def check_validity(path: Path, begin: datetime.datetime, end: datetime.datetime) -> None:
    """Raise UnfitKeyError unless the clock stands between ``begin`` and ``end``."""
    now = datetime.datetime.now(datetime.UTC)
    if now > end:
        raise ExpiredKeyError(
            f"{path}: this key expired on {end:%Y-%m-%d}; ask for a new one by `conductor invite`, "
            "or where the conductor's own expired make all anew by `conductor keygen --force`"
        )
    if now < begin:
        raise UnfitKeyError(
            f"{path}: this key is valid from {begin:%Y-%m-%d %H:%M} UTC, the clock here says "
            f"{now:%Y-%m-%d %H:%M}; set the clock"
        )


def _unfolded(path: Path, data: bytes) -> bytes:
    if not data.startswith(LINE_MARK):
        return data
    try:
        return base64.b64decode(data[len(LINE_MARK) :].strip(), altchars=b"-_", validate=True)
    except binascii.Error:
        raise UnfitKeyError(
            f"{path}: this line of a key is cut off or changed; copy it again"
        ) from None


def _said(lines: list[str], mark: str) -> str:
    return next((line.removeprefix(mark) for line in lines if line.startswith(mark)), "")


def _check_private(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise UnfitKeyError(f"{path}: not a file; give the path of a key file, or of its folder")
    if status.st_uid != os.geteuid():
        raise UnfitKeyError(
            f"{path}: this key belongs to user id {status.st_uid}, you are {os.geteuid()}; "
            "make a copy of your own and `chmod 600` it"
        )
    if status.st_mode & 0o077:
        raise UnfitKeyError(
            f"{path}: others may read this key (mode {stat.S_IMODE(status.st_mode):04o}); "
            f"run `chmod 600 {path}`, or make a new one if somebody did"
        )
