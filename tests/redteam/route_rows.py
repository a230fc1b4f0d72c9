"""Attacks from outside of a port: no key, or a page of another site."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from urllib.parse import urlsplit

import psutil
from attacks import Found, attack, refused_if
from case_changes import changed
from processes import keys_of, wait_for
from theatre import Theatre, ask

from schemas.wire import topics
from twin.fabric.discovery import find_conductor
from twin.fabric.endpoint import host_and_port
from twin.fabric.keys.key_file import MemberKey, load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

GARBAGE_PER_S = 15
JOINS_S = 2.0
"""A member has joined and was answered within this time."""
TURN_S = 15.0
"""So long it is quiet, then there is garbage for as long, and so on [s]."""
CASES = 100_000
"""As many as a campaign may have; another one follows when half of them have ended."""
RECORDING_BYTES = 300_000_000
DOWNLOADS = 12


def throw_garbage(address: tuple[str, int], over: threading.Event) -> None:
    """Connections that say nothing of use, some of which stay, until it is over."""
    kept: list[socket.socket] = []
    number = 0
    while not over.wait(1 / GARBAGE_PER_S):
        number += 1
        try:
            line = socket.create_connection(address, timeout=5)
            line.sendall((b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\x00\xff", b"")[number % 3])
        except OSError:
            continue
        kept.append(line)
        if len(kept) > 100:
            kept.pop(0).close()
    for line in kept:
        line.close()


class Pace:
    """A campaign at work, and how fast it is in quiet and in noise."""

    def __init__(self, theatre: Theatre) -> None:
        self._theatre = theatre
        self._campaigns = 0
        theatre.submit("at-work", CASES)
        log = (theatre.folder / "worker.log").open("w")
        words = ("twin", "worker", "--state", str(theatre.state), "--slots", "1")
        theatre.marked.start(*words, log=log)
        self._bus = theatre.own(Role.worker)
        self._cases: dict[bool, list[float]] = {False: [], True: []}
        wait_for(lambda: self._left() < CASES, "the first case")

    @contextmanager
    def measured(self, *, noise: bool) -> Iterator[None]:
        """Cases per minute of the block."""
        if self._left() < CASES / 2:
            self._campaigns += 1
            self._theatre.submit(f"at-work-{self._campaigns}", CASES)
        before, began_s = self._left(), time.monotonic()
        yield
        after, took_s = self._left(), time.monotonic() - began_s
        assert after, f"{TURN_S:g} s are too long"
        self._cases[noise].append(60 * (before - after) / took_s)

    def told(self) -> str:
        """Both, and their ratio."""
        quiet, noisy = (median(self._cases[noise]) for noise in (False, True))
        ratio = noisy / quiet if quiet else 0.0
        return (
            f"{noisy:,.0f} cases that simulate nothing a minute, {quiet:,.0f} without garbage "
            f"({ratio:.2f}x)"
        )

    def _left(self) -> int:
        answer = ask(self._bus, topics.RPC_STATUS.key, 30.0, verb="status")
        assert answer is not None, "no answer to a member"
        return int(answer["left"])


def join(endpoint: str, key: MemberKey) -> float | None:
    """How long a member took to join and be answered; None: it could not [s]."""
    began_s = time.monotonic()
    try:
        bus = open_bus("client", connect=[endpoint], key=key)
        answer = ask(bus, topics.RPC_STATUS.key, 10.0, verb="status")
        bus.close()
    except Exception:  # whatever kept it out
        return None
    return None if answer is None else time.monotonic() - began_s


@attack(6, f"{GARBAGE_PER_S} garbage connections a second", "somebody on the network", "none")
def garbage_connections(theatre: Theatre) -> Found:
    """Members join one after the other and a campaign is at work, for as long as was asked for; by
    turns without and with garbage."""
    theatre.serve()
    endpoint = find_conductor(theatre.state).endpoint
    key = load_key(keys_of(theatre.state), Role.worker)
    pace = Pace(theatre)
    joins: list[float | None] = []
    turns = max(1, round(60 * theatre.minutes / (2 * TURN_S)))
    for _ in range(turns):
        for noise in (False, True):
            over = threading.Event()
            thrower = threading.Thread(target=throw_garbage, args=(host_and_port(endpoint), over))
            if noise:
                thrower.start()
            try:
                with pace.measured(noise=noise):
                    until_s = time.monotonic() + 30 * theatre.minutes / turns
                    while time.monotonic() < until_s:
                        joined_s = join(endpoint, key)
                        joins += [joined_s] if noise else []
                        time.sleep(0.5)
            finally:
                over.set()
                if noise:
                    thrower.join()
    joined = [took_s for took_s in joins if took_s is not None]
    failed, late = len(joins) - len(joined), sum(each > JOINS_S for each in joined)
    told = f"{len(joined)} members joined, the slowest in {max(joined, default=0):.1f} s"
    return refused_if(
        bool(joined) and not failed and not late,
        f"a front owns the port; in {theatre.minutes / 2:g} min {told}; {pace.told()}",
        f"{told}, {failed} failed, {late} took longer than {JOINS_S:g} s; {pace.told()}",
    )


@attack(16, "reads `--metrics` beyond loopback", "somebody on the network", "none")
def metrics_beyond_loopback(theatre: Theatre) -> Found:
    """Does ``conductor serve`` offer it without being told --insecure?"""
    child = theatre.marked.start(
        *("conductor", "serve", "--state", str(theatre.state), "--metrics", "0.0.0.0:0")
    )
    try:
        _, err = child.communicate(timeout=30)
    except Exception:
        return Found("open", "served to the network without --insecure")
    return refused_if(
        child.returncode == 2 and "--insecure" in err, "needs `--insecure`", err[:100]
    )


class Pages:
    """``viewer web`` on a folder with one recording."""

    def __init__(self, theatre: Theatre) -> None:
        self.run = theatre.folder / "run"
        self.attempt = self.run / "cases" / "c" / "attempt-1"
        self.attempt.mkdir(parents=True)
        from unit.viewer.recorded_case import write

        write(self.attempt, case="c")
        self._theatre = theatre

    def open(self, folder: Path | None = None) -> int:
        """Start on the run, or a folder of several; its port."""
        where = str(folder or self.run)
        child = self._theatre.marked.start("viewer", "web", where, "--output", "json")
        assert child.stdout is not None
        line = child.stdout.readline()
        assert line, child.communicate()
        self.pid = child.pid
        return int(urlsplit(json.loads(line)["url"]).port or 0)


def asked(port: int, host: str = "", path: str = "/recording/c.rrd") -> tuple[int, bytes]:
    """Status and the beginning of a page."""
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        line.request("GET", path, headers={"Host": host} if host else {})
        answer = line.getresponse()
        return answer.status, answer.read(100)
    finally:
        line.close()


@attack(11, "`recording.rrd` as a link to a file of mode 0600", "who writes a run folder", "files")
def recording_as_a_link(theatre: Theatre) -> Found:
    """What `viewer web` sends of it."""
    pages = Pages(theatre)
    port = pages.open()
    before, _ = asked(port)
    path = pages.attempt / "recording.rrd"
    path.unlink()
    path.symlink_to(theatre.secret)
    status, data = asked(port)
    leaked = theatre.secret.read_bytes()[:20] in data
    assert before == 200, before
    return refused_if(not leaked, f"links are no recordings (HTTP {status})", "the file was sent")


@attack(11, "a page of another site reads the hub by a name of its own", "a web site", "none")
def other_host_header(theatre: Theatre) -> Found:
    """Another Host header than ours."""
    port = Pages(theatre).open()
    status, _ = asked(port, host="evil.example")
    return refused_if(status == 403, "only its own names are answered", f"HTTP {status}")


@attack(11, "asks for the victim's pages", "another local user", "none", root=True)
def pages_of_another(theatre: Theatre) -> Found:
    """By the right name, as another user."""
    port = Pages(theatre).open()
    code = """
try:
    print(urllib.request.urlopen(f"http://127.0.0.1:{sys.argv[1]}/recording/c.rrd").status)
except urllib.error.HTTPError as error:
    print(error.code)
except OSError as error:
    print("closed")
"""
    said = theatre.as_nobody(code, str(port)).strip()
    return refused_if(said != "200", "only processes of its user are answered", f"HTTP {said}")


@attack(16, f"{DOWNLOADS} slow downloads of a 300 MB recording", "a browser", "none")
def slow_downloads(theatre: Theatre) -> Found:
    """How much memory the pages' process takes."""
    pages = Pages(theatre)
    with (pages.attempt / "recording.rrd").open("r+b") as file:
        file.truncate(RECORDING_BYTES)
    port = pages.open()
    asked(port, path="/")
    process = psutil.Process(pages.pid)
    before_mb = process.memory_info().rss / 1e6
    with ExitStack() as stack:
        for _ in range(DOWNLOADS):
            line = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
            stack.callback(line.close)
            line.request("GET", "/recording/c.rrd")
            line.getresponse().read(1000)
        taken_mb = process.memory_info().rss / 1e6 - before_mb
    return refused_if(
        taken_mb < RECORDING_BYTES / 1e6,
        f"sent from the disk, a piece at a time; {taken_mb:.0f} MB of memory",
        f"{taken_mb:.0f} MB of memory",
    )


@attack(16, "gives somebody a recorded drive that holds a command", "who sends files", "files")
def command_in_a_record(theatre: Theatre) -> Found:
    """Does `devkit replay` run it?"""

    from schemas import SCHEMA_VERSION
    from schemas.files.drive_record import RecordHead, RecordSeen
    from schemas.plan import parse_plan
    from schemas.sections.foreign import Foreign
    from twin.records.drive_record import RecordWriter

    ran = theatre.folder / "ran"
    plan, mistakes = parse_plan({"campaign": "c", "matrix": {"weather": ["clear"]}})
    assert plan is not None, mistakes
    cases = plan.cases
    foreign = Foreign(["/bin/sh", "-c", f"touch {ran}; exit 1"])
    case = changed(cases[0], stack="", foreign=foreign)
    path: Path = theatre.folder / "cases/clear/attempt-1/drive.record"
    writer = RecordWriter(path, RecordHead(SCHEMA_VERSION, 1, "", "cpu", 1, case))
    writer.write(RecordSeen(tick=0, sim_time_ns=0, sensors={}))
    writer.close()
    done = theatre.marked.run("devkit", "replay", str(theatre.folder), "--deadline-s", "5")
    return refused_if(
        not ran.exists() and done.returncode == 2,
        "shown, and run with `--run-command` alone",
        f"it ran: {ran.exists()}, exit code {done.returncode}",
    )
