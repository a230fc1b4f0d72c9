"""``viewer live``: the wall of all running cases, and single ones in full."""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.wire.codec import ATTACHMENT_BYTES_MAX, WireError, decode
from schemas.wire.view import Thumbnail
from schemas.words import counted
from twin.base.command import StopSignal
from twin.base.errors import UnreachableError, UsageError
from twin.fabric.bus import Sample
from twin.fabric.discovery import Target, choose_target, find_target, refuse_ended
from twin.fabric.endpoint import check_protected
from twin.fabric.keys.key_file import UnfitKeyError
from twin.fabric.keys.roles import Role
from viewer.live.focus import FocusedCase, Scenes, open_stream
from viewer.live.hub import ViewerHub, open_hub
from viewer.live.link import ConductorEvent, Link, LinkEnded, Said, SentWorld, Status
from viewer.live.overview import Overview
from viewer.live.prompt import HINT, Typed, choose, has_terminal
from viewer.live.pulse import Pulse
from viewer.live.renewal import Renewal
from viewer.live.slots import LatestSlots
from viewer.live.tunnel import Far, Tunnel
from viewer.playback import native
from viewer.playback.window import ViewerWindow, window

TURN_S = 0.05
"""Time between two rounds over the slots: twice as often as a single case's streams come [s]."""

WALL_S = 0.5
"""Shortest time between two pictures of the wall [s]."""

FOCUS_MAX = 8
"""Cases in full at the same time, at most."""


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """What the command line says."""

    connect: str = ""
    """The conductor's endpoint; or:"""
    run: Path | None = None
    """State or campaign folder, whose ``conductor.json`` may change meanwhile."""
    ssh: str = ""
    """Host that ssh reaches; the options above are meant as that host sees them."""
    node: str = ""
    """Host behind it that the tunnel ends at."""
    namespace: str = "twin"
    key: Path | None = None
    """Key file or folder of keys, for an endpoint with TLS; an invitation says where that is."""
    role: Role = Role.viewer
    """Role of the key that is taken from a folder of several."""
    cases: tuple[str, ...] = ()
    """Cases to show in full."""
    wait_s: float | None = None
    """Longest wait for a conductor; None: for ever [s]."""
    port: int = 0
    """Port of the hub on loopback; 0: a free one."""
    show: bool = True
    """Open a window if there is a display."""
    json: bool = False

    def __post_init__(self) -> None:
        """Refuse what leads nowhere, or to two places."""
        places = bool(self.connect) + (self.run is not None)
        if places > 1 or (not places and (self.key is None or self.ssh)):
            raise UsageError(
                "give one of --connect tls/HOST:PORT and --run FOLDER, or the --key of an "
                "invitation, which names the conductor"
            )
        if self.node and not self.ssh:
            raise UsageError("--node is reached through --ssh me@login; give both")

    @property
    def where(self) -> str:
        """Name of the conductor for people."""
        place = self.connect or str(self.run or self.key)
        return f"{self.ssh}:{place}" if self.ssh else place

    def check(self) -> None:
        """Before anybody waits for a conductor; a folder that is about to come is waited for only
        by those who say how long.

        Raises:
            UsageError: none will come to this folder.
        """
        if self.run is None or self.ssh or (self.wait_s is not None and not self.run.exists()):
            return
        refuse_ended(self.run)

    def tunnel(self) -> Tunnel | None:
        """The way there, not opened yet; None: straight.

        Raises:
            UsageError: there is no ssh here, or its host is none.
        """
        if not self.ssh:
            return None
        far = Far(self.ssh, self.node, self.connect, self.run.as_posix() if self.run else "")
        return Tunnel(far, self.namespace, self.key, self.role)

    def target(self) -> Target:
        """Place of the conductor now.

        Raises:
            UnreachableError: its folder does not say (yet).
            UsageError: it will never be found this way.
        """
        if self.run is None:
            return choose_target(self.connect, None, self.namespace, self.key, self.role)
        try:
            return find_target(self.run, self.role, self.key)
        except UnfitKeyError:
            raise
        except UsageError as error:
            raise UnreachableError(str(error)) from None


def run_live(options: LiveOptions) -> int:
    """Show cases until Ctrl-C or until the window is closed; the exit code.

    Raises:
        UsageError: the port is in use, no such case, another key or another version.
        UnreachableError: no conductor came in time.
    """
    if len(options.cases) > FOCUS_MAX:
        raise UsageError(f"{len(options.cases)} cases given, at most {FOCUS_MAX} are shown in full")
    options.check()
    tunnel = options.tunnel()
    if options.run is None and tunnel is None:
        # What is wrong with the endpoint or the key is said at once.
        target = options.target()
        check_protected(target.endpoint, keyed=target.key is not None)
    stop = StopSignal()
    live = Live(options, open_hub(options.port, say=say), tunnel)
    with ExitStack() as stack:
        stack.callback(live.close)
        if tunnel is not None:
            stack.callback(tunnel.close)  # first: the link may be waiting for it
        _tell(live.hub, options)
        shown = None
        if options.show and native.has_display():
            shown = stack.enter_context(window(["--connect", live.hub.url]))
        typed = Typed()
        while not stop.wait(TURN_S):
            if live.connected:
                typed.start()
            for line in typed.take():
                live.choose(line)
            live.turn(time.time())
            if shown is not None and _closed(shown):
                break
    _conclude(live, options)
    return 0


class Live:
    """What one viewer process shows; one thread calls :meth:`turn` again and again."""

    def __init__(self, options: LiveOptions, hub: ViewerHub, tunnel: Tunnel | None = None) -> None:
        self.hub = hub
        self.overview = Overview()
        self.slots = LatestSlots()
        self.connected = False
        """The conductor has answered, once at least."""
        self.leased = 0
        """Cases that workers have, as the conductor says."""
        self.strangers = 0
        """Messages of another version, or damaged."""
        self._pulse = Pulse()
        self._renewal = Renewal()
        resolve = options.target if tunnel is None else tunnel.target
        self._link = Link(resolve, options.wait_s, self.slots)
        self._scenes = Scenes(self._link.send_for)
        self._focuses: dict[str, dict[str, FocusedCase]] = {}
        """Focused cases by case and, as several campaigns may have one of that name, by
        campaign."""
        self._waiting: dict[str, Sample] = {}
        """The newest of single cases, by key, until viewers keep up."""
        self._pending = False
        """The wall has changed."""
        self._shown_s = 0.0
        self._asked = options.cases
        for case in options.cases:
            self.look_at(case)
        self._link.start()

    @property
    def attempts(self) -> int:
        """Attempts shown in full."""
        return sum(focus.starts for focus in self._shown_in_full())

    def look_at(self, case: str) -> None:
        """Show a case in full."""
        self._focuses[case] = {}
        self._link.look_at(case)

    def choose(self, text: str) -> None:
        """Show the case that ``text`` means in full; of those chosen so, the first makes room."""
        running = [case for _, case in self.overview.tiles]
        case, line = choose(text, running)
        if line:
            say(line)
        if not case or case in self._focuses:
            return
        if len(self._focuses) >= FOCUS_MAX:
            oldest = next((c for c in self._focuses if c not in self._asked), None)
            if oldest is None:
                say(f"{FOCUS_MAX} cases are shown in full already, as --case asks")
                return
            self._link.look_away(oldest)
            for focus in self._focuses.pop(oldest).values():
                focus.close()
        self.look_at(case)

    def turn(self, now_s: float) -> None:
        """Take in what came, and log it if viewers keep up.

        Raises:
            TwinError: waiting does not help any more.
        """
        self._hear(now_s)
        for sample in self.slots.take():
            if sample.key.endswith("/thumbnail"):
                self._thumbnail(sample)
            else:
                self._waiting.pop(sample.key, None)
                self._waiting[sample.key] = sample
        due = now_s - self._shown_s >= WALL_S
        if not (self._waiting or due):
            return
        if not self.hub.open():
            return
        if due:
            self._shown_s = now_s
            self.hub.tell(self._pulse, now_s)
            if self._pending:
                self._pending = False
                self.hub.show(self.overview, now_s)
        waiting, self._waiting = self._waiting, {}
        for sample in waiting.values():
            self._single(sample)

    def close(self) -> None:
        """End the session and the recordings."""
        self._link.close()
        for focus in self._shown_in_full():
            focus.close()
        self.hub.close()

    def _hear(self, now_s: float) -> None:
        for heard in self._link.waiting():
            match heard:
                case Status(found):
                    self.connected = True
                    self.leased = sum(row["leased"] for row in found["campaigns"].values())
                    self._pulse.status(found, now_s)
                    self._renewed(self._renewal.status(found))
                case ConductorEvent(fact):
                    self._pulse.event(fact)
                    self._pending |= self.overview.event(fact)
                case Said(line):
                    say(line)
                    self._pulse.say(line)
                case SentWorld(sha256, mesh):
                    if wrong := self._scenes.came(sha256, mesh):
                        say(f"{wrong}; the street is drawn by its outlines")
                    for focus in self._shown_in_full():
                        focus.stand()
                case LinkEnded(error):
                    raise error

    def _renewed(self, campaigns: list[str]) -> None:
        for campaign in campaigns:
            self.overview.forget(campaign)
            for focuses in self._focuses.values():
                if campaign in focuses:
                    focuses[campaign].forget()

    def _shown_in_full(self) -> list[FocusedCase]:
        return [focus for focuses in self._focuses.values() for focus in focuses.values()]

    def _thumbnail(self, sample: Sample) -> None:
        try:
            thumbnail: Thumbnail = decode(sample.attachment, Thumbnail, ATTACHMENT_BYTES_MAX)
        except WireError as error:
            self._stranger(sample, error)
            return
        self._pending |= self.overview.take(thumbnail, sample.payload)

    def _single(self, sample: Sample) -> None:
        _, campaign, case, *_ = sample.key.split("/")
        focuses = self._focuses.get(case)
        if focuses is None:
            return
        if campaign not in focuses:
            focuses[campaign] = FocusedCase(
                lambda start: open_stream(self.hub.url, start), self._scenes
            )
        try:
            focuses[campaign].take(sample)
        except (WireError, ValueError) as error:
            self._stranger(sample, error)

    def _stranger(self, sample: Sample, error: Exception) -> None:
        if not self.strangers:
            say(f"{sample.key}: {error}; more of these are not told")
        self.strangers += 1


def say(line: str) -> None:
    """One line for people, on standard error."""
    print(f"viewer: {line}", file=sys.stderr, flush=True)


def _closed(shown: ViewerWindow) -> bool:
    return shown.process.poll() is not None


def _tell(hub: ViewerHub, options: LiveOptions) -> None:
    laptop = native.tunnel_commands(hub.port)
    if options.json:
        print(json.dumps({"hub": hub.url, "laptop": laptop}), flush=True)
        return
    print(f"cases of {options.where} on {hub.url}; Ctrl-C ends")
    if options.show and not native.has_display():
        print("no display here to open a window on")
    if has_terminal():
        print(HINT)
    print("on a laptop behind ssh, with the same rerun-sdk:")
    for line in laptop:
        print(f"  {line}", flush=True)


def _conclude(live: Live, options: LiveOptions) -> None:
    counters, hub = live.slots.counters, live.hub
    counts: dict[str, Any] = {
        "cases": len(live.overview.tiles),
        "ended": len(live.overview.verdicts),
        "received": counters.received,
        "overwritten": counters.overwritten,
        "refused": counters.refused,
        "strangers": live.strangers,
        "attempts_in_full": live.attempts,
        "logged": hub.logged,
        "skipped": hub.skipped,
    }
    if options.json:
        print(json.dumps(counts), flush=True)
        return
    print(
        f"{counts['received']} messages of {counted(counts['cases'], 'case')}, "
        f"{counts['ended']} ended; "
        f"{counts['logged']} pictures shown, {counts['skipped']} left out"
    )
