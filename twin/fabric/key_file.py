"""The fabric's key: one private file, whoever can read it belongs to the fabric.

The file is PEM: a certificate, its private key, and the certificate of the authority that signed
it. The authority's own key is thrown away once it has signed, so nobody can sign a second
certificate; all members show this one, and accept no other.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path

from twin.fabric.errors import UsageError, storage_error
from twin.fabric.files import write_atomic

FILE_NAME = "conductor.key"
"""Name of the key that a conductor makes, beside its ``conductor.json``."""

DAYS = 365
"""How long a new key is valid [days]."""

MARGIN_DAYS = 2
"""A key is valid from so long before it is made: clocks of nodes differ [days]."""

FILE_BYTES_MAX = 65536


class UnfitKeyError(UsageError):
    """A key file is there, but cannot be used as it is; waiting does not help."""


@dataclass(frozen=True, slots=True, repr=False)
class Key:
    """The content of a key file; never shown, not even in a traceback."""

    path: Path
    """Absolute; what other processes are told."""
    authority: bytes
    """Certificate of the authority, PEM."""
    certificate: bytes
    """What members show each other, PEM."""
    private: bytes
    """The private key of that certificate, PEM."""
    name: str
    """Common name of that certificate, of this fabric alone."""

    def __repr__(self) -> str:
        return f"Key({self.path})"


def load_key(path: Path) -> Key:
    """Read a key file.

    Raises:
        UnfitKeyError: it is not private, damaged or not valid today.
        UsageError: there is none.
    """
    path = path.absolute()
    data = _read_private(path)
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
    except Exception:  # the library's errors could quote the file
        raise UnfitKeyError(
            f"{path}: damaged, or no key file of `conductor keygen`; copy it again, "
            "or make a new one"
        ) from None
    _check_validity(path, certificate.not_valid_before_utc, certificate.not_valid_after_utc)
    pem = serialization.Encoding.PEM
    return Key(
        path,
        authority=authority.public_bytes(pem),
        certificate=certificate.public_bytes(pem),
        private=private.private_bytes(
            pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ),
        name=name,
    )


def make_key(path: Path, *, days: int = DAYS, replace: bool = False) -> Key:
    """Write a new key file with mode 0600, complete or not at all.

    Raises:
        UsageError: there is one already, unless ``replace``; or the folder cannot be written.
        InfrastructureError: the disk is full or broken.
    """
    path = path.absolute()
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}; make it first")
    if not replace and path.exists():
        raise UsageError(
            f"{path}: exists already; with a new key whoever has the old one is shut out: "
            "say --force to replace it"
        )
    try:
        write_atomic(path, _generate(days), mode=0o600)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return load_key(path)


def load_or_make(path: Path) -> Key:
    """The key at ``path``, made if there is none; for its conductor alone, which has a lock."""
    with contextlib.suppress(FileNotFoundError):
        path.lstat()
        return load_key(path)
    return make_key(path)


def _read_private(path: Path) -> bytes:
    """The file's bytes, if nobody else may read or write it."""
    try:
        # O_NONBLOCK: a pipe of that name must not hold us up.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise UsageError(
            f"{path}: no such key file; a conductor that listens beyond loopback keeps one in its "
            "state folder, and `conductor keygen FILE` makes one"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: key file: {error.strerror}") from None
    try:
        _check_private(path, os.fstat(descriptor))
        return os.read(descriptor, FILE_BYTES_MAX)
    finally:
        os.close(descriptor)


def _check_private(path: Path, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise UnfitKeyError(f"{path}: not a file; give the path of a key file")
    if found.st_uid != os.geteuid():
        raise UnfitKeyError(
            f"{path}: this key belongs to user id {found.st_uid}, you are {os.geteuid()}; "
            "make a copy of your own and `chmod 600` it"
        )
    if found.st_mode & 0o077:
        raise UnfitKeyError(
            f"{path}: others may read this key (mode {stat.S_IMODE(found.st_mode):04o}); "
            f"run `chmod 600 {path}`, or make a new one if somebody did"
        )


def _check_validity(path: Path, begin: datetime.datetime, end: datetime.datetime) -> None:
    now = datetime.datetime.now(datetime.UTC)
    if now > end:
        raise UnfitKeyError(
            f"{path}: this key expired on {end:%Y-%m-%d}; make a new one with "
            f"`conductor keygen --force {path}` and start conductor and workers again"
        )
    if now < begin:
        raise UnfitKeyError(
            f"{path}: this key is valid from {begin:%Y-%m-%d %H:%M} UTC, the clock here says "
            f"{now:%Y-%m-%d %H:%M}; set the clock"
        )


def _generate(days: int) -> bytes:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    fabric = f"drivetwin {secrets.token_hex(8)}"
    now = datetime.datetime.now(datetime.UTC)
    begin = now - datetime.timedelta(days=MARGIN_DAYS)
    signer = ec.generate_private_key(ec.SECP256R1())
    private = ec.generate_private_key(ec.SECP256R1())

    def build(name: str, key: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
            .issuer_name(
                x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"{fabric} authority")])
            )
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(begin)
            .not_valid_after(now + datetime.timedelta(days=days))
        )

    authority = (
        build(f"{fabric} authority", signer.public_key())
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(signer, hashes.SHA256())
    )
    usage = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    certificate = (
        build(fabric, private.public_key())
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        # Nobody checks it, because members move between hosts; but TLS stacks want one.
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("drivetwin")]), critical=False)
        .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        .sign(signer, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    plain = private.private_bytes(
        pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return certificate.public_bytes(pem) + plain + authority.public_bytes(pem)
