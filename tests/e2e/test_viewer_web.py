"""`viewer web` in a real browser: what it shows, and that nothing is asked for outside."""

from __future__ import annotations

import contextlib
import http.client
import json
import signal
import socket
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from played_files import played
from processes import PATIENCE_S, Marked, keys_of, nothing_left, wait_for
from test_conductor_restart import serve
from test_intervene_in_a_case import caught
from unit.viewer.recorded_case import write
from view_messages import thumbnail

from schemas.wire import topics
from schemas.wire.codec import encode
from twin.fabric.bus import Bus
from twin.fabric.discovery import find_target
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import join
from twin.records.play_file import write_play
from twin.view.samples import jpeg
from viewer.playing import paths

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE_MS = 120_000
"""Rendering in software, on a machine with other work."""

FOREIGN = ("rerun.io", "github", "fonts.g", "outside.example")
"""Whom Rerun's page would ask, and whom ours asks on purpose. The browser's maker is none of them:
browsers call home by themselves."""

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)


class Outside:
    """Stands for the rest of the world: the browser's proxy, which counts who calls."""

    def __init__(self):
        self.calls = []
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        while True:
            try:
                caller, _ = self._socket.accept()
            except OSError:
                return
            with caller, contextlib.suppress(OSError):  # some are opened ahead, and ask nothing
                caller.settimeout(5)
                self.calls.append(caller.recv(200).split(b"\r\n")[0].decode())

    def close(self):
        self._socket.close()


@pytest.fixture(scope="module")
def outside():
    found = Outside()
    yield found
    found.close()


@pytest.fixture(scope="module")
def browser(outside):
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM),
            args=["--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking"],
            proxy={"server": outside.url, "bypass": "127.0.0.1"},
        )
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, outside):
    """Opens pages; they may not crash, nor ask anybody but the front."""
    pages, asked, broken = [], [], []

    def open_(url):
        page = browser.new_page(viewport={"width": 720, "height": 420})
        page.set_default_timeout(PATIENCE_MS)
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: broken.append(str(error)))
        page.on("crash", lambda: broken.append("crash"))
        page.on("console", lambda m: broken.append(m.text) if "panicked" in m.text else None)
        page.goto(url)
        pages.append((page, url))
        return page

    yield open_
    for page, _ in pages:
        page.close()
    hosts = tuple("/".join(url.split("/")[:3]) + "/" for _, url in pages)
    assert asked
    assert [url for url in asked if not url.startswith((*hosts, "data:", "blob:"))] == []
    assert [call for call in outside.calls if any(host in call for host in FOREIGN)] == []
    assert broken == []


def picture_of(page, path):
    """What stands on the screen, BGR, kept as a file; None: it could not be taken just now."""
    page.bring_to_front()
    try:
        page.screenshot(path=str(path), timeout=PATIENCE_MS)
    except sync_api.Error as error:
        if "Unable to capture" not in str(error):
            raise
        return None
    return cv2.imread(str(path))


def grey(shade):
    """Share of a picture's pixels of about this shade."""
    return lambda p: float((np.abs(p.astype(int) - shade).max(axis=2) <= 12).mean())


def green(picture):
    """Share of a picture's pixels that are green, also behind the sign of something loading."""
    blue, middle, red = (picture[..., channel].astype(int) for channel in range(3))
    return float(((middle > blue + 40) & (middle > red + 40)).mean())


def shows(page, share, path):
    def look():
        picture = picture_of(page, path)
        return picture is not None and share(picture) > 0.05

    wait_for(look, f"{path.stem} on the screen")


def web(marked, *arguments):
    """`viewer web` in the background, and the address it prints."""
    child = marked.start("viewer", "web", *arguments, "--output", "json")
    line = child.stdout.readline()
    assert line, child.stderr.read()
    return child, json.loads(line)


def wall(said):
    """Address of Rerun's wall of running cases, with the token."""
    return said["url"].replace("/#", "/view#")


def end(child, number=signal.SIGINT):
    """Also beside an open browser: exit code 0, and nothing on the terminal."""
    child.send_signal(number)
    code = child.wait(PATIENCE_S)
    assert (code, child.stderr.read()) == (0, "")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Three recordings: pictures of shade 10, 120, 230 at 0, 0.1 and 0.2 s."""
    folder = tmp_path_factory.mktemp("web") / "demo"
    for case, brakes in (("case-a", True), ("case-b", False), ("case-c", True)):
        weather = "clear" if brakes else "heavy_rain"
        write(folder / "cases" / case / "attempt-1", case=case, brakes=brakes, weather=weather)
    return folder


@pytest.fixture(scope="module")
def served(campaign):
    """What `viewer web` says that serves them, with a link to the first."""
    starter = Marked()
    try:
        with nothing_left(starter):
            child, said = web(starter, str(campaign), "case-a")
            yield said
            end(child)
    finally:
        starter.end()


def test_a_link_opens_a_recording_paused_at_its_moment(served, open_page, tmp_path):
    address = "/view?run=demo&case=case-a#when=sim_time@+0.15s"
    assert served["url"].endswith(address)
    assert served["laptop"][1] == f"http://localhost:9300{address}"
    page = open_page(served["url"])
    expect(page.locator("#state")).to_have_text("Paused at 0.15 s", timeout=PATIENCE_MS)
    expect(page.locator("#title")).to_have_text("case-a: pass")
    # The picture of 0.1 s stands at 0.15 s; the first is darker, the last brighter.
    shows(page, grey(120), tmp_path / "paused.png")
    assert grey(230)(cv2.imread(str(tmp_path / "paused.png"))) < 0.02
    assert page.evaluate("fetch('http://outside.example/').catch(() => 'blocked')") == "blocked"
    # Another moment in the address, without loading anything anew.
    page.evaluate("location.hash = '#when=sim_time@+0.24s'")
    expect(page.locator("#state")).to_have_text("Paused at 0.24 s")
    shows(page, grey(230), tmp_path / "later.png")


def test_a_link_to_nobody_says_who_is_there(served, open_page):
    page = open_page(served["url"].partition("view")[0] + "view?run=demo&case=nobody")
    expect(page.locator("#state")).to_contain_text("no case 'nobody'; it has e.g. case-a")


def test_a_played_scenario_has_a_page_of_its_own(marked, open_page, tmp_path):
    write_play(tmp_path / "s.play", played())
    child = marked.start("viewer", "play", str(tmp_path / "s.play"), "--web", "--at-s", "1")
    page = open_page(child.stdout.readline().split()[0])
    expect(page.locator("#state")).to_have_text("Paused at 1 s", timeout=PATIENCE_MS)
    expect(page.locator("#title")).to_have_text("s")
    expect(page.locator("#back")).to_be_hidden()

    def look():
        picture = picture_of(page, tmp_path / "played.png")
        off = np.abs(picture[..., ::-1].astype(int) - paths.EGO_COLOR).max(axis=2)
        return (off <= 24).sum() > 100

    wait_for(look, "the ego on the screen")
    end(child)


def publish(bus: Bus, stop):
    """Green thumbnails of a case, as a simulator sends them, until told to stop."""
    key = topics.VIEW_THUMBNAIL.key.format(campaign="demo", case="clear-1")
    picture = jpeg(np.full((90, 160, 3), (40, 200, 60), np.uint8))
    while not stop.wait(0.2):
        bus.publish(key, picture, encode(thumbnail(sim_time_ns=time.monotonic_ns())))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_without_a_traceback_beside_an_open_browser(marked, open_page, tmp_path, number):
    """The browser's streams are cut in the middle, one from a run's folder."""
    conductor = serve(marked, tmp_path)
    child, said = web(marked, "--run", str(tmp_path))
    bus, stop = join(find_target(tmp_path, Role.worker), PATIENCE_S), threading.Event()
    thread = threading.Thread(target=publish, args=(bus, stop))
    thread.start()
    try:
        page = open_page(wall(said))
        expect(page.locator("#state")).to_have_text("Live", timeout=PATIENCE_MS)
        shows(page, green, tmp_path / "live.png")
        end(child, number)
    finally:
        stop.set()
        thread.join()
        bus.close()
        for process in (child, conductor):
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def test_running_cases_and_who_comes_late(marked, open_page, tmp_path):
    conductor = serve(marked, tmp_path)
    target = find_target(tmp_path, Role.worker)
    child, said = web(marked, "--connect", target.endpoint, "--key", str(keys_of(tmp_path)))
    bus, stop = join(target, PATIENCE_S), threading.Event()
    thread = threading.Thread(target=publish, args=(bus, stop))
    thread.start()
    try:
        first = open_page(wall(said))
        expect(first.locator("#state")).to_have_text("Live", timeout=PATIENCE_MS)
        shows(first, green, tmp_path / "first.png")
        stop.set()
        thread.join()
        # A second client, after the last message: it is shown what has been.
        late = open_page(wall(said))
        shows(late, green, tmp_path / "late.png")
        hub = marked.one("viewer", "live")
        end(child)
        assert not hub.is_running()
    finally:
        stop.set()
        thread.join()
        bus.close()
        for process in (child, conductor):
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


PANEL = """
campaign: panel
seed: 3
control_hz: 20
scenario: {ego_start_m: 150, ego_speed_mps: 0.5, duration_s: 600, standstill_s: 60}
camera: {width: 160, height: 90, hz: 20}
autonomy: {parameters: {cruise_speed_mps: 0.5}}
matrix: {weather: [clear]}
"""


def test_the_panel_steers_a_running_case(marked, open_page, tmp_path):
    (tmp_path / "panel.yaml").write_text(PANEL)
    conductor = serve(marked, tmp_path / "state")
    state = ("--state", str(tmp_path / "state"))
    submitted = marked.run("conductor", "submit", str(tmp_path / "panel.yaml"), *state)
    assert submitted.returncode == 0, submitted.stderr
    worker = marked.start("twin", "worker", *state)
    case = caught(tmp_path / "state")
    case.set(pace=0.03)  # however long the browser takes, the car must not reach anything
    child, said = web(marked, "--run", str(tmp_path / "state"))
    try:
        page = open_page(wall(said))
        hand, tick = page.locator("#hand"), case.look().tick
        expect(hand).to_contain_text(f"paused: tick {tick},", timeout=PATIENCE_MS)
        assert "steer=" not in page.url, "the token stays out of addresses that are copied"
        page.click("#step")
        expect(hand).to_contain_text(f"tick {tick + 1},", timeout=PATIENCE_MS)
        page.select_option("#weather", "heavy_fog")
        page.fill("#hour", "12.5")
        page.click("#set")
        expect(hand).to_contain_text("heavy fog, no verdict", timeout=PATIENCE_MS)
        assert case.look().time_of_day_min == 12.5 * 60
        page.fill("#hour", "25")
        page.click("#set")
        expect(hand).to_contain_text("hour: given 25", timeout=PATIENCE_MS)
        _driven(page, case)
        page.click("#pause")
        expect(hand).to_contain_text("paused", timeout=PATIENCE_MS)
        assert case.look().paused
        picture_of(page, tmp_path / "panel.png")
        _foreign(said["url"], case)
    finally:
        case.close()
        for process in (child, worker, conductor):
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def _driven(page, case):
    """Keys that are held down are pedals."""
    page.click("#resume")
    page.click("#take")
    expect(page.locator("#hand")).to_contain_text("by hand", timeout=PATIENCE_MS)
    page.keyboard.down("w")
    page.keyboard.down("ArrowLeft")
    wait_for(lambda: case.look().throttle > 0.5 and case.state.steering_rad > 0.02, "the pedals")
    page.keyboard.up("w")
    page.keyboard.up("ArrowLeft")
    page.keyboard.down(" ")
    wait_for(lambda: case.look().brake > 0.5 and case.state.throttle < 0.1, "the brake")
    page.keyboard.up(" ")
    page.click("#take")
    wait_for(lambda: not case.look().taken_over, "the stack at the wheel")


def _foreign(url, case):
    """Who does not know the token, or comes from another site, steers nothing."""
    home, _, token = url.partition("#steer=")
    state, port = case.look(), urlsplit(home).port
    body = {"campaign": "panel", "case": state.case, "token": state.token}
    ours = {
        "Content-Type": "application/json",
        "Origin": home.rstrip("/"),
        "X-Steer-Token": token,
    }

    def post(change, action="resume"):
        line = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        headers = {name: value for name, value in (ours | change).items() if value is not None}
        line.request("POST", "/steer", json.dumps(body | {"action": {"action": action}}), headers)
        answer = line.getresponse()
        line.close()
        return answer.status

    for change in (
        {"X-Steer-Token": "guessed"},
        {"X-Steer-Token": None},
        {"Origin": "http://evil.example"},
        {"Origin": None},
        {"Content-Type": "text/plain"},
        {"Host": "evil.example"},
    ):
        assert post(change) == 403, change
    assert case.look().paused
    assert post({}, "jump") == 409
    assert post({}) == 200
    assert not case.look().paused


def test_mistakes_are_one_line(marked, campaign, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = [
            (marked.start("viewer", "web", *arguments), words)
            for arguments, words in [
                ([], "give a campaign folder"),
                ([str(campaign), "--run", str(tmp_path)], "give a campaign folder"),
                ([str(tmp_path)], "not a campaign folder"),
                ([str(campaign), "case-aa"], "did you mean 'case-a'?"),
                ([str(campaign), "--port", port], f"--port {port}"),
                (["--connect", "nowhere"], "expected tcp/HOST:PORT"),
            ]
        ]
        for child, words in done:
            _, err = child.communicate(timeout=PATIENCE_S)
            assert child.returncode == 2, err
            assert words in err
            assert len(err.splitlines()) == 1
