"""User at the other end of a loopback connection, and the name under which it asked.

Loopback is open to everybody on a host: to its other users, and by a name that leads there (DNS
rebinding) to any page in its user's browser.
"""

from __future__ import annotations

import os
import socket
from pathlib import Path

NAMES = ("localhost", "127.0.0.1", "[::1]")
"""Names by which loopback may be asked for, also at the far end of a tunnel."""

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ESTABLISHED = "01"


def is_own_name(host: str, *bound: str) -> bool:
    """Whether the ``Host`` of a request is a name of loopback, or one of ``bound``; its port, if
    any, does not matter."""
    name, colon, port = host.rpartition(":")
    if not colon or not port.isdecimal():
        name = host
    return name.lower() in (*NAMES, *(address.lower() for address in bound))


def is_ours(line: socket.socket) -> bool:
    """Whether the process that connected to us over IPv4 loopback belongs to this user, or to root.

    One that has closed its end already belongs to nobody any more. Systems without ``/proc`` do not
    tell, and there everybody passes.
    """
    try:
        here, there = line.getsockname(), line.getpeername()
    except OSError:
        return False
    wanted = _hexadecimal(there), _hexadecimal(here)
    known = False
    for table in _TABLES:
        try:
            rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        known = True
        for row in rows:
            fields = row.split()
            local, remote = (_v4(field) for field in fields[1:3])
            if (local, remote) == wanted and fields[3] == _ESTABLISHED:
                return int(fields[7]) in (0, os.geteuid())
    return not known


def _hexadecimal(address: tuple[str, int]) -> str:
    """An address as the kernel's table writes it."""
    number = int.from_bytes(socket.inet_aton(address[0]), "little")
    return f"{number:08X}:{address[1]:04X}"


def _v4(address: str) -> str:
    """An IPv4 address that a socket of IPv6 has."""
    host, _, port = address.partition(":")
    return f"{host[-8:]}:{port}" if host.startswith("0000000000000000FFFF0000") else address
