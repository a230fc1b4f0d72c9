"""Turns at a port: scripts listen where they always do, so one rig of a host uses it at a time.

The name of a socket is a lock that leaves nothing behind, however its holder ends; whoever waits
for its turn is connected to it, and hears of that end.
"""

from __future__ import annotations

import os
import socket

from twin.base.errors import UnfinishedError

TURN_VARIABLE = "TWIN_BRIDGE_TURN"
"""Environment variable of a stack's host: the port whose turn its worker has taken for it."""

WAITING_MAX = 64
"""Most rigs of a host that wait for a port; others ask again."""


def turn_at(port: int) -> socket.socket | None:
    """The turn at ``port``, until it is closed; None: another rig of this host has it."""
    turn = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        turn.bind(_name(port))
        turn.listen(WAITING_MAX)
    except OSError:
        turn.close()
        return None
    return turn


def take_turn(port: int) -> socket.socket | None:
    """The turn at ``port``, for the process that talks to the script; None: its worker has it.

    Raises:
        UnfinishedError: another rig of this host has it.
    """
    if os.environ.pop(TURN_VARIABLE, "") == str(port):
        return None
    turn = turn_at(port)
    if turn is None:
        raise UnfinishedError(f"port {port} is used by another rig of this host")
    return turn


def await_turn(port: int) -> None:
    """Return when the turn at ``port`` has ended; somebody else may have taken the next one."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as waiting:
        try:
            waiting.connect(_name(port))
            waiting.recv(1)
        except OSError:  # it has ended, or ends with us in the queue
            return


def _name(port: int) -> str:
    return f"\0drivetwin-bridge-{port}"
