"""The viewer's session over real Zenoh: a conductor that is late, gone, back, strange."""

import queue
import socket
import threading
import time

import pytest
from waiting import PATIENCE_S, wait_for

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Explain, Reply, Request
from schemas.wire.view import ClockReading, SceneMesh
from twin.base.errors import UnreachableError, UsageError
from twin.fabric.discovery import Target
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus
from viewer.live import link as linking
from viewer.live.link import (
    Cases,
    ConductorEvent,
    Link,
    LinkEnded,
    ReadClocks,
    Said,
    SentWorld,
    Status,
)
from viewer.live.slots import LatestSlots


class Conductor:
    """Answers as a conductor does, from a router of its own."""

    def __init__(self, port, version=SCHEMA_VERSION, key=None):
        self.version = version
        self.pages = None
        """Position -> page of cases; None: an earlier release, which has none."""
        self.asked = []
        protocol = "tls" if key else "tcp"
        self.bus = open_bus("router", listen=[f"{protocol}/127.0.0.1:{port}"], key=key)
        self.bus.serve(topics.RPC_STATUS.key, self.answer)

    def answer(self, payload, respond):
        request = decode(payload, Request)
        status = {"campaigns": {"demo": {"cases": 2, "left": 1}}}
        error = ""
        if isinstance(request, Explain):
            status = {"explain": ["waits: no worker is here"]}
            error = "" if request.case == "clear" else f"no case '{request.case}'"
        elif request.cases:
            self.asked.append(request.first)
            if self.pages is not None:
                status = {"page": self.pages[request.first]} if request.first in self.pages else {}
                error = "" if status else "no such campaign"
        respond(encode(Reply(v=self.version, epoch=1, error=error, status=status)))

    def close(self):
        self.bus.close()


class Line:
    """A TCP line between a viewer and the conductor that can be cut.

    What is sent meanwhile is swallowed, as by a network that is down: nobody hears of it.
    """

    def __init__(self, port):
        self.to = port
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.up = True
        self.ends = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self.to))
            self.ends += [near, far]
            torn = threading.Event()
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._copy, args=(source, sink, torn), daemon=True).start()

    def _copy(self, source, sink, torn):
        try:
            while data := source.recv(65536):
                if not self.up:
                    torn.set()  # for good: what was swallowed is missing
                if not torn.is_set():
                    sink.sendall(data)
        except OSError:
            pass

    def close(self):
        self.listener.close()
        for end in self.ends:
            end.close()


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """No request is repeated and no session begun anew because this machine is busy."""
    for name in ("SILENCE_S", "CONNECT_S", "ASK_S"):
        monkeypatch.setattr(linking, name, PATIENCE_S)
    monkeypatch.setattr(linking, "PERIOD_S", 0.1)


@pytest.fixture
def hasty(monkeypatch, patient):
    """Of a conductor that is not there a link hears soon, and on a busy machine also of one that
    is: its tests wait for the line that they are about."""
    monkeypatch.setattr(linking, "SILENCE_S", 0.6)
    monkeypatch.setattr(linking, "CONNECT_S", 0.5)
    monkeypatch.setattr(linking, "ASK_S", 0.5)


def connect(opened, port, wait_s=None, slots=None):
    target = Target(f"tcp/127.0.0.1:{port}", "twin", None)
    link = Link(lambda: target, wait_s, slots or LatestSlots())
    opened.append(link)
    link.start()
    return link


def serve(opened, port, **options):
    conductor = Conductor(port, **options)
    opened.append(conductor)
    return conductor


def hear(link, kind):
    """The next of its kind; everything else is passed over."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        try:
            heard = link.heard.get(timeout=0.1)
        except queue.Empty:
            continue
        if isinstance(heard, kind):
            return heard
    raise AssertionError(f"no {kind.__name__}")


def hear_said(link, *words):
    """The next line that has one of ``words``; other lines are passed over."""
    while True:
        line = hear(link, Said).line
        if any(word in line for word in words):
            return line


@pytest.mark.usefixtures("hasty")
def test_started_before_the_conductor(opened, port):
    link = connect(opened, port)
    assert "waiting for it (Ctrl-C ends)" in hear(link, Said).line
    serve(opened, port)
    assert hear_said(link, "connected") == f"connected to tcp/127.0.0.1:{port}"
    assert hear(link, Status).found["campaigns"]["demo"]["left"] == 1


@pytest.mark.usefixtures("hasty")
def test_gives_up_when_told_so(opened, port):
    link = connect(opened, port, wait_s=0)
    error = hear(link, LinkEnded).error
    assert isinstance(error, UnreachableError)
    assert "nobody answers" in str(error)


def test_gives_up_where_a_session_opens_but_nobody_answers(opened, port, monkeypatch):
    monkeypatch.setattr(linking, "SILENCE_S", 0.6)
    monkeypatch.setattr(linking, "ASK_S", 0.5)
    opened.append(open_bus("router", listen=[f"tcp/127.0.0.1:{port}"]))
    link = connect(opened, port, wait_s=0)
    error = hear(link, LinkEnded).error
    assert isinstance(error, UnreachableError)
    assert "check --namespace" in str(error)


def test_what_nobody_expects_is_the_end_and_is_told(opened):
    def resolve():
        raise ValueError("strange")

    link = Link(resolve, None, LatestSlots())
    opened.append(link)
    link.start()
    assert str(hear(link, LinkEnded).error) == "ValueError: strange"


@pytest.mark.usefixtures("hasty")
def test_a_conductor_that_ends_and_comes_back(opened, port):
    first = serve(opened, port)
    slots = LatestSlots()
    link = connect(opened, port, slots=slots)
    hear(link, Status)
    first.close()
    assert hear_said(link, "does not answer any more", "nobody answers")
    second = serve(opened, port)
    hear(link, Status)
    key = topics.VIEW_THUMBNAIL.key.format(campaign="c", case="1")
    wait_for(lambda: second.bus.wanted(key), "the subscription")

    def seen():
        second.bus.publish("view/c/1/thumbnail", b"x")
        return slots.counters.received

    wait_for(seen, "what was published: it has subscribed again")


@pytest.mark.usefixtures("hasty")
def test_a_line_that_is_cut_and_mended(opened, port):
    serve(opened, port)
    line = Line(port)
    opened.append(line)
    link = connect(opened, line.port)
    hear(link, Status)
    line.up = False
    hear(link, Said)
    line.up = True
    assert hear_said(link, "connected")
    hear(link, Status)
    assert link.sessions >= 2


def test_another_version_is_the_end(opened, port):
    serve(opened, port, version=SCHEMA_VERSION + 1)
    error = hear(connect(opened, port), LinkEnded).error
    assert isinstance(error, UsageError)
    assert "install the same version on both sides" in str(error)


@pytest.mark.usefixtures("hasty")
def test_nobody_but_a_router(opened, port):
    opened.append(open_bus("router", listen=[f"tcp/127.0.0.1:{port}"]))
    assert hear_said(connect(opened, port), "check --namespace")


def test_a_case_that_nobody_knows(opened, port):
    serve(opened, port)
    link = connect(opened, port)
    link.look_at("clear")
    assert hear(link, Said).line == "clear: waits: no worker is here"
    link.look_at("foggy")
    error = hear(link, LinkEnded).error
    assert isinstance(error, UsageError)
    assert "no case 'foggy' in demo" in str(error)


def test_looking_away_ends_the_stream(opened, port):
    conductor = serve(opened, port)
    link = connect(opened, port)
    hear(link, Status)
    key = topics.live_keys("*", "clear")
    link.look_at("clear")
    wait_for(lambda: conductor.bus.wanted(key), "the look")
    link.look_away("clear")
    wait_for(lambda: not conductor.bus.wanted(key), "the end of it")


def test_worlds_and_events_come_as_they_are(opened, port):
    conductor = serve(opened, port)
    mesh = SceneMesh(v=SCHEMA_VERSION, sha256="a", vertices=0, faces=0, data=b"")
    conductor.bus.serve(topics.FEED_SCENE.key.format(rig="r"), lambda _, r: r(encode(mesh)))
    link = connect(opened, port)
    hear(link, Status)
    link.send_for("r", "a")
    assert hear(link, SentWorld).mesh == mesh
    link.send_for("gone", "b")
    assert hear(link, SentWorld) == SentWorld("b", None)
    conductor.bus.publish(topics.EVENT.key, b"nonsense")
    conductor.bus.publish(topics.EVENT.key, encode(Reply(v=SCHEMA_VERSION, epoch=7)))
    assert hear(link, ConductorEvent).fact["epoch"] == 7


def test_cases_come_page_by_page_until_there_are_no_more(opened, port):
    conductor = serve(opened, port)
    pages = [
        {"campaign": "demo", "next": following, "cases": [{"case": f"c{first}", "outcome": ""}]}
        for first, following in ((0, 1), (1, 2), (2, None))
    ]
    conductor.pages = dict(enumerate(pages))
    link = connect(opened, port)
    assert hear(link, Status).first
    assert not hear(link, Status).first
    link.ask_cases("demo")
    assert [hear(link, Cases).page for _ in pages] == pages
    hear(link, Status)
    assert conductor.asked == [0, 1, 2]
    conductor.pages = {0: pages[0] | {"next": 0}}
    link.ask_cases("demo")
    hear(link, Cases)
    for _ in range(2):
        hear(link, Status)
    assert conductor.asked == [0, 1, 2, 0], "a page that leads nowhere is the last one"


@pytest.mark.parametrize("pages", [None, {}])
def test_a_conductor_that_has_no_such_cases_is_asked_once(opened, port, pages):
    conductor = serve(opened, port)
    conductor.pages = pages
    link = connect(opened, port)
    hear(link, Status)
    link.ask_cases("demo")
    for _ in range(3):
        hear(link, Status)
    assert conductor.asked == [0]


def test_clocks_of_all_rigs_are_read_at_once(opened, port, monkeypatch):
    monkeypatch.setattr(linking, "CLOCK_S", PATIENCE_S)
    conductor = serve(opened, port)
    for rig, answer in (("a", ClockReading(1, "a", 5.0)), ("b", ClockReading(1, "b", 7.0))):
        key = topics.FEED_CLOCK.key.format(rig=rig)
        conductor.bus.serve(key, lambda _, r, answer=answer: r(encode(answer)))
    conductor.bus.serve(topics.FEED_CLOCK.key.format(rig="c"), lambda _, r: r(b"nonsense"))
    link = connect(opened, port)
    hear(link, Status)
    link.read_clocks()
    read = hear(link, ReadClocks)
    assert sorted((r.rig, r.clock_s) for r in read.readings) == [("a", 5.0), ("b", 7.0)]
    assert read.asked_s < read.answered_s <= time.monotonic()


def test_another_key_is_the_end(opened, port, tmp_path):
    ours, theirs = (make_keys(tmp_path / name) for name in ("ours", "theirs"))
    keys = [load_key(ours, Role.conductor), load_key(theirs, Role.viewer)]
    endpoint = f"tls/127.0.0.1:{port}"
    opened.append(open_bus("router", listen=[endpoint], key=keys[0]))
    link = Link(lambda: Target(endpoint, "twin", keys[1]), None, LatestSlots())
    opened.append(link)
    link.start()
    error = hear(link, LinkEnded).error
    assert error.exit_code == 2
    assert "it is of another fabric" in str(error)
