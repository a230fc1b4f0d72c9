"""One TLS handshake with an endpoint, to say what is wrong: Zenoh itself only times out.

It also spares the other side: a listener of Zenoh pauses for 0.1 s after every handshake that
fails, so a member with a wrong key must not be left to try again and again.
"""

from __future__ import annotations

import socket
import ssl

from twin.fabric.endpoint import check_protected, host_and_port, is_tls
from twin.fabric.errors import UnreachableError
from twin.fabric.key_file import Key, UnfitKeyError

_NOT_YET_VALID, _EXPIRED = 9, 10
"""X509_V_ERR_CERT_NOT_YET_VALID and X509_V_ERR_CERT_HAS_EXPIRED of OpenSSL."""


def greet(endpoint: str, key: Key | None, timeout_s: float = 2.0) -> None:
    """Return if somebody listens at ``endpoint`` and, for TLS, holds the same key.

    A side that proves to hold our certificate's private key accepts it from us as well.

    Raises:
        UnreachableError: nobody listens, or what listens there does not speak TLS.
        UnfitKeyError: the other side holds another key.
    """
    check_protected(endpoint, keyed=key is not None)
    try:
        with socket.create_connection(host_and_port(endpoint), timeout_s) as connection:
            if is_tls(endpoint) and key is not None:
                _shake_hands(endpoint, key, connection)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreachableError(f"{endpoint}: no conductor answers ({reason})") from None


def _shake_hands(endpoint: str, key: Key, connection: socket.socket) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.load_verify_locations(cadata=key.authority.decode())
    context.load_cert_chain(key.path)
    try:
        with context.wrap_socket(connection):
            return
    except ssl.SSLCertVerificationError as error:
        if error.verify_code in (_NOT_YET_VALID, _EXPIRED):
            line = f"{endpoint}: {error.verify_message}; compare the clocks, or make a new key"
        else:
            line = (
                f"{endpoint}: refused: it holds another key than {key.path}; take the "
                "conductor.key of its state folder, as it is now"
            )
        raise UnfitKeyError(line) from None
    except (ssl.SSLError, TimeoutError):
        raise UnreachableError(
            f"{endpoint}: something listens there, but does not speak TLS; a conductor on "
            "loopback without a key is reached by tcp/"
        ) from None
