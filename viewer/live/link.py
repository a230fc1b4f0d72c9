"""The viewer's session with the conductor: waits for it, notices when it is gone, finds it again.

A thread of its own asks for the status every second, which is also how it knows that somebody is
there. What comes for the wall and for single cases goes to slots, everything else to a queue.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Explain, Reply, Request, StatusRequest
from schemas.wire.rpc_routes import route_key
from schemas.wire.status import CasePage, ConductorStatus
from schemas.wire.view import ClockReading, SceneMesh
from twin.base.errors import InfrastructureError, TwinError, UnreachableError, UsageError
from twin.fabric.bus import Bus, Cancel, Sample
from twin.fabric.discovery import Target
from twin.fabric.keys.key_file import UnfitKeyError
from twin.fabric.zenoh_bus import join
from viewer.live.slots import LatestSlots

CONNECT_S = 2.0
"""Longest time one try to connect may take [s]."""
ASK_S = 2.0
"""Longest time the conductor may take to answer [s]."""
PERIOD_S = 1.0
"""Time between two questions to the conductor, and between two looks for one that is gone [s]."""
SILENCE_S = 4.0
"""Time without a word after which a new session is tried [s]; as long as Zenoh's own lease."""
SCENE_S = 10.0
"""Longest time a simulator may take to hand out its world [s]."""
CLOCK_S = 1.0
"""Longest time that rigs may take to read their clocks [s]."""
EVENTS_MAX = 1000
"""Events that wait to be taken, at most; further ones are left out."""


@dataclass(frozen=True, slots=True)
class Status:
    """What the conductor says of itself."""

    found: ConductorStatus
    first: bool = False
    """The first one of a session: facts that were published before it may have been missed."""


@dataclass(frozen=True, slots=True)
class Cases:
    """Cases of a campaign as they stand."""

    page: CasePage


@dataclass(frozen=True, slots=True)
class ConductorEvent:
    """A fact of the conductor."""

    fact: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Said:
    """A line for people."""

    line: str


@dataclass(frozen=True, slots=True)
class SentWorld:
    """A world that was sent for; None: nobody handed it out."""

    sha256: str
    mesh: SceneMesh | None


@dataclass(frozen=True, slots=True)
class ReadClocks:
    """Clocks of rigs, each read at some moment between two of ours."""

    readings: list[ClockReading]
    asked_s: float
    """When they were asked, by our monotonic clock [s]."""
    answered_s: float
    """When all had answered [s]."""


@dataclass(frozen=True, slots=True)
class LinkEnded:
    """Waiting does not help."""

    error: TwinError


Heard = Status | Cases | ConductorEvent | Said | SentWorld | ReadClocks | LinkEnded


class _SilenceError(Exception):
    """A peer has not said a word for too long; the text says which."""


class Link:
    """See the module. Everything but :meth:`_run` and what it calls may be used by any thread."""

    def __init__(
        self,
        resolve: Callable[[], Target],
        wait_s: float | None,
        slots: LatestSlots,
        *,
        running: bool = False,
    ) -> None:
        """Make a link that has no session yet.

        Args:
            resolve: where the conductor is now; raises UnreachableError while nobody knows.
            wait_s: how long the first session may take to come about; None: for ever [s].
            slots: receives thumbnails and the samples of single cases.
            running: the status has the leases, too.
        """
        self.heard: queue.Queue[Heard] = queue.Queue(EVENTS_MAX)
        self.sessions = 0
        """Sessions that were opened."""
        self._resolve = resolve
        self._until_s = None if wait_s is None else time.monotonic() + wait_s
        self._slots = slots
        self._request = StatusRequest(v=SCHEMA_VERSION, running=running)
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._lock = threading.Lock()
        self._cases: set[str] = set()
        """Cases to be looked at alone."""
        self._asked: list[tuple[str, str]] = []
        """Worlds to be sent for: rig and digest."""
        self._clocks = False
        """Clocks of rigs are to be read."""
        self._missed: dict[str, int] = {}
        """Campaigns whose cases are to be asked for, from which position on."""
        self._subscribed: dict[str, Cancel] = {}
        self._checked: set[str] = set()
        """Cases that the conductor knows."""
        self._word_s = 0.0
        self._told = ""
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)

    def start(self) -> None:
        """Begin to look for the conductor."""
        self._thread.start()

    def close(self) -> None:
        """End the session."""
        self._stop.set()
        self._wake.set()
        self._thread.join(CONNECT_S + ASK_S)

    def look_at(self, case: str) -> None:
        """Subscribe to all of this case from now on."""
        with self._lock:
            self._cases.add(case)
        self._wake.set()

    def look_away(self, case: str) -> None:
        """Ask for no more of a case than its thumbnail."""
        with self._lock:
            self._cases.discard(case)
        self._wake.set()

    def send_for(self, rig: str, sha256: str) -> None:
        """Ask a rig for its world, which comes as a :class:`SentWorld`."""
        with self._lock:
            self._asked.append((rig, sha256))
        self._wake.set()

    def read_clocks(self) -> None:
        """Ask all rigs for their clocks, which come as :class:`ReadClocks`."""
        self._clocks = True
        self._wake.set()

    def ask_cases(self, campaign: str) -> None:
        """Ask for all cases of a campaign, which come as :class:`Cases`."""
        with self._lock:
            self._missed[campaign] = 0
        self._wake.set()

    # --- the link's thread ------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._session(self._resolve())
            except UnfitKeyError as error:
                self._say(LinkEnded(error))
                return
            except UnreachableError as error:
                if self._until_s is not None and time.monotonic() >= self._until_s:
                    self._say(LinkEnded(error))
                    return
                self._tell(f"{error}; waiting for it (Ctrl-C ends)")
            except TwinError as error:
                self._say(LinkEnded(error))
                return
            except WireError as error:
                self._say(LinkEnded(UsageError(f"the conductor: {error}")))
                return
            except _SilenceError as silence:
                if self._until_s is not None and time.monotonic() >= self._until_s:
                    self._say(LinkEnded(UnreachableError(str(silence))))
                    return
                self._tell(f"{silence}; waiting for it (Ctrl-C ends)")
            except Exception as error:
                # Without this thread the viewer would sit there for ever and say nothing.
                line = " ".join(str(error).split())
                self._say(LinkEnded(InfrastructureError(f"{type(error).__name__}: {line}")))
                return
            self._stop.wait(PERIOD_S)

    def _session(self, target: Target) -> None:
        bus = join(target, CONNECT_S)
        self.sessions += 1
        self._word_s = time.monotonic()
        try:
            bus.subscribe(topics.VIEW_THUMBNAIL.key.format(campaign="*", case="*"), self._on_view)
            bus.subscribe(topics.EVENT.key, self._on_event)
            self._subscribed = {}
            with self._lock:
                self._missed.clear()  # whoever needs them asks after the first status
            answered = False
            while not self._stop.is_set():
                self._follow(bus)
                answer = self._ask(bus, self._request)
                if answer is not None:
                    self._answered(bus, target, answer.status, first=not answered)
                    answered = True
                else:
                    self._silent(target, answered)
                self._fetch(bus)
                self._read(bus)
                if not self._ask_pages(bus):
                    self._wake.wait(PERIOD_S)
                self._wake.clear()
        finally:
            bus.close()

    def _answered(self, bus: Bus, target: Target, status: ConductorStatus, *, first: bool) -> None:
        self._word_s = time.monotonic()
        self._until_s = None
        if first and self._told:
            self._say(Said(f"connected to {target.endpoint}"))
            self._told = ""
        self._say(Status(status, first))
        self._check(bus, list(status.get("campaigns", {})))

    def _silent(self, target: Target, answered: bool) -> None:
        if time.monotonic() - self._word_s < SILENCE_S:
            return
        if answered:
            raise _SilenceError(f"{target.endpoint}: the conductor does not answer any more")
        raise _SilenceError(
            f"{target.endpoint}: no conductor of namespace '{target.namespace}' answers there; "
            "check --namespace"
        )

    def _follow(self, bus: Bus) -> None:
        """Subscribe to the cases that are looked at, and to no others."""
        with self._lock:
            cases = set(self._cases)
        for case in cases - self._subscribed.keys():
            keys = topics.live_keys("*", case)
            self._subscribed[case] = bus.subscribe(keys, self._on_view)
        for case in self._subscribed.keys() - cases:
            self._subscribed.pop(case)()

    def _check(self, bus: Bus, campaigns: list[str]) -> None:
        """Say what becomes of the cases that are looked at; one that nobody knows is a mistake."""
        with self._lock:
            fresh = sorted(self._cases - self._checked)
        for case in fresh if campaigns else []:
            replies = [
                self._ask(bus, Explain(v=SCHEMA_VERSION, campaign=name, case=case))
                for name in campaigns
            ]
            if any(reply is None for reply in replies):
                return  # asked again with the next status
            known = [reply for reply in replies if reply is not None and not reply.error]
            if not known:
                raise UsageError(
                    f"no case '{case}' in {', '.join(campaigns)}; the wall shows the names of "
                    "those that run, and the campaign folder's cases/ those that have begun"
                )
            self._checked.add(case)
            self._say(Said(f"{case}: {known[-1].status['explain'][0]}"))

    def _fetch(self, bus: Bus) -> None:
        with self._lock:
            asked, self._asked = self._asked, []
        for rig, sha256 in asked:
            data = bus.request(topics.FEED_SCENE.key.format(rig=rig), b"", SCENE_S)
            mesh: SceneMesh | None = None
            if data is not None:
                try:
                    mesh = decode(data, SceneMesh)
                except WireError as error:
                    self._tell(f"the world of rig {rig}: {error}")
            self._say(SentWorld(sha256, mesh))

    def _read(self, bus: Bus) -> None:
        if not self._clocks:
            return
        self._clocks = False
        asked_s = time.monotonic()
        answers = bus.gather(topics.FEED_CLOCK.key.format(rig="*"), b"", CLOCK_S)
        answered_s = time.monotonic()
        readings = []
        for data in answers:
            with contextlib.suppress(WireError):  # of another version: its pictures have no age
                readings.append(decode(data, ClockReading))
        self._say(ReadClocks(readings, asked_s, answered_s))

    def _ask_pages(self, bus: Bus) -> bool:
        """Ask for cases, for as long as the status can wait; whether there are more."""
        until_s = time.monotonic() + PERIOD_S
        while not self._stop.is_set() and time.monotonic() < until_s:
            with self._lock:
                campaign, first = next(iter(self._missed.items()), ("", 0))
            if not campaign:
                return False
            request = StatusRequest(v=SCHEMA_VERSION, cases=campaign, first=first)
            reply = self._ask(bus, request)
            if reply is None:
                return False  # asked again after the next status
            page = reply.status.get("page")  # conductors of earlier releases have none
            after = page["next"] if page is not None else None
            with self._lock:
                if self._missed.get(campaign) == first:  # else it was asked for anew
                    del self._missed[campaign]
                    if after is not None and after > first:
                        self._missed[campaign] = after
            if page is not None:
                self._say(Cases(page))
        return bool(self._missed)

    def _ask(self, bus: Bus, request: Request) -> Reply | None:
        """The reply to a request; None: there was none, ask again.

        Raises:
            WireError: it is of another version.
        """
        data = bus.request(route_key(request), encode(request), ASK_S)
        return None if data is None else decode(data, Reply)

    def _on_view(self, sample: Sample) -> None:
        self._word_s = time.monotonic()
        self._slots.put(sample)

    def _on_event(self, sample: Sample) -> None:
        try:
            fact: dict[str, Any] = decode(sample.payload, dict[str, Any])
        except WireError:
            return  # events are a courtesy
        try:
            self.heard.put_nowait(ConductorEvent(fact))
        except queue.Full:
            pass  # as above

    def _tell(self, line: str) -> None:
        """Once, until something else is told."""
        if line != self._told:
            self._told = line
            self._say(Said(line))

    def waiting(self) -> Iterator[Heard]:
        """What was heard and not taken yet, until nothing waits."""
        while True:
            try:
                yield self.heard.get_nowait()
            except queue.Empty:
                return

    def _say(self, heard: Heard) -> None:
        while not self._stop.is_set():
            try:
                self.heard.put(heard, timeout=PERIOD_S)
                return
            except queue.Full:
                continue
