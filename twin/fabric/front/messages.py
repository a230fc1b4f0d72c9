"""Messages between a front's process and the one that started it."""

from __future__ import annotations

import msgspec


class Settings(msgspec.Struct, frozen=True):
    """What a front is told, as one line of JSON on standard input; then that is its lifeline."""

    listener: int
    """Descriptor of the listening socket."""
    sockets: dict[str, int]
    """Role -> descriptor of the Unix socket behind."""
    fabric: str
    authority: str
    certificate: str
    private: str
    keys: str
    """Folder with the list of withdrawn keys."""


class FrontEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """An event that a front reports."""

    what: str
    """``refused``, ``opened``, ``closed``, ``slowed`` or ``cut``."""
    peer: str = ""
    role: str = ""
    key: str = ""
    """The certificate's serial number, hexadecimal."""
    reason: str = ""
    count: int = 1
    """Number of sessions that were cut."""
