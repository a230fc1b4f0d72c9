"""Messages between a front's process and the one that started it."""

from __future__ import annotations

import msgspec

ASKING = b"?"
"""Byte by which a front asks for its settings and its sockets."""


class Settings(msgspec.Struct, frozen=True):
    """What a front is told, as one line of JSON on standard input; then that is its lifeline.

    It is told nothing before it keeps to itself: a process of the same user could read along.
    """

    listener: int
    """Descriptor of the listening socket."""
    roles: tuple[str, ...]
    """Whose Unix sockets behind it are handed over, in this order."""
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
