"""The console's page in Chromium, `viewer web` and a conductor, with lines between them that are
cut: the page goes on without a reload."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from typing import Any
from urllib.parse import urlsplit

import pytest
from browser_pages import CHROMIUM, CUT, PATIENCE_MS, OpenedPages, chromium
from console_pages import ConsolePage
from cut_lines import CutLine
from free_ports import reserved_port
from processes import PATIENCE_S, keys_of, wait_for
from test_conductor_restart import serve

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Hello, Lease, Next, Reply, Request, Result
from schemas.wire.rpc_routes import route_key
from twin.base.software import software_digest
from twin.fabric.discovery import find_conductor, find_target
from twin.fabric.keys.roles import Role
from twin.fabric.session import new_secret
from twin.fabric.zenoh_bus import join, open_bus
from viewer.console.stream import EVENTS_MAX

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)

CASES = 6
ASLEEP_S = float(os.environ.get("CONSOLE_ASLEEP_S", "0"))
"""How long a browser sleeps beyond what it takes to forget its events; 3600 is the hour [s]."""
BURST = 400
"""Facts that are published at once: fewer than a session keeps for who is late."""


class Conductor:
    """Answers for one campaign of which the first cases have ended, from a router of its own."""

    def __init__(self, port: int) -> None:
        self.ended = 0
        self.port = port
        self.start()

    def start(self) -> None:
        """Listen, at the port of before."""
        self.bus = open_bus("router", listen=[f"tcp/127.0.0.1:{self.port}"])
        self.bus.serve(topics.RPC_STATUS.key, self._answer)

    def end(self, *, told: bool = True) -> None:
        """One more case has ended; ``told``: its fact is published."""
        case, self.ended = f"c{self.ended}", self.ended + 1
        result = {"campaign": "demo", "case": case, "outcome": "verdict"}
        result |= {"verdict": "collision", "reasons": ["collided at 9 m/s"]}
        if told:
            self.say(fact="committed", result=result, worker="w1", attempt=1)

    def say(self, *, block: bool = False, **fact: Any) -> None:
        """Publish a fact; ``block``: none is dropped because many are under way."""
        self.bus.publish(topics.EVENT.key, encode(fact), block=block)

    def _answer(self, data: bytes, respond: Any) -> None:
        decode(data, Request)
        row = {"cases": CASES, "left": CASES - self.ended, "leased": CASES - self.ended}
        lease = {"campaign": "demo", "worker": "w1", "host": "n1", "attempt": 1, "tick": 1}
        lease |= {"for_s": 1.0, "by_hand": ""}
        running = [lease | {"case": f"c{number}"} for number in range(self.ended, CASES)]
        status = {"campaigns": {"demo": row}, "workers": [], "running": running}
        respond(encode(Reply(v=SCHEMA_VERSION, epoch=1, status=status)))


@pytest.fixture(scope="module")
def browser():
    with chromium(sync_api) as browser:
        yield browser


@pytest.fixture
def conductor():
    with reserved_port() as port:
        conductor = Conductor(port)
        yield conductor
        conductor.bus.close()


@pytest.fixture
def inner(conductor):
    """The line between the console and its conductor."""
    line = CutLine(conductor.port)
    yield line
    line.close()


@pytest.fixture
def console(marked, inner):
    """`viewer web` over that line; its address."""
    where = ("--connect", f"tcp/127.0.0.1:{inner.port}", "--insecure")
    child = marked.start("viewer", "web", *where, "--output", "json")
    line = child.stdout.readline()
    assert line, child.stderr.read()
    yield json.loads(line)["url"]
    child.send_signal(signal.SIGINT)
    child.wait(PATIENCE_S)


@pytest.fixture
def outer(console):
    """The line between the browser and the console."""
    line = CutLine(urlsplit(console).port)
    yield line
    line.close()


@pytest.fixture
def page(browser, console, outer):
    """The page on the wall of the campaign, which must never be loaded anew."""
    page_url = f"http://127.0.0.1:{outer.port}/"
    seen = ConsolePage(console, "demo")
    wait_for(lambda: seen.data("runs.json")["runs"], "the campaign")
    pages = OpenedPages(browser)
    pages.allowed += CUT
    page = pages.open(f"{page_url}#/run/demo/wall")
    page.evaluate("window.stays = true")
    online(page, "live")
    running(page, CASES)
    yield page
    assert page.evaluate("window.stays") is True
    pages.check(page_url)


def online(page: Any, words: Any) -> None:
    expect(page.locator(".online")).to_have_text(words)


def running(page: Any, count: int) -> None:
    """So many cases run, and the others have collided, as the page says."""
    verdicts = page.get_by_role("group", name="Verdicts")
    expect(verdicts.get_by_role("button", name=f"{count} running", exact=True)).to_be_visible()
    if count < CASES:
        others = verdicts.get_by_role("button", name=f"{CASES - count} collision", exact=True)
        expect(others).to_be_visible()


@pytest.mark.parametrize("cut", ["hold", "tear"])
def test_a_network_that_was_down_for_longer_than_the_page_waits(page, outer, conductor, cut):
    conductor.end()
    running(page, CASES - 1)
    getattr(outer, cut)()
    online(page, "no connection; trying again")
    conductor.end()  # while the browser hears nothing
    outer.mend()
    online(page, "live")
    running(page, CASES - 2)
    conductor.end()
    running(page, CASES - 3)


@pytest.mark.parametrize("cut", ["hold", "tear"])
def test_a_console_that_was_cut_off_from_its_conductor(page, inner, conductor, cut):
    getattr(inner, cut)()
    online(page, re.compile("^conductor: no word from it"))
    inner.mend()
    online(page, "live")
    running(page, CASES)
    conductor.end()
    running(page, CASES - 1)


def test_a_conductor_that_is_restarted(page, conductor):
    conductor.end()
    running(page, CASES - 1)
    conductor.bus.close()
    online(page, re.compile("^conductor: no word from it"))
    conductor.start()
    online(page, "live")
    conductor.end()
    running(page, CASES - 2)


@pytest.mark.timeout(1200 + ASLEEP_S)
def test_a_browser_that_slept_until_nobody_remembers_what_it_missed(
    page, outer, conductor, console
):
    """Its lines are gone, what it saw last is no longer kept, and it runs no timers meanwhile."""
    debugger = page.context.new_cdp_session(page)
    witness = ConsolePage(console, "demo")
    witness.follow()
    wait_for(lambda: witness.hellos, "the witness")
    debugger.send("Page.setWebLifecycleState", {"state": "frozen"})
    outer.tear()
    conductor.end()
    for first in range(0, EVENTS_MAX + 1, BURST):
        for number in range(first, first + BURST):
            conductor.say(fact="worker_left", worker=f"w-{number}", reason="bye", block=True)
        wait_for(lambda last=number: said(witness, f"w-{last} "), "the facts on the stream")
    time.sleep(ASLEEP_S)
    outer.mend()
    debugger.send("Page.setWebLifecycleState", {"state": "active"})
    online(page, "live")
    running(page, CASES - 1)
    conductor.end()
    running(page, CASES - 2)
    witness.cut()


def said(witness: ConsolePage, words: str) -> bool:
    """Whether the log has a line with these words, among the latest ones."""
    return any(words in f"{line} " for line in witness.log[-BURST:])


class WorkerByHand:
    """A worker whose cases end when the test says so."""

    def __init__(self, state: Any) -> None:
        self.bus = join(find_target(state, Role.worker), PATIENCE_S)
        self.seq, self.secret = 0, new_secret()
        self.held: list[int] = []
        software = software_digest()
        self.ask(Hello(SCHEMA_VERSION, "w1", "n1", 1, "cpu", software, CASES, session=self.secret))

    def ask(self, request: Request) -> Reply:
        data = self.bus.request(route_key(request), encode(request), PATIENCE_S)
        assert data is not None, "no answer"
        reply: Reply = decode(data, Reply)
        assert not reply.error
        return reply

    def next(self, k: int, *results: Result) -> list[Lease]:
        """Commit results and lease up to ``k`` cases."""
        self.seq += 1
        own = {"worker": "w1", "seq": self.seq, "session": self.secret, "held": self.held}
        leases = self.ask(Next(v=SCHEMA_VERSION, k=k, results=list(results), **own)).leases
        self.held += [lease.token for lease in leases]
        return leases

    def end(self, lease: Lease) -> None:
        """Its case has ended."""
        case = lease.case
        self.held.remove(lease.token)
        self.next(0, Result(case.variation.campaign, case.id, lease.token, "verdict", "collision"))


@pytest.fixture
def state(marked, tmp_path):
    """A real conductor's folder, with a campaign of some cases."""
    state, campaign = tmp_path / "state", tmp_path / "demo.yaml"
    conductor = serve(marked, state, "--ttl-s", "600")
    campaign.write_text(
        f"campaign: demo\nsimulator: noop\nmatrix: {{repeat: {list(range(CASES))}}}\n"
    )
    done = marked.run("conductor", "submit", str(campaign), "--state", str(state))
    assert done.returncode == 0, done.stderr
    yield state
    conductor.send_signal(signal.SIGINT)
    conductor.wait(PATIENCE_S)


@pytest.mark.parametrize("cut", ["hold", "tear"])
def test_cases_that_ended_while_the_console_was_cut_off_from_its_conductor(
    marked, browser, state, cut
):
    """No folder is at hand and no fact is said twice: the console asks for what it missed."""
    worker = WorkerByHand(state)
    leases = worker.next(4)
    line = CutLine(int(find_conductor(state).endpoint.rpartition(":")[2]))
    where = ("--connect", f"tls/127.0.0.1:{line.port}", "--key", str(keys_of(state)))
    child = marked.start("viewer", "web", *where, "--output", "json")
    pages = OpenedPages(browser)
    pages.allowed += CUT
    try:
        url = json.loads(child.stdout.readline())["url"]
        seen = ConsolePage(url, "demo")
        wait_for(lambda: seen.data("runs.json")["runs"], "the campaign")
        page = pages.open(f"{url.partition('#')[0]}#/run/demo/wall")
        page.evaluate("window.stays = true")
        online(page, "live")
        said_of(page, running=4, waiting=2, collision=None)
        getattr(line, cut)()
        online(page, re.compile("^conductor: no word from it"))
        worker.end(leases[0])  # it was seen running
        worker.end(worker.next(1)[0])  # nobody has heard that it began
        line.mend()
        online(page, "live")
        said_of(page, running=3, waiting=1, collision=2)
        worker.end(leases[1])
        said_of(page, running=2, waiting=1, collision=3)
        assert page.evaluate("window.stays") is True
        pages.check(url.partition("#")[0])
    finally:
        worker.bus.close()
        child.send_signal(signal.SIGINT)
        child.wait(PATIENCE_S)
        line.close()


def said_of(page: Any, **counts: int | None) -> None:
    """How many cases there are of each state, as the page says; None: it has no such word."""
    verdicts = page.get_by_role("group", name="Verdicts")
    for word, count in counts.items():
        name = word if count is None else f"{count} {word}"
        expect(verdicts.get_by_role("button", name=name)).to_have_count(int(count is not None))
