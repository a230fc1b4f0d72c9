"""The session of a worker: a secret that its process alone knows, and what can be shown with it.

A worker makes the secret at its start and keeps it in its memory; the conductor is told it with
every request and keeps a hash of it only, so neither a journal nor a restart gives it away. Results
that outlive their worker are sealed with a key that is made from the secret.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

SECRET_BYTES = 32
_CONTEXT = b"drivetwin result\0"


def new_secret() -> bytes:
    """A secret for a new worker."""
    return secrets.token_bytes(SECRET_BYTES)


def hash_of(secret: bytes) -> bytes:
    """Hash of a secret, which may be kept, and known to everybody."""
    return hashlib.sha256(secret).digest()


def proves(secret: bytes, kept: bytes) -> bool:
    """Whether ``kept`` is the hash of this secret."""
    return hmac.compare_digest(hash_of(secret), kept)


def seal(secret: bytes, data: bytes) -> bytes:
    """Signature of ``data`` by the holder of the secret (Ed25519)."""
    return _private(secret).sign(_CONTEXT + data)


def signer_of(secret: bytes) -> bytes:
    """The public key that belongs to the seals of this secret."""
    public: bytes = _private(secret).public_key().public_bytes_raw()
    return public


def is_sealed(signer: bytes, data: bytes, mark: bytes) -> bool:
    """Whether ``mark`` is the seal on ``data`` of the secret with this public key."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(signer).verify(mark, _CONTEXT + data)
    except (InvalidSignature, ValueError):
        return False
    return True


def _private(secret: bytes) -> Ed25519PrivateKey:
    # Late: it takes 15 ms to load, and only joining and spooling need it.
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    return Ed25519PrivateKey.from_private_bytes(secret)
