"""The console's page beside a server that sends, is cut off, and comes back as another."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from browser_pages import (
    CHROMIUM,
    CUT,
    PATIENCE_MS,
    LiveSite,
    OpenedPages,
    axe_source,
    chromium,
    findings,
)
from waiting import wait_for

from viewer.bench.console_site import MadeCase, write_site

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)

COUNT, RUNNING = 96, 8
RUN = "made-up"
TOKEN = "#steer=secret-token"


@pytest.fixture(scope="module")
def browser():
    with chromium(sync_api) as browser:
        yield browser


@pytest.fixture
def made(tmp_path: Path) -> tuple[LiveSite, list[MadeCase]]:
    """A live site of its own, and its cases; the last ones run."""
    folder = tmp_path / "site"
    cases = write_site(folder, COUNT, static=False, dossiers=2, running=RUNNING)
    workers = {
        "age_s": 0.2,
        "draining": False,
        "storage_error": None,
        "workers": [
            {"id": "w1", "host": "cn1", "device_class": "cpu", "slots": 8, "draining": False}
            | {"held": 8, "remaining_s": 3600.0, "age_s": 0.3, "present": True}
        ],
        "leases": [
            {"case": cases[-1].name, "worker": "w1", "attempt": 1, "tick": 40, "for_s": 2.0}
            | {"by_hand": False}
        ],
        "notes": [],
        "hosts": ["host cn2: 3 different cases died on it"],
        "quarantine": [
            {"case": cases[3].name, "charge": "the simulator died", "explain": ["alone next"]}
        ],
        "resources": {"w1": {"t": [0, 1, 2], "cpu_cores": [1.0, 1.5, 1.2], "ram_bytes": [1e9] * 3}},
    }
    (folder / "data" / "runs" / RUN / "workers.json").write_text(json.dumps(workers))
    site = LiveSite(folder, role="operate")
    site.running = cases[-1].name
    site.start()
    yield site, cases
    site.close()


@pytest.fixture
def pages(browser: Any, made: tuple[LiveSite, list[MadeCase]]):
    pages = OpenedPages(browser)
    yield pages
    pages.check(made[0].url)


def online(page: Any, words: str) -> None:
    expect(page.locator(".online")).to_have_text(words)


def ended(site: LiveSite, index: int, version: str, verdict: str = "collision") -> None:
    """A case ends: in the table that a page reads, and as an event."""
    path = site.folder / "data" / "runs" / RUN / "table.json"
    table = json.loads(path.read_text())
    cells = {"verdict": verdict, "state": "ended", "reason": "collided at 9 m/s"}
    for name, value in cells.items():
        table["columns"][name][index] = value
    whole = path.with_suffix(".new")
    whole.write_text(json.dumps({**table, "version": version}))
    whole.replace(path)  # a page may be reading it
    site.put("table", run=RUN, version=version, rows={str(index): cells}, cases=[])


def pictured(site: LiveSite, page: Any, picture: list[float], words: str, **known: Any) -> None:
    """Pictures come, as from a rig, until the page says so; it hears those since it drew a case."""
    for _ in range(200):
        site.put("picture", run=RUN, pictures=[picture], **known)
        page.wait_for_timeout(500)
        if page.get_by_text(words).is_visible():
            return
    expect(page.get_by_text(words)).to_be_visible()


def spoken(site: LiveSite, page: Any) -> None:
    """The conductor speaks until the page says so; one word is soon as good as none."""
    for _ in range(200):
        site.put("workers", draining=False)
        page.wait_for_timeout(500)
        if page.locator(".online").text_content() == "live":
            return
    online(page, "live")


def chip(page: Any, words: str) -> Any:
    return page.get_by_role("group", name="Verdicts").get_by_role("button", name=words, exact=True)


def test_cases_that_end_appear_without_a_reload(pages, made):
    site, _ = made
    page = pages.open(f"{site.url}#/run/{RUN}/wall")
    online(page, "live")
    expect(chip(page, f"{RUNNING} running")).to_be_visible()
    ended(site, COUNT - 1, "second")
    expect(chip(page, f"{RUNNING - 1} running")).to_be_visible()
    site.put(
        "table", run=RUN, version="third", rows={str(COUNT): {"state": "waiting"}}, cases=["new"]
    )
    expect(chip(page, "1 waiting")).to_be_visible()
    expect(page.locator("#filter-says")).to_have_text(f"{COUNT + 1} of {COUNT + 1} cases")


def test_the_summary_shows_what_runs_now(pages, made, tmp_path):
    site, cases = made
    page = pages.open(f"{site.url}#/run/{RUN}")
    online(page, "live")
    now = page.locator("section").filter(has=page.get_by_role("heading", name="Running now"))
    tiles = now.get_by_role("listitem")
    expect(tiles).to_have_count(RUNNING)
    ended_count = f"{COUNT - RUNNING} of {COUNT} cases ended, {RUNNING} running"
    expect(page.get_by_text(ended_count)).to_be_visible()
    expect(tiles.last).to_contain_text("No picture yet")
    name = cases[-1].name
    picture = now.get_by_alt_text(f"What the camera of {name} saw")
    for _ in range(200):  # the page hears those since it drew the case
        site.put("picture", run=RUN, pictures=[[COUNT - 1, 5, 1.5, 3.14]])
        page.wait_for_timeout(500)
        if picture.is_visible():
            break
    expect(picture).to_have_attribute("src", re.compile(r"v=5$"))
    late = "The picture lags at least 3.1 s behind the simulator."
    expect(now.get_by_role("status")).to_have_text(late)
    assert findings(page, axe_source(tmp_path)) == []
    ended(site, COUNT - 2, "second")
    expect(tiles).to_have_count(RUNNING - 1)
    now.get_by_role("link", name=name).click()
    expect(page.locator("h1")).to_have_text(name)


def test_more_cases_than_fit_are_on_the_wall(browser, tmp_path):
    folder = tmp_path / "many"
    write_site(folder, COUNT, static=False, dossiers=2, running=30)
    site, pages = LiveSite(folder), OpenedPages(browser)
    site.start()
    try:
        page = pages.open(f"{site.url}#/run/{RUN}", width=420, height=860)
        tiles = page.locator(".tiles li")
        expect(tiles).to_have_count(8)
        assert page.evaluate("document.documentElement.scrollWidth") <= 420
        page.get_by_role("link", name="All 30 running cases on the wall").click()
        expect(page.locator("#filter-says")).to_have_text(f"30 of {COUNT} cases")
        pages.check(site.url)
    finally:
        site.close()


def test_a_cut_line_heals_where_it_was(pages, made):
    site, _ = made
    pages.allowed += CUT
    page = pages.open(f"{site.url}#/run/{RUN}/wall")
    page.evaluate("window.stays = true")
    online(page, "live")
    ended(site, COUNT - 1, "second")
    expect(chip(page, f"{RUNNING - 1} running")).to_be_visible()
    site.stop()
    online(page, "no connection; trying again")
    ended(site, COUNT - 2, "third")  # while nobody hears it
    site.start()
    online(page, "live")
    expect(chip(page, f"{RUNNING - 2} running")).to_be_visible()
    assert site.resumed[-1] == "first-1"
    assert page.evaluate("window.stays") is True


def test_a_server_that_is_another_one_is_read_anew(pages, made):
    site, _ = made
    pages.allowed += CUT
    page = pages.open(f"{site.url}#/run/{RUN}/wall")
    page.evaluate("window.stays = true")
    online(page, "live")
    site.stop()
    online(page, "no connection; trying again")
    ended(site, COUNT - 1, "elsewhere")
    site.epoch, site.events = "second", []  # which knows of no event
    site.start()
    online(page, "live")
    expect(chip(page, f"{RUNNING - 1} running")).to_be_visible()
    assert page.evaluate("window.stays") is True


def test_a_network_that_swallows_everything_for_half_a_minute_is_noticed_and_heals(pages, made):
    """No line ends, so the browser itself notices nothing; its clock is the test's."""
    site, _ = made
    pages.allowed += CUT
    page = pages.open(f"{site.url}#/run/{RUN}/wall", clock=True)
    page.evaluate("window.stays = true")
    online(page, "live")
    ended(site, COUNT - 1, "second")
    expect(chip(page, f"{RUNNING - 1} running")).to_be_visible()
    site.fall_silent()
    page.evaluate(f"location.hash = '#/run/{RUN}/workers'")  # asked while nobody answers
    page.clock.run_for(30_000)
    online(page, "no connection; trying again")
    ended(site, COUNT - 2, "third")
    site.speak()
    page.clock.run_for(10_000)
    online(page, "live")
    expect(page.get_by_role("region", name="Leases")).to_be_visible()
    page.evaluate(f"location.hash = '#/run/{RUN}/wall'")
    expect(chip(page, f"{RUNNING - 2} running")).to_be_visible()
    assert site.resumed[-1] == "first-1"
    assert page.evaluate("window.stays") is True


def test_a_page_that_stood_still_while_its_history_went_reads_everything_again(pages, made):
    """As in a laptop that was shut: not a line of it runs, and its server becomes another one."""
    site, _ = made
    pages.allowed += CUT
    page = pages.open(f"{site.url}#/run/{RUN}/wall")
    page.evaluate("window.stays = true")
    online(page, "live")
    expect(chip(page, f"{RUNNING} running")).to_be_visible()
    # Chromium without a window freezes no tab; its debugger stops all scripts as well.
    debugger = page.context.new_cdp_session(page)
    stopped = []
    debugger.on("Debugger.paused", lambda event: stopped.append(event))
    debugger.send("Debugger.enable")
    debugger.send("Debugger.pause")
    while not stopped:
        page.wait_for_timeout(50)
    site.stop()
    ended(site, COUNT - 1, "an hour later")
    site.epoch, site.events = "an hour later", []
    site.start()
    debugger.send("Debugger.resume")
    online(page, "live")
    expect(chip(page, f"{RUNNING - 1} running")).to_be_visible()
    assert site.resumed[-1] == "first-0"  # an id that this server does not know
    assert page.evaluate("window.stays") is True


def test_a_page_that_was_opened_before_its_server_is_there_shows_it_later(pages, made):
    site, _ = made
    pages.allowed += CUT
    page = pages.open(f"{site.url}#/")
    online(page, "live")
    site.stop()
    online(page, "no connection; trying again")
    page.evaluate(f"location.hash = '#/run/{RUN}/wall'")
    expect(page.get_by_text("asking again")).to_be_visible()
    site.start()
    expect(chip(page, f"{RUNNING} running")).to_be_visible()


def test_a_lost_conductor_and_a_late_picture_are_said(pages, made):
    site, cases = made
    page = pages.open(f"{site.url}#/run/{RUN}/case/{cases[-1].name}")
    online(page, "live")
    index = COUNT - 1
    pictured(site, page, [index, 1, 1.5, 0.4], "Live; the picture is 0.4 s old.")
    late = "The picture lags at least 3.1 s behind the simulator."  # it counts from the console
    pictured(site, page, [index, 2, 1.6, 3.14], late)
    known = {"from": "simulator", "within_s": 0.3}
    late = "The picture lags 4.3 s behind the simulator (within 0.3 s)."
    pictured(site, page, [index, 2, 1.6, 4.26], late, **known)
    live = page.get_by_role("img", name=re.compile("sees now"))
    expect(live).to_have_attribute("src", re.compile(r"v=2$"))
    page.evaluate(f"location.hash = '#/run/{RUN}/wall'")
    online(page, "live")
    expect(page.locator(".frame canvas")).to_have_attribute("data-tiles", re.compile(r"[1-9]"))
    late = "The picture lags 3.1 s behind the simulator (within 0.3 s)."
    pictured(site, page, [index, 3, 1.7, 3.14], late, **known)
    site.talks = False
    online(page, "conductor: no word from it")
    spoken(site, page)
    site.put("gone", error="no conductor answers")
    online(page, "conductor: no conductor answers")


def test_only_who_has_the_token_acts_and_nothing_happens_before_a_yes(pages, made):
    site, cases = made
    hash_ = f"#/run/{RUN}/case/{cases[-1].name}"
    looker = pages.open(f"{site.url}{hash_}")
    expect(looker.get_by_text("Waiting for a picture.")).to_be_visible()
    assert looker.get_by_role("button", name="Pause case").count() == 0
    page = pages.open(f"{site.url}{TOKEN}")
    expect(page).to_have_url(f"{site.url}#/run/{RUN}")
    page.evaluate(f"location.hash = '{hash_}'")
    page.get_by_label("Weather").select_option("heavy_rain")
    page.get_by_role("button", name="Set weather and hour").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("It gets no verdict.")
    dialog.get_by_role("button", name="No").click()
    assert [body["confirm"] for _, body, _ in site.posted] == [False]
    page.get_by_role("button", name="Set weather and hour").click()
    dialog.get_by_role("button", name="Set weather and hour").click()
    expect(page.get_by_text("done it")).to_be_visible()
    path, body, token = site.posted[-1]
    assert (path, token) == ("/act/intervene", "secret-token")
    assert body == {
        "run": RUN,
        "case": cases[-1].name,
        "campaign": RUN,
        "token": 7,
        "settings": {"weather": "heavy_rain"},
        "confirm": True,
    }


def test_workers_leases_and_quarantine(pages, made, tmp_path):
    site, cases = made
    page = pages.open(f"{site.url}{TOKEN}")
    expect(page.locator("h1")).to_contain_text(RUN)
    page.evaluate(f"location.hash = '#/run/{RUN}/workers'")
    expect(page.get_by_role("region", name="Workers")).to_contain_text("busy")
    expect(page.get_by_role("region", name="Leases")).to_contain_text(cases[-1].name)
    expect(page.get_by_text("the simulator died")).to_be_visible()
    expect(page.get_by_text("alone next")).to_be_visible()
    expect(page.get_by_text("3 different cases died on it")).to_be_visible()
    expect(page.locator(".plot .main-svg").first).to_be_attached()
    site.put("log", at_s=1.0, level="info", text="worker w2 has joined")
    expect(page.get_by_label("Lines of the conductor")).to_contain_text("worker w2 has joined")
    page.get_by_role("button", name="Drain w1").click()
    page.get_by_role("dialog").get_by_role("button", name="Drain w1").click()
    wait_for(lambda: len(site.posted) == 2, "the confirmed act")
    assert site.posted[-1][1] == {"run": RUN, "worker": "w1", "confirm": True}
    assert findings(page, axe_source(tmp_path)) == []
