"""The user's signing key, and which keys of others he trusts.

Both lie in the user's own folder (:mod:`twin.base.own_folder`), outside of every run::

    signing.key      Ed25519, PEM, mode 0600; made when something is signed for the first time
    trusted/*.pub    public keys of others, 64 hexadecimal digits each
"""

from __future__ import annotations

import binascii
import contextlib
import os
import re
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from schemas.escape import escape
from schemas.files.regular_file import read_regular
from twin.base.errors import InfrastructureError, UsageError, storage_error
from twin.base.own_folder import VARIABLE, own_folder
from twin.fabric.keys.key_file import read_private

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

KEY_FILE = "signing.key"
TRUSTED_FOLDER = "trusted"
TRUSTED_MAX = 1000
"""Most keys of others that are read."""

_HEX = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True, repr=False)
class Signer:
    """Signs with a private key, which is never shown."""

    private: Ed25519PrivateKey

    @property
    def public(self) -> str:
        """The public key, hexadecimal."""
        return self.private.public_key().public_bytes_raw().hex()

    def sign(self, data: bytes) -> str:
        """Signature, hexadecimal."""
        return self.private.sign(data).hex()

    def __repr__(self) -> str:
        return f"Signer({short(self.public)})"


def own_signer() -> Signer:
    """The user's key; made if there is none yet.

    Raises:
        TwinError: it cannot be read or made, or others may read or replace it.
    """
    folder = own_folder()
    path = folder / KEY_FILE
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(folder)
        if not path.exists():
            _make(path)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return load_signer(path)


def new_signer(path: Path | None = None) -> Signer:
    """A new key in a file that is not there yet; the user's own, if no path is given.

    Raises:
        UsageError: the file is there.
        TwinError: it cannot be written, or others may replace it.
    """
    path = own_folder() / KEY_FILE if path is None else path
    if os.path.lexists(path):
        raise UsageError(
            f"{path}: is there already, and what it has signed is believed by its public key; "
            "move it away, or give another file"
        )
    if path == own_folder() / KEY_FILE:
        return own_signer()
    try:
        _make(path)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return load_signer(path)


def own_public() -> str:
    """The user's public key, hexadecimal; empty: he has none, or none that may be trusted."""
    if not (own_folder() / KEY_FILE).exists():
        return ""
    _check_folder(own_folder())
    return load_signer(own_folder() / KEY_FILE).public


def trusted_keys() -> frozenset[str]:
    """Public keys, hexadecimal: the user's own and those that he has put into his list.

    Raises:
        TwinError: others may write the list, or a file of it is no key.
    """
    keys = {own_public()} - {""}
    folder = own_folder() / TRUSTED_FOLDER
    if folder.is_dir():
        _check_folder(own_folder())
        _check_folder(folder)
        keys |= {parse_key(str(path)) for path in sorted(folder.glob("*.pub"))[:TRUSTED_MAX]}
    return frozenset(keys)


def parse_key(given: str) -> str:
    """A public key as 64 hexadecimal digits, given so or as the path of a file that holds them.

    Raises:
        UsageError: it is neither.
    """
    if _HEX.fullmatch(given.lower()):
        return given.lower()
    try:
        text = read_regular(Path(given), 4096).decode().strip().lower()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", "") or "not text"
        raise UsageError(
            f"public key '{escape(given, 200)}': {reason}; give 64 hexadecimal digits, as "
            "`conductor verify` prints them, or a file that holds them"
        ) from None
    if not _HEX.fullmatch(text):
        raise UsageError(f"{given}: no public key; expected 64 hexadecimal digits")
    return text


def fits(key: str, signature: str, data: bytes) -> bool:
    """Whether the holder of ``key`` has signed ``data``."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(key)).verify(
            binascii.unhexlify(signature), data
        )
    except (InvalidSignature, ValueError):
        return False
    return True


def short(key: str) -> str:
    """A public key for people."""
    return key[:16]


def _check_folder(folder: Path) -> None:
    """Raise InfrastructureError if others may change what is in it."""
    status = folder.stat()
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise InfrastructureError(
            f"{folder}: belongs to user id {status.st_uid}, mode "
            f"{stat.S_IMODE(status.st_mode):04o}; signing keys must lie where nobody else may "
            f"write: `chmod 700 {folder}`, or set "
            f"{VARIABLE} to a folder of your own"
        )


def _make(path: Path) -> None:
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    data = Ed25519PrivateKey.generate().private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        with contextlib.suppress(FileExistsError):  # another conductor was first: his is taken
            os.link(new, path)
    finally:
        new.unlink()


def load_signer(path: Path) -> Signer:
    """The key in a file.

    Raises:
        TwinError: there is none, it is damaged, or others may read it.
    """
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    data = read_private(path)
    try:
        private = serialization.load_pem_private_key(data, None)
    except Exception:  # the library's errors could quote the file
        private = None
    if not isinstance(private, Ed25519PrivateKey):
        raise InfrastructureError(
            f"{path}: damaged, or no signing key; put back a copy, or move it away: a new one is "
            "made then, and what the old one signed has to be trusted by its public key"
        )
    return Signer(private)
