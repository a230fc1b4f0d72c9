"""The console's ear: what the conductor and the simulators say becomes tables, pictures and events.

One thread calls :meth:`LiveWatch.turn`; pages are answered by others. Nothing is asked of a
simulator beyond the thumbnails that every viewer gets, and no table is made while nobody looks.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from schemas.escape import escape
from schemas.wire.codec import ATTACHMENT_BYTES_MAX, WireError, decode
from schemas.wire.status import CampaignStatus, CasePage, ConductorStatus
from schemas.wire.view import Thumbnail
from twin.base.errors import InfrastructureError, TwinError
from twin.fabric.bus import Sample
from twin.fabric.discovery import Target
from viewer.console.overview import table_version
from viewer.console.remote_files import RemoteFiles
from viewer.console.remote_run import MissedEndings, RemoteRun
from viewer.console.rig_clocks import RigClocks
from viewer.console.run_folder import CaseEnding, RunFolder
from viewer.console.shown_run import LiveFigures, LivePicture, ShownRun
from viewer.console.site import ConsoleSite
from viewer.console.stream import EventStream
from viewer.console.table import ConsoleTable
from viewer.live.link import (
    Cases,
    ConductorEvent,
    Heard,
    Link,
    LinkEnded,
    ReadClocks,
    Said,
    Status,
)
from viewer.live.pulse import sentence
from viewer.live.renewal import Renewal
from viewer.live.slots import LatestSlots
from viewer.live.throughput import Throughput

TURN_S = 0.25
"""Time between two turns [s]."""
PICTURES_S = 0.5
"""Shortest time between two events of pictures [s]: simulators send two a second."""
TABLE_S = 0.5
"""Shortest time between two tables [s]; large ones come less often, see :data:`TABLE_SHARE`."""
TABLE_SHARE = 20
"""A table is made when so many times as long has passed as the last one took: one core's
twentieth."""
CLOCKS_S = 15.0
"""Time between two readings of the rigs' clocks while somebody looks [s]."""
NEW_RIG_S = 1.0
"""The same while a rig shows pictures whose clock nobody has read [s]."""
LAG_SAID_S = 2.0
"""A line in the log says so when pictures are older than this, and another one when they are
younger than half of it [s]."""
SILENCE_S = 10.0
"""Time without a status after which nobody knows what runs [s]."""
PICTURE_BYTES_MAX = 64 << 10
"""Largest thumbnail that is kept [bytes]."""
PICTURES_MAX = 20_000
"""Most pictures of a campaign that are kept, those of ended cases among them."""
LINES_MAX = 500
"""Lines of the conductor's log that a page is given when it comes."""
PATH_CHARS_MAX = 4096
"""Longest path of a folder of the conductor that is shown [characters]."""
CAMPAIGNS_MAX = 256
"""Campaigns of one conductor that are shown."""


class LiveWatch:
    """Listens to one conductor for a :class:`ConsoleSite`."""

    def __init__(
        self,
        site: ConsoleSite,
        resolve: Callable[[], Target],
        stream: EventStream,
        *,
        here: bool,
        say: Callable[[str], None] = lambda _: None,
        files: RemoteFiles | None = None,
    ) -> None:
        """Make a watch that hears nothing yet.

        Args:
            site: what is shown; campaigns of the conductor are added to it.
            resolve: where the conductor is now.
            stream: takes the events.
            here: folders that the conductor names are at hand.
            say: takes a line for people.
            files: gives logs and KPI rows of campaigns whose folder is not at hand.
        """
        self.stream = stream
        self.slots = LatestSlots()
        self.status: ConductorStatus = {}
        """What the conductor said last; empty: nothing yet."""
        self.status_s: float | None = None
        """When it said that, by the monotonic clock [s]."""
        self.lines: list[dict[str, Any]] = []
        """Latest lines of the log."""
        self.charged: dict[str, dict[str, str]] = {}
        """Run -> cases that were charged and have not ended -> why."""
        self.strangers = 0
        """Messages of another version, or damaged."""
        self.error: TwinError | None = None
        """Why nothing is listened to any more."""
        self._site, self._here, self._say, self._files = site, here, say, files
        self.link = Link(resolve, None, self.slots, running=True)
        """Its session with the conductor."""
        self._runs: dict[str, ShownRun] = {}
        """Campaign -> what is shown of it."""
        self._paces: dict[str, Throughput] = {}
        self._missed: dict[str, MissedEndings] = {}
        self._sessions = 0
        self._tokens: dict[tuple[str, str], int] = {}
        self._renewal = Renewal()
        self._numbers = 0
        self._fresh: dict[str, dict[str, None]] = {}
        """Run -> cases with a picture since the last event."""
        self._tables: dict[str, tuple[tuple[Any, ...], ConsoleTable]] = {}
        self._due_s: dict[str, float] = {}
        self._pictures_s = 0.0
        self._clocks = RigClocks()
        self._clocks_s = -CLOCKS_S
        self._lags = False
        """The log says that pictures lag."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        site.live = True

    def start(self) -> None:
        """Begin to listen."""
        self.link.start()
        self._thread.start()

    def close(self) -> None:
        """End the session."""
        self._stop.set()
        self.link.close()
        if self._thread.is_alive():
            self._thread.join()
        self.stream.close()

    def shown(self, campaign: str) -> ShownRun | None:
        """What is shown of a campaign of the conductor; None: it is none of it."""
        return self._runs.get(campaign)

    def campaign_of(self, run: str) -> str | None:
        """Name of the campaign that a run of the site is, for the conductor; None: it is not
        this conductor's."""
        return next((name for name, shown in self._runs.items() if shown.run.id == run), None)

    @property
    def age_s(self) -> float | None:
        """Time since the conductor said anything; None: never [s]."""
        return None if self.status_s is None else time.monotonic() - self.status_s

    def turn(self, now_s: float) -> None:
        """Take in what came, and tell the pages; ``now_s`` by the monotonic clock.

        Raises:
            TwinError: waiting does not help any more.
        """
        self._hear(now_s)
        if self.status_s is not None and now_s - self.status_s > SILENCE_S:
            self._silent()
        for sample in self.slots.take():
            self._thumbnail(sample, now_s)
        if self.stream.followers:
            self._tell_tables(now_s)
            if now_s - self._pictures_s >= PICTURES_S:
                self._pictures_s = now_s
                self._read_clocks(now_s)
                self._tell_pictures(now_s)

    def take(self, heard: Heard, now_s: float) -> None:
        """Take in one thing that was heard.

        Raises:
            TwinError: waiting does not help any more.
        """
        match heard:
            case Status(found, first):
                self._sessions += first
                self._status(found, now_s)
                self._catch_up(found, now_s, rejoined=first and self._sessions > 1)
            case Cases(page):
                self._cases(page)
            case ConductorEvent(fact):
                self._fact(fact)
            case Said(line):
                self._say(line)
                self._log("info", line)
            case ReadClocks(readings, asked_s, answered_s):
                for reading in readings:
                    self._clocks.read(reading.rig, reading.clock_s, asked_s, answered_s)
            case LinkEnded(error):
                raise error

    def _run(self) -> None:
        while not self._stop.wait(TURN_S):
            try:
                self.turn(time.monotonic())
            except TwinError as error:
                self._end(error)
                return
            except Exception as error:
                # Without this thread pages would stand still for ever and say nothing.
                line = " ".join(str(error).split())
                self._end(InfrastructureError(f"{type(error).__name__}: {line}"))
                return

    def _end(self, error: TwinError) -> None:
        self.error = error
        self.stream.put("gone", {"error": str(error)})

    def _hear(self, now_s: float) -> None:
        for heard in self.link.waiting():
            self.take(heard, now_s)

    def _silent(self) -> None:
        """Nobody knows what runs while the conductor is away."""
        for shown in self._runs.values():
            shown.running, shown.live = frozenset(), None

    def _status(self, found: ConductorStatus, now_s: float) -> None:
        self.status, self.status_s = found, now_s
        for name in self._renewal.status(found):
            self._begun_anew(name)
        running: dict[str, dict[str, None]] = {}
        for lease in found.get("running", []):
            running.setdefault(lease["campaign"], {})[lease["case"]] = None
        present = [worker for worker in found.get("workers", []) if worker.get("present")]
        for name, row in list(found.get("campaigns", {}).items())[:CAMPAIGNS_MAX]:
            shown = self._known(name, row)
            shown.running = frozenset(running.get(name, ()))
            for case in running.get(name, ()):
                shown.heard.leased(case)
            cases, left = row.get("cases", 0), row.get("left", 0)
            if isinstance(shown.run, RemoteRun):
                shown.run.complete = left == 0
                shown.away = escape(row.get("out", ""), PATH_CHARS_MAX)
            pace = self._paces.setdefault(name, Throughput())
            shown.live = LiveFigures(
                cases=cases,
                left=left,
                leased=row.get("leased", 0),
                paused=row.get("paused", False),
                per_minute=pace.count(cases - left, now_s),
                workers=len(present),
            )
        self.stream.put("workers", {"draining": found.get("draining", False)})

    def _catch_up(self, found: ConductorStatus, now_s: float, *, rejoined: bool) -> None:
        """Ask for the cases of campaigns of which something was missed: facts are not repeated.

        Where the folder is at hand its outcomes tell what was missed, unless something was taken
        back meanwhile.
        """
        for name, row in found.get("campaigns", {}).items():
            shown = self._runs.get(name)
            if shown is None:
                continue
            if not isinstance(shown.run, RemoteRun):
                if rejoined:
                    self._ask_cases(name, shown)
                continue
            anew = rejoined or name not in self._missed
            if shown.heard.full and not anew:
                continue  # the count of what is shown never comes to the conductor's
            missed = self._missed.setdefault(name, MissedEndings())
            said, heard = row.get("cases", 0) - row.get("left", 0), shown.heard.count_ended
            if missed.status(said, heard, now_s, anew=anew):
                self._ask_cases(name, shown)

    def _ask_cases(self, name: str, shown: ShownRun) -> None:
        shown.heard.asked()
        self.link.ask_cases(name)

    def _cases(self, page: CasePage) -> None:
        shown = self._runs.get(page["campaign"])
        if shown is None:
            return
        charged = self.charged.setdefault(shown.run.id, {})
        for row in page["cases"]:
            case, ending = row.get("case", ""), msgspec.convert(row, CaseEnding)
            if not case:
                continue  # of another version
            shown.heard.known(case, ending)
            if ending.outcome:
                charged.pop(case, None)
            elif ending.charges:
                charged[case] = escape(ending.charges[-1])

    def _known(self, name: str, row: CampaignStatus) -> ShownRun:
        """The run of a campaign; found by its folder where that is at hand, else made."""
        if name in self._runs:
            return self._runs[name]
        out = Path(row.get("out", ""))
        if self._here and _is_folder(out):
            for shown in self._site.runs.values():
                if shown.run.folder.resolve() == out.resolve():
                    break
            else:
                shown = self._site.add(RunFolder(out))
        else:
            shown = self._site.add(RemoteRun(name))
            shown.away, shown.files = "", self._files
        self._runs[name] = shown
        shown.campaign = name
        return shown

    def _begun_anew(self, name: str) -> None:
        """What was heard of a campaign is of another one of its name; a folder stays shown."""
        self._tokens = {key: t for key, t in self._tokens.items() if key[0] != name}
        self._paces.pop(name, None)
        self._missed.pop(name, None)
        shown = self._runs.get(name)
        if shown is None:
            return
        shown.heard.forget()
        shown.forget_attempts()
        shown.live_pictures, shown.running, shown.live = {}, frozenset(), None
        for kept in (self.charged, self._fresh, self._tables, self._due_s):
            kept.pop(shown.run.id, None)
        if isinstance(shown.run, RemoteRun):
            shown.run.complete = False  # the only one of its name
        else:
            shown.campaign = ""
            del self._runs[name]

    def _fact(self, fact: Mapping[str, Any]) -> None:
        try:
            self._log_fact(fact)
            self._case_fact(fact)
        except (KeyError, TypeError, AttributeError, msgspec.ValidationError):
            self.strangers += 1  # of another version: events are a courtesy

    def _log_fact(self, fact: Mapping[str, Any]) -> None:
        text = sentence(fact)
        if text:
            level = {"case_ended": "error", "attempt_ended": "warn"}.get(str(fact["fact"]), "info")
            self._log(level, text)

    def _case_fact(self, fact: Mapping[str, Any]) -> None:
        result = fact.get("result")
        campaign = str((result if isinstance(result, dict) else fact).get("campaign", ""))
        shown = self._runs.get(campaign)
        if shown is None:
            return
        charged = self.charged.setdefault(shown.run.id, {})
        match fact.get("fact"):
            case "committed":
                if not isinstance(result, dict):
                    raise TypeError("a result that is none")
                shown.heard.committed(result, fact["worker"], fact["attempt"])
                charged.pop(result["case"], None)
            case "case_ended":
                shown.heard.ended(fact["case"], fact["outcome"], fact["reason"])
                charged.pop(fact["case"], None)
            case "attempt_ended" if fact["charged"]:
                charged[fact["case"]] = escape(fact.get("detail") or fact["reason"])
            case "retried":
                shown.heard.waits_again(fact["case"])

    def _thumbnail(self, sample: Sample, now_s: float) -> None:
        if not sample.key.endswith("/thumbnail") or len(sample.payload) > PICTURE_BYTES_MAX:
            self.strangers += 1
            return
        try:
            thumbnail: Thumbnail = decode(sample.attachment, Thumbnail, ATTACHMENT_BYTES_MAX)
        except WireError:
            self.strangers += 1
            return
        shown = self._runs.get(thumbnail.campaign)
        key = (thumbnail.campaign, thumbnail.case)
        if shown is None or thumbnail.token < self._tokens.get(key, 0):
            return  # of nobody's campaign, or of an attempt that is over
        pictures = shown.live_pictures
        if thumbnail.case not in pictures and len(pictures) >= PICTURES_MAX:
            return
        self._tokens[key] = thumbnail.token
        self._numbers += 1
        pictures[thumbnail.case] = LivePicture(
            *(bytes(sample.payload), thumbnail.sim_time_ns, self._numbers, now_s),
            rig=thumbnail.rig,
            at_s=thumbnail.at_s,
        )
        shown.heard.seen(thumbnail)
        self._fresh.setdefault(shown.run.id, {})[thumbnail.case] = None

    def _tell_tables(self, now_s: float) -> None:
        for shown in list(self._runs.values()):
            name = shown.run.id
            known = self._tables.get(name)
            if now_s < self._due_s.get(name, 0.0) or (known and known[0] == shown.version):
                continue
            began_s = time.monotonic()
            version = shown.version
            try:
                table = shown.table()
            except (TwinError, OSError) as error:
                self._log("warn", str(error))
                self._due_s[name] = now_s + TABLE_S * TABLE_SHARE
                continue
            if known is None:  # a page that read it before would miss what changed since
                event = {"run": name, "version": table_version(shown), "reset": True}
                self.stream.put("table", event)
            else:
                self._tell_change(shown, known[1], table)
            self._tables[name] = version, table
            took_s = time.monotonic() - began_s
            self._due_s[name] = now_s + max(TABLE_S, TABLE_SHARE * took_s)

    def _tell_change(self, shown: ShownRun, before: ConsoleTable, table: ConsoleTable) -> None:
        event: dict[str, Any] = {"run": shown.run.id, "version": table_version(shown)}
        if table.cases[: len(before.cases)] != before.cases or table.heads != before.heads:
            event["reset"] = True  # other columns, or cases in another order: ask for all anew
        else:
            event["rows"] = table.changed_rows(before)
            event["cases"] = table.cases[len(before.cases) :]
        self.stream.put("table", event)

    def _read_clocks(self, now_s: float) -> None:
        """Ask rigs for their clocks, when it is time for that."""
        fresh = (
            self._site.runs[name].live_pictures.get(case)
            for name, cases in self._fresh.items()
            for case in cases
        )
        unknown = any(p is not None and p.rig and not self._clocks.knows(p.rig) for p in fresh)
        if now_s - self._clocks_s >= (NEW_RIG_S if unknown else CLOCKS_S):
            self._clocks_s = now_s
            self.link.read_clocks()

    def _tell_pictures(self, now_s: float) -> None:
        told = []
        for name, cases in self._fresh.items():
            shown = self._site.runs[name]
            try:
                places = shown.places()
            except (TwinError, OSError):
                continue  # its table says why
            pictures = [
                (places[case], picture)
                for case in cases
                if case in places and (picture := shown.live_pictures.get(case)) is not None
            ]
            if pictures:
                told.append(self._tell_ages(name, pictures, now_s))
        self._fresh = {}
        if told:
            worst_s, simulators = max(told)
            self._tell_lag(worst_s, simulators=simulators)

    def _tell_ages(
        self, name: str, pictures: list[tuple[int, LivePicture]], now_s: float
    ) -> tuple[float, bool]:
        """Say which pictures of a campaign came, and how old they are: since the simulator was
        there, or where its clock is not known since they came here.

        Returns:
            the age of the oldest [s], and whether all count from their simulators.
        """
        rows, off_s = [], 0.0
        simulators = True
        for place, picture in pictures:
            age_s = now_s - picture.came_s
            age = (
                None if picture.at_s is None else self._clocks.age(picture.rig, picture.at_s, now_s)
            )
            if age is None:
                simulators = False
            else:
                # It cannot have come before it was made.
                age_s, off_s = max(age_s, age.age_s), max(off_s, age.within_s)
            rows.append([place, picture.number, picture.sim_time_ns / 1e9, round(age_s, 3)])
        event = {"run": name, "pictures": rows, "from": "simulator" if simulators else "console"}
        self.stream.put("picture", event | {"within_s": round(off_s, 3) if simulators else None})
        return max(row[3] for row in rows), simulators

    def _tell_lag(self, worst_s: float, *, simulators: bool) -> None:
        if (worst_s > LAG_SAID_S * (0.5 if self._lags else 1.0)) == self._lags:
            return
        self._lags = not self._lags
        least = "" if simulators else "at least "
        words = f"lag {least}{worst_s:.1f} s behind" if self._lags else "are up to date with"
        self._log("warn" if self._lags else "info", f"pictures {words} the simulators")

    def _log(self, level: str, text: str) -> None:
        line = {"at_s": time.time(), "level": level, "text": escape(text)}
        self.lines = [*self.lines[-LINES_MAX + 1 :], line]
        self.stream.put("log", line)


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False  # as one that may not be looked at
