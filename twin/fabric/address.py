"""Whether an address can be listened on: looked at before anything is made for it."""

from __future__ import annotations

import errno
import socket

from twin.base.errors import UsageError
from twin.fabric.endpoint import host_and_port

IN_USE = (
    "address already in use; stop the program that listens there or choose another port with "
    "--listen"
)


def check_free(endpoint: str) -> None:
    """Raise UsageError if nobody can listen at ``endpoint`` now, with the same sentence that
    listening would end with. Somebody may still be faster."""
    host, port = host_and_port(endpoint)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            # As Zenoh does: what remains of closed connections is no obstacle, a listener is.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            probe.listen()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise UsageError(f"{endpoint}: {IN_USE}") from None
        raise UsageError(
            f"{endpoint}: cannot listen: {error.strerror}; give an address of this host with "
            "--listen"
        ) from None
