"""One TLS handshake with an endpoint, to say what is wrong: Zenoh itself only times out.

It also spares the other side: a listener of Zenoh pauses for 0.1 s after every handshake that
fails, so a member with a wrong key must not be left to try again and again.
"""

from __future__ import annotations

import contextlib
import os
import socket
import ssl
from collections.abc import Iterator
from typing import Any

from twin.base.errors import UnreachableError
from twin.fabric.endpoint import check_protected, host_and_port, is_tls
from twin.fabric.keys.key_file import MemberKey, UnfitKeyError
from twin.fabric.keys.roles import Role, rig_of, split_name

_NOT_YET_VALID, _EXPIRED = 9, 10
"""X509_V_ERR_CERT_NOT_YET_VALID and X509_V_ERR_CERT_HAS_EXPIRED of OpenSSL."""


def greet(
    endpoint: str, key: MemberKey | None, timeout_s: float = 2.0, *, linger_s: float = 0.0
) -> None:
    """Return if somebody listens at ``endpoint`` and, for TLS, is one to connect to.

    A side that proves to be of our fabric accepts a certificate of it from us as well, unless it is
    withdrawn: a front hangs up on that after the handshake, within ``linger_s``.

    Raises:
        UnreachableError: nobody listens, or what listens there does not speak TLS.
        UnfitKeyError: the other side is of another fabric, or of a role that nobody connects to.
    """
    check_protected(endpoint, keyed=key is not None)
    try:
        with socket.create_connection(host_and_port(endpoint), timeout_s) as connection:
            if is_tls(endpoint) and key is not None:
                _shake_hands(endpoint, key, connection, linger_s)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreachableError(f"{endpoint}: no conductor answers ({reason})") from None


def _shake_hands(endpoint: str, key: MemberKey, connection: socket.socket, linger_s: float) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.load_verify_locations(cadata=key.authority.decode())
    with in_memory(key.certificate + key.private) as path:
        context.load_cert_chain(path)
    try:
        with context.wrap_socket(connection) as session:
            _check_listener(endpoint, session.getpeercert())
            if linger_s and _hangs_up(session, linger_s):
                raise UnfitKeyError(
                    f"{endpoint}: refused: {key.path} was withdrawn, has expired or has too many "
                    "connections; the conductor's audit.jsonl says which, `conductor invite` makes "
                    "a new one"
                )
    except ssl.SSLCertVerificationError as error:
        if error.verify_code in (_NOT_YET_VALID, _EXPIRED):
            line = f"{endpoint}: {error.verify_message}; compare the clocks, or make a new key"
        elif rig := rig_of(key.fabric):
            line = (
                f"{endpoint}: refused: this is not the simulator of rig {rig}, and {key.path} is "
                "for that one alone; every rig gives its stack a key of its own, see --join-dir"
            )
        else:
            line = (
                f"{endpoint}: refused: it is of another fabric than {key.path}; take one of the "
                "keys/ in its state folder, as they are now, or ask for a new one (a rig takes "
                "only the key that it gave its stack)"
            )
        raise UnfitKeyError(line) from None
    except (ssl.SSLError, TimeoutError):
        raise UnreachableError(
            f"{endpoint}: something listens there, but does not speak TLS; a conductor on "
            "loopback without a key is reached by tcp/"
        ) from None


def _hangs_up(session: ssl.SSLSocket, wait_s: float) -> bool:
    """Whether the other side ends it before anything was said."""
    session.settimeout(wait_s)
    try:
        return not session.recv(1)
    except TimeoutError:
        return False
    except OSError:
        return True


def _check_listener(endpoint: str, certificate: Any) -> None:
    """Raise UnfitKeyError unless it is a conductor (or its relay), or a worker's simulator."""
    parts = certificate["subject"] if certificate else ()
    name = dict(pair for part in parts for pair in part).get("commonName", "")
    with contextlib.suppress(ValueError):
        if split_name(name)[1] in (Role.conductor, Role.worker):
            return
    raise UnfitKeyError(
        f"{endpoint}: refused: what listens there shows the certificate '{name}', "
        "allowed: a conductor's or a worker's; somebody may pose as one"
    )


@contextlib.contextmanager
def in_memory(data: bytes) -> Iterator[str]:
    """A path to ``data`` that is on no disk: the library takes certificates as files only."""
    descriptor = os.memfd_create("key", os.MFD_CLOEXEC)
    try:
        os.write(descriptor, data)
        yield f"/proc/self/fd/{descriptor}"
    finally:
        os.close(descriptor)
