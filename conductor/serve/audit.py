"""``audit.jsonl``: who was refused, who came and went, and every command, a line of JSON each.

It is appended to, never rewritten, and bounded: of lines of a kind from one address so many per
minute are written and the others counted, and a full file becomes ``audit.1.jsonl``. It holds
certificates' serial numbers and no secrets.
"""

from __future__ import annotations

import contextlib
import datetime
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from schemas.escape import escape
from schemas.wire.control import Control, Request, Stop, Submit
from schemas.words import counted
from twin.fabric.keys.rights import Act, may
from twin.fabric.keys.roles import Role
from twin.fabric.refusals import Refusals

if TYPE_CHECKING:
    from twin.fabric.front.messages import FrontEvent

FILE_NAME = "audit.jsonl"
OLD_NAME = "audit.1.jsonl"

FILE_BYTES_MAX = 16 << 20
"""A file this large becomes the old one, which it replaces [bytes]."""
PERIOD_S = 60.0
LINES_MAX = 20
"""Most lines of a kind from one address in a period."""
ALL_LINES_MAX = 1_000
"""Most lines in a period."""
KEYS_MAX = 16
"""Most keys that a line names."""
WORDS_CHARS_MAX = 300
CUT_S = 3.0
"""How long to wait for a conductor that cuts a withdrawn key's sessions [s]."""

_log = logging.getLogger(__name__)


class AuditLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line. Empty fields are left away."""

    time: str
    """Time, UTC."""
    what: str
    """``refused``, ``opened``, ``closed``, ``slowed``, ``cut``, ``command``; or ``more``: so many
    lines like those before were left out."""
    peer: str = ""
    """Address."""
    role: str = ""
    key: str = ""
    """Serial number of the certificate, hexadecimal."""
    keys: tuple[str, ...] = ()
    """Keys that were connected and may send the message. Zenoh does not say which did."""
    said: str = ""
    """Reason, or the command."""
    count: int = 0


@dataclass(slots=True)
class _Group:
    like: AuditLine
    lines: int = 0
    more: int = 0


class Audit:
    """Writes the log of one state folder; may be called from any thread."""

    def __init__(self, folder: Path, clock: Callable[[], float] = time.time) -> None:
        self._folder = folder
        self._clock = clock
        self._lock = threading.Lock()
        self._groups: dict[tuple[str, str], _Group] = {}
        """(what, address) -> lines of this period."""
        self._begun_s = 0.0
        self._lines = 0
        self._members: Counter[tuple[str, str]] = Counter()
        self._refusals = Refusals()
        self._broken = False

    def heard(self, event: FrontEvent) -> None:
        """The front tells something."""
        with self._lock:
            member = (event.role, event.key)
            match event.what:
                case "opened":
                    self._members[member] += 1
                case "closed":
                    self._members[member] -= 1
                    if self._members[member] <= 0:
                        del self._members[member]
            log_event(event, self._refusals)
            self._write(
                AuditLine(
                    self._now(),
                    event.what,
                    peer=event.peer,
                    role=event.role,
                    key=event.key,
                    said=event.reason,
                    count=event.count if event.what == "cut" else 0,
                )
            )

    def refused(self, route: str, words: str) -> None:
        """A message that came on the RPC route ``route`` was refused."""
        self._message("refused", route, words)

    def asked(self, route: str, request: Request, error: str) -> None:
        """Request that came on the RPC route ``route``; it is logged if it is a command."""
        match request:
            case Submit():
                words = f"submit {request.campaign.get('campaign', '')}"
            case Control():
                named = (request.action, request.campaign, request.case, request.worker)
                words = " ".join(filter(None, named))
            case Stop():
                words = "stop"
            case _:
                return
        self._message("command", route, f"{words}: {error}" if error else words)

    def close(self) -> None:
        """Say what was left out so far."""
        with self._lock:
            self._say_more()

    def _message(self, what: str, route: str, words: str) -> None:
        with self._lock:
            roles = [role for role in Role if route and may(role, Act.ask, route)]
            keys = sorted({key for role, key in self._members if role in roles and key})
            self._write(
                AuditLine(
                    self._now(),
                    what,
                    role=" or ".join(role for role in roles if role is not Role.conductor),
                    keys=tuple(keys[:KEYS_MAX]),
                    said=escape(words, WORDS_CHARS_MAX),
                )
            )

    def _now(self) -> str:
        return datetime.datetime.fromtimestamp(self._clock(), datetime.UTC).isoformat(
            timespec="milliseconds"
        )

    def _write(self, line: AuditLine) -> None:
        now_s = self._clock()
        if not 0.0 <= now_s - self._begun_s < PERIOD_S:
            self._say_more()
            self._begun_s, self._lines = now_s, 0
        kind = (line.what, line.peer)
        if kind not in self._groups and len(self._groups) >= ALL_LINES_MAX:
            kind = (line.what, "")
        group = self._groups.setdefault(kind, _Group(line))
        if group.lines >= LINES_MAX or self._lines >= ALL_LINES_MAX:
            group.more += 1
            return
        group.lines += 1
        self._lines += 1
        self._append(line)

    def _say_more(self) -> None:
        for group in self._groups.values():
            if group.more:
                summary = f"and {group.more:,} more: {group.like.what}"
                peer, count = group.like.peer, group.more
                self._append(AuditLine(self._now(), "more", peer, said=summary, count=count))
        self._groups.clear()

    def _append(self, line: AuditLine) -> None:
        path = self._folder / FILE_NAME
        try:
            descriptor = os.open(
                path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600
            )
            try:
                os.write(descriptor, msgspec.json.encode(line) + b"\n")
                full = os.fstat(descriptor).st_size >= FILE_BYTES_MAX
            finally:
                os.close(descriptor)
            if full:
                path.replace(self._folder / OLD_NAME)
            self._broken = False
        except OSError as error:
            if not self._broken:
                _log.error("%s: cannot be written: %s", path, error.strerror)
            self._broken = True


def log_event(event: FrontEvent, refusals: Refusals) -> None:
    """Log what whoever watches the terminal should know of an event."""
    if event.what == "refused":
        if warning := refusals.count(event.reason, time.monotonic()):
            _log.warning("%s", warning)
    elif event.what == "cut":
        role = f" ({event.role})" if event.role else ""
        cut = counted(event.count, "session")
        _log.warning("key %s%s: %s, %s of it cut", event.key, role, event.reason, cut)


def await_cut(folder: Path, serial: int) -> Callable[[], int | None]:
    """Remember how far the log of ``folder`` has come. The answer waits for the line that a key was
    cut, and says how many sessions; None: no such line came, so nobody serves there."""
    path = folder / FILE_NAME
    begin = path.stat().st_size if path.exists() else 0

    def wait() -> int | None:
        until_s = time.monotonic() + CUT_S
        while time.monotonic() < until_s:
            with contextlib.suppress(OSError), path.open("rb") as file:
                file.seek(begin if begin <= os.fstat(file.fileno()).st_size else 0)
                for text in file:
                    with contextlib.suppress(msgspec.MsgspecError):
                        line = msgspec.json.decode(text, type=AuditLine)
                        if (line.what, line.key) == ("cut", f"{serial:x}"):
                            return line.count
            time.sleep(CUT_S / 30)
        return None

    return wait
