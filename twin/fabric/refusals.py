"""Connections that a listener refused, as sentences for its log.

Zenoh tells its program nothing of a handshake that failed; it writes a line to file descriptor 1.
So results get a descriptor of their own, and 1 becomes a pipe that a thread reads.
"""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from schemas.escape import escape
from twin.fabric.zenoh_bus import log_refusals

PERIOD_S = 60.0
"""A reason is logged once in so long, however often it occurs [s]."""
REASON_CHARS_MAX = 200

_REASONS = (
    ("sent no certificates", "it showed no key"),
    ("certificate expired", "its key has expired"),
    ("not valid yet", "its key is not valid yet; compare the clocks"),
    ("UnknownIssuer", "its key is of another fabric or rig"),
    ("BadSignature", "its key is of another fabric or rig"),
    ("UnknownCA", "its key is of another fabric or rig"),
    ("CertificateUnknown", "its key is of another fabric or rig"),
    ("CertificateExpired", "it says that the key here has expired; compare the clocks"),
    ("InvalidContentType", "it does not speak TLS"),
)
"""Part of Zenoh's line -> what it means."""

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(r"zenoh_link_tls::\w+: (.*)")


def reason_of(line: str) -> str:
    """Why a connection was refused, by Zenoh's ``line``; empty: the line says something else."""
    match = _found(line)
    if match is None or "Skipping name verification" in line:
        return ""
    failure = match[1].partition(" Hint:")[0].rstrip(".")
    known = (meaning for part, meaning in _REASONS if part in failure)
    return next(known, f"the handshake failed: {escape(failure, REASON_CHARS_MAX)}")


def _found(line: str) -> re.Match[str] | None:
    return _LINE.search(_COLOUR.sub("", line))


class Refusals:
    """Counts reasons, and says each of them once in a while."""

    def __init__(self) -> None:
        self._said_s: dict[str, float] = {}
        self._more: dict[str, int] = {}

    def take(self, line: str, now_s: float) -> str:
        """What to log after Zenoh's ``line``, or nothing."""
        reason = reason_of(line)
        return self.count(reason, now_s) if reason else ""

    def count(self, reason: str, now_s: float) -> str:
        """What to log after a refusal for ``reason``, or nothing."""
        if now_s - self._said_s.get(reason, float("-inf")) < PERIOD_S:
            self._more[reason] = self._more.get(reason, 0) + 1
            return ""
        if len(self._said_s) > 100:  # unknown reasons may hold what a stranger chose
            self._said_s.clear()
            self._more.clear()
        self._said_s[reason] = now_s
        more = self._more.pop(reason, 0)
        return f"refused a connection: {reason}{f' ({more} more before)' if more else ''}"


@contextmanager
def refusals_logged(say: Callable[[str], object]) -> Iterator[None]:
    """While it lasts, ``say`` gets a sentence for Zenoh's lines, on a thread; standard output stays
    what it is."""
    before = sys.stdout
    before.flush()
    stdout, (reader, writer) = os.dup(1), os.pipe()
    os.dup2(writer, 1)
    os.close(writer)
    thread = threading.Thread(
        target=_read, args=(reader, stdout, say), name="refusals", daemon=True
    )
    try:
        thread.start()
        log_refusals()
        with os.fdopen(os.dup(stdout), "w", buffering=1) as out:
            sys.stdout = out
            yield
    finally:
        sys.stdout = before
        os.dup2(stdout, 1)  # closes the pipe, and so ends the thread
        if thread.ident is not None:
            thread.join(1.0)
        os.close(stdout)


def _read(descriptor: int, stdout: int, say: Callable[[str], object]) -> None:
    refusals = Refusals()
    with os.fdopen(descriptor, errors="replace") as lines:
        for line in lines:
            if _found(line) is None:  # a library of others printed it
                os.write(stdout, line.encode())
            elif sentence := refusals.take(line, time.monotonic()):
                say(sentence)
