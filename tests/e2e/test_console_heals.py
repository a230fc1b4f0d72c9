"""The console's page in Chromium, `viewer web` and a conductor, with lines between them that are
cut: the page goes on without a reload."""

from __future__ import annotations

import json
import re
import signal
from typing import Any
from urllib.parse import urlsplit

import pytest
from browser_pages import CHROMIUM, CUT, PATIENCE_MS, OpenedPages, chromium
from console_pages import ConsolePage
from cut_lines import CutLine
from processes import PATIENCE_S, wait_for

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply, Request
from twin.fabric.zenoh_bus import open_bus
from viewer.console.stream import EVENTS_MAX
from viewer.playback.native import free_port

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)

CASES = 6
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

    def say(self, **fact: Any) -> None:
        """Publish a fact."""
        self.bus.publish(topics.EVENT.key, encode(fact))

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
    conductor = Conductor(free_port())
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
            conductor.say(fact="worker_left", worker=f"w-{number}", reason="bye")
        wait_for(lambda last=number: said(witness, f"w-{last} "), "the facts on the stream")
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
