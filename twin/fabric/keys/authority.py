"""A fabric's authority: makes the keys of all roles, and later further ones.

Its private key lies in the folder of keys, mode 0600, like theirs: whoever reads it may make a key
of any role. It is needed for invitations alone and may be removed.
"""

from __future__ import annotations

import datetime
import secrets
import shlex
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.base.errors import TwinError, UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.own_folder import own_folder
from twin.fabric.keys.key_file import (
    ENDPOINT_MARK,
    FOLDER_NAME,
    NAMESPACE_MARK,
    ROLE_MARK,
    ExpiredKeyError,
    MemberKey,
    UnfitKeyError,
    as_key,
    check_validity,
    load_key,
    read_private,
)
from twin.fabric.keys.own_keys import KEYS_NAME, fabric_name, make_way, note
from twin.fabric.keys.roles import IN_WORDS, MEMBERS, Role, common_name, fabric_of_rig

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

FILE_NAME = "authority.key"
"""Name of the authority's file in a folder of keys."""

DAYS = 365
"""How long a new fabric's keys are valid [days]."""

FILE_OF_CONDUCTOR = f"{Role.conductor}.key"

RIG_DAYS = 30
"""How long the two keys of a rig are valid; they open nothing once it has ended [days]."""

INNER_DAYS = 3650
"""How long a key within one process is valid, longer than any process lives [days]."""

MARGIN_DAYS = 2
"""A key is valid from so long before it is made: clocks of nodes differ [days]."""


@dataclass(frozen=True, slots=True, repr=False)
class Authority:
    """The authority that signs certificates; never shown."""

    fabric: str
    certificate: x509.Certificate
    private: ec.EllipticCurvePrivateKey

    def issue(self, role: Role, days: float, endpoint: str = "", namespace: str = "") -> bytes:
        """The content of a new key file; it ends with the authority at the latest."""
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ec

        private = ec.generate_private_key(ec.SECP256R1())
        certificate = _certificate(self, common_name(self.fabric, role), private, days)
        head = f"{ROLE_MARK}{role}, {IN_WORDS[role]}\n"
        head += f"{ENDPOINT_MARK}{endpoint}\n" if endpoint else ""
        head += f"{NAMESPACE_MARK}{namespace}\n" if namespace else ""
        pem = serialization.Encoding.PEM
        return b"".join(
            (
                head.encode(),
                certificate.public_bytes(pem),
                _pem(private),
                self.certificate.public_bytes(pem),
            )
        )


def make_keys(folder: Path, *, days: int = DAYS, replace: bool = False) -> Path:
    """Write a folder of keys for a new fabric, modes 0700 and 0600, complete or not at all.

    Raises:
        UsageError: there is one already, unless ``replace``; or it cannot be written.
        InfrastructureError: the disk is full or broken.
    """
    folder = folder.absolute()
    if not folder.parent.is_dir():
        raise UsageError(f"{folder}: there is no folder {folder.parent}; make it first")
    there = folder.exists() or folder.is_symlink()
    if there and not replace:
        raise UsageError(
            f"{folder}: exists already; with new keys whoever has an old one is shut out: "
            "say --force to replace them"
        )
    if there and (folder.is_symlink() or not (folder / f"{Role.conductor}.key").is_file()):
        raise UsageError(f"{folder}: not a folder of keys; give another name, or remove it")
    made: Path | None = None
    try:
        made = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        authority = _new_authority(f"drivetwin {secrets.token_hex(8)}", days)
        write_atomic(made / FILE_NAME, _as_file(authority), mode=0o600)
        for role in MEMBERS:
            write_atomic(made / f"{role}.key", authority.issue(role, days), mode=0o600)
        if there:
            # A folder is not replaced in one step; nobody reads keys while they change.
            old = folder.rename(made / "old")
            shutil.rmtree(old)
        made.rename(folder)
    except OSError as error:
        if made is not None:
            shutil.rmtree(made, ignore_errors=True)
        raise storage_error(error, str(folder)) from None
    return folder


def rig_keys(rig: str) -> tuple[bytes, bytes]:
    """The content of the key files of a rig's simulator and of its stack.

    Their authority is a new one that nobody keeps, so these two can talk to each other and to
    nobody else, and nobody can make a third.
    """
    authority = _new_authority(fabric_of_rig(rig), RIG_DAYS)
    return authority.issue(Role.worker, RIG_DAYS), authority.issue(Role.stack, RIG_DAYS)


def inner_key() -> MemberKey:
    """A conductor's key of a fabric of its own, which no file holds: for sessions of one process
    among themselves."""
    authority = _new_authority(f"drivetwin {secrets.token_hex(8)}", INNER_DAYS)
    return as_key(Path("/inner.key"), authority.issue(Role.conductor, INNER_DAYS))


def load_or_make(state: Path) -> MemberKey:
    """The conductor's key of a state folder, which lies in its user's own folder; made with those
    of all other roles if there is none, and anew when they have expired. For the conductor alone,
    which has a lock.

    Raises:
        UsageError: the state folder holds keys, or the user's own folder is not that user's alone.
        InfrastructureError: the disk is full or broken.
    """
    refuse_keys_in(state)
    folder = make_way(fabric_name(state))
    expired = False
    if (folder / FILE_OF_CONDUCTOR).exists():
        try:
            key = load_key(folder, Role.conductor)
            _complete(folder)
            return key
        except ExpiredKeyError:
            expired = True  # nobody can hold a valid one
    try:
        make_keys(folder, replace=expired)
        note(folder, state)
    except TwinError:
        # A conductor on another node may have made them for its folder of the same path.
        if not (folder / FILE_OF_CONDUCTOR).exists():
            raise
    return load_key(folder, Role.conductor)


def _complete(folder: Path) -> None:
    """Make the keys of roles that came after the folder was made."""
    missing = [role for role in MEMBERS if not (folder / f"{role}.key").exists()]
    if not missing or not (folder / FILE_NAME).exists():
        return
    authority = load_authority(folder)
    try:
        for role in missing:
            write_atomic(folder / f"{role}.key", authority.issue(role, DAYS), mode=0o600)
    except OSError as error:
        raise storage_error(error, str(folder)) from None


def refuse_keys_in(state: Path) -> None:
    """Raise UsageError if keys lie in a state folder, as those of earlier versions did."""
    old = state / FOLDER_NAME
    if (old / FILE_OF_CONDUCTOR).exists():
        kept = own_folder() / KEYS_NAME / fabric_name(state)
        parent, source, target = (shlex.quote(str(path)) for path in (kept.parent, old, kept))
        raise UsageError(
            f"{old}: keys no longer belong in a state folder, which stacks may see; to keep them "
            f"run `(umask 077 && mkdir -p {parent} && mv {source} {target})`, to get new ones "
            "remove them"
        )


def load_authority(folder: Path) -> Authority:
    """Read the authority of a folder of keys.

    Raises:
        UnfitKeyError: it is not private, damaged or not valid today.
        UsageError: there is none.
    """
    path = folder.absolute() / FILE_NAME
    if folder.is_dir() and not path.exists():
        raise UsageError(
            f"{path}: the authority's key was removed, no further key can be made; "
            "`conductor keygen --force` makes a new fabric"
        )
    data = read_private(path)
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    try:
        certificate = x509.load_pem_x509_certificate(data)
        private = serialization.load_pem_private_key(data[data.index(b"-----BEGIN PRIV") :], None)
        name = str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)
        fabric, what = name.rsplit(" ", 1)
        if private.public_key() != certificate.public_key() or what != _SUFFIX:
            raise ValueError
        assert isinstance(private, ec.EllipticCurvePrivateKey)
    except Exception:  # the library's errors could quote the file
        raise UnfitKeyError(f"{path}: damaged; restore it, or make a new fabric") from None
    check_validity(path, certificate.not_valid_before_utc, certificate.not_valid_after_utc)
    return Authority(fabric, certificate, private)


def days_left(authority: Authority) -> int:
    """Whole days until its end, and so the longest that a new key can be valid."""
    return (authority.certificate.not_valid_after_utc - datetime.datetime.now(datetime.UTC)).days


_SUFFIX = "authority"


def _new_authority(fabric: str, days: float) -> Authority:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    private = ec.generate_private_key(ec.SECP256R1())
    certificate = (
        _unsigned(fabric, f"{fabric} {_SUFFIX}", private, _from_now(days))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(private, hashes.SHA256())
    )
    return Authority(fabric, certificate, private)


def _certificate(
    authority: Authority, name: str, private: ec.EllipticCurvePrivateKey, days: float
) -> x509.Certificate:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID

    usage = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    end = min(_from_now(days), authority.certificate.not_valid_after_utc)
    return (
        _unsigned(authority.fabric, name, private, end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        # Nobody checks it, because members move between hosts; but TLS stacks want one.
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("drivetwin")]), critical=False)
        .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        .sign(authority.private, hashes.SHA256())
    )


def _unsigned(
    fabric: str, name: str, private: ec.EllipticCurvePrivateKey, end: datetime.datetime
) -> x509.CertificateBuilder:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    def called(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    begin = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=MARGIN_DAYS)
    return (
        x509.CertificateBuilder()
        .subject_name(called(name))
        .issuer_name(called(f"{fabric} {_SUFFIX}"))
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(end)
    )


def _from_now(days: float) -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=days)


def _as_file(authority: Authority) -> bytes:
    from cryptography.hazmat.primitives import serialization

    return authority.certificate.public_bytes(serialization.Encoding.PEM) + _pem(authority.private)


def _pem(private: ec.EllipticCurvePrivateKey) -> bytes:
    from cryptography.hazmat.primitives import serialization

    return private.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
