"""The console's page on `viewer web` itself: a recorded campaign, and one that runs."""

from __future__ import annotations

import json
import re
import signal

import pytest
from browser_pages import CHROMIUM, CUT, PATIENCE_MS, OpenedPages, axe_source, chromium, findings
from processes import PATIENCE_S, keys_of, outcomes, wait_for
from test_conductor_restart import serve
from test_intervene_in_a_case import caught
from unit.viewer.recorded_case import write

from twin.fabric.discovery import find_conductor

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)

RERUN = ("INFO ", "DEBUG ", "WARN ", "GL Driver", "GPU stall", "rerun.io", "Failed to fetch")
"""What Rerun's viewer says of itself, and of its maker, whom our rules keep it from asking."""
SLOW = """
campaign: slow
seed: 3
control_hz: 20
scenario: {ego_start_m: 150, ego_speed_mps: 0.5, duration_s: 600, standstill_s: 60}
camera: {width: 160, height: 90, hz: 20}
autonomy: {parameters: {cruise_speed_mps: 0.5}}
matrix: {weather: [clear, heavy_fog]}
"""


@pytest.fixture(scope="module")
def browser():
    with chromium(sync_api) as browser:
        yield browser


@pytest.fixture
def pages(browser):
    pages = OpenedPages(browser)
    yield pages
    pages.check("http://127.0.0.1:")


def web(marked, *arguments):
    """`viewer web` in the background, and the address it prints."""
    child = marked.start("viewer", "web", *arguments, "--output", "json")
    line = child.stdout.readline()
    assert line, child.stderr.read()
    return child, json.loads(line)["url"]


def slow_run(marked, tmp_path):
    """A campaign that runs: its conductor's folder, conductor, worker, and a hold of a case."""
    (tmp_path / "slow.yaml").write_text(SLOW)
    state = tmp_path / "state"
    conductor = serve(marked, state)
    there = ("--state", str(state))
    submitted = marked.run("conductor", "submit", str(tmp_path / "slow.yaml"), *there)
    assert submitted.returncode == 0, submitted.stderr
    worker = marked.start("twin", "worker", *there)
    case = caught(state)
    case.resume()
    return state, conductor, worker, case


def recorded(folder):
    for case, brakes in (("case-a", True), ("case-b", False)):
        weather = "clear" if brakes else "heavy_rain"
        write(folder / "cases" / case / "attempt-1", case=case, brakes=brakes, weather=weather)


def case_is_shown(page):
    expect(page.locator("h1")).to_have_text("case-a")
    film = page.locator(".film canvas")
    expect(film).to_have_attribute("data-frame", re.compile(r"\d"))
    expect(page.locator(".plot .main-svg").first).to_be_attached()


def test_a_recorded_case_served_and_from_the_disk(marked, pages, tmp_path):
    recorded(tmp_path / "demo")
    axe = axe_source(tmp_path)
    child, url = web(marked, str(tmp_path / "demo"))
    page = pages.open(f"{url}#/run/demo/wall")
    expect(page.locator(".frame canvas")).to_have_attribute("data-tiles", "2")
    assert findings(page, axe) == []
    page.goto(f"{url}#/run/demo/case/case-a?t=0.1")
    case_is_shown(page)
    assert findings(page, axe) == []
    pages.allowed += RERUN
    page.get_by_role("button", name="Open in full at this moment").click()
    frame = page.frame_locator("iframe")
    expect(frame.locator("#state")).to_have_text("Paused at 0.1 s")
    page.close()
    out = tmp_path / "static"
    written = marked.run("viewer", "web", str(tmp_path / "demo"), "--static", str(out))
    assert written.returncode == 0, written.stderr
    child.send_signal(signal.SIGINT)
    assert child.wait(PATIENCE_S) == 0
    disk = OpenedPages(pages.browser)
    page = disk.open(f"{(out / 'index.html').as_uri()}#/run/demo/case/case-a?t=0.1")
    case_is_shown(page)
    disk.check(out.as_uri())


def test_a_console_without_the_files_says_so_and_where_they_are(marked, pages, tmp_path):
    """KPIs, reasons, log and rows come from the conductor, also to somebody who may only look;
    nothing is said to be unrecorded that is."""
    state = tmp_path / "state"
    conductor = serve(marked, state)
    there = ("--state", str(state))
    submitted = marked.run("conductor", "submit", "chaos-16", *there)
    assert submitted.returncode == 0, submitted.stderr
    worker = marked.start("twin", "worker", *there, "--slots", "4", "--view", "record")
    folder = state / "chaos-16"
    wait_for(lambda: all(row["outcome"] for row in outcomes(folder).values()), "the end")
    case, row = next((c, r) for c, r in outcomes(folder).items() if r["verdict"] == "collision")
    endpoint = find_conductor(state).endpoint
    child, url = web(marked, "--connect", endpoint, "--key", str(keys_of(state) / "viewer.key"))
    page = pages.open(url)
    shows = f"viewer web --run {folder.resolve()}"
    command = page.get_by_label("Command that shows the files")
    expect(command).to_have_text(shows)
    page.evaluate(f"location.hash = '#/run/chaos-16/case/{case}'")
    expect(page.locator("h1")).to_have_text(case)
    expect(page.locator(".verdict .reason")).to_have_text(row["reasons"][0])
    speed = page.get_by_role("region", name="KPIs").get_by_role("row", name="impact_speed_mps")
    expect(speed).to_contain_text("m/s")
    expect(command).to_have_text(shows)
    expect(page.get_by_text("No film: the files of the campaign are not here.")).to_be_visible()
    expect(page.get_by_role("img", name=re.compile("^Over sim time: .*Distance"))).to_be_visible()
    expect(page.locator(".events li").last).to_contain_text("collision")
    log = (folder / "cases" / case / f"attempt-{row['attempt']}" / "log.txt").read_text()
    assert log.strip()
    shown = page.get_by_label("Log of the stack", exact=True)
    expect(shown).to_contain_text(log.splitlines()[-1])
    assert page.get_by_text("not recorded").count() == 0
    repeat = page.get_by_label("Command that repeats this case")
    expect(repeat).to_contain_text(f"conductor run {folder.resolve()}/campaign.yaml --case {case}")
    assert findings(page, axe_source(tmp_path)) == []
    for process in (child, worker, conductor):
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE_S)


def test_a_running_case_is_seen_paused_and_heals(marked, pages, tmp_path):
    """The server is killed, then the conductor; the page goes on without being loaded again."""
    pages.allowed += CUT
    state, conductor, worker, case = slow_run(marked, tmp_path)
    name = case.state.case
    child, url = web(marked, "--run", str(state))
    try:
        port = url.rpartition(":")[2].partition("/")[0]
        page = pages.open(url)
        page.evaluate("window.stays = true")
        online = page.locator(".online")
        expect(online).to_have_text("live")
        page.get_by_role("link", name="Summary").last.click()
        now = page.locator("section").filter(has=page.get_by_role("heading", name="Running now"))
        expect(now.get_by_role("link", name=name)).to_be_visible()
        expect(now.get_by_alt_text(f"What the camera of {name} saw")).to_be_visible()
        page.get_by_role("link", name="Open the wall").click()
        expect(page.locator(".frame canvas")).to_have_attribute("data-tiles", "2")
        run = re.search(r"#/run/([^/]+)/wall", page.url)[1]
        page.evaluate(f"location.hash = '#/run/{run}/case/{name}'")
        expect(page.get_by_text(re.compile(r"Live; the picture|The picture lags"))).to_be_visible()
        page.get_by_role("button", name="Pause case").click()
        page.get_by_role("dialog").get_by_role("button", name="Pause case").click()
        wait_for(lambda: case.look().paused, "the pause")
        page.get_by_label("Weather").select_option("heavy_rain")
        page.get_by_role("button", name="Set weather and hour").click()
        expect(page.get_by_role("dialog")).to_contain_text("it gets no verdict")
        page.get_by_role("dialog").get_by_role("button", name="No").click()

        child.kill()
        child.wait(PATIENCE_S)
        expect(online).to_have_text("no connection; trying again")
        child, _ = web(marked, "--run", str(state), "--port", port)
        expect(online).to_have_text("live")

        conductor.kill()
        conductor.wait(PATIENCE_S)
        expect(online).to_have_text(re.compile("conductor"))
        conductor = serve(marked, state)
        expect(online).to_have_text("live")
        assert page.evaluate("window.stays") is True
    finally:
        case.close()
        for process in (child, worker, conductor):
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)
