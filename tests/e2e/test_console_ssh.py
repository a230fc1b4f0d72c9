"""`viewer web --ssh`: the console opens its tunnel, mends it, and says what is in the way."""

from __future__ import annotations

import json
import os
import re
import signal

import pytest
from browser_pages import CHROMIUM, CUT, PATIENCE_MS, OpenedPages, chromium
from console_pages import ConsolePage
from processes import PATIENCE_S, wait_for
from ssh_stand_in import put_first
from test_console_real import slow_run, web

from viewer.browser.front import READS

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """What ssh was called with so far."""
    return put_first(tmp_path, monkeypatch)


def tunnels(calls):
    """Those of them that forward."""
    return [call for call in calls() if "-L" in call]


@pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)
def test_a_page_through_a_tunnel_sees_acts_and_heals(marked, calls, tmp_path):
    """ssh is killed under it; the page goes on without being loaded again."""
    state, conductor, worker, case = slow_run(marked, tmp_path)
    name = case.state.case
    child, url = web(marked, "--ssh", "me@login", "--run", str(state))
    try:
        with chromium(sync_api) as browser:
            pages = OpenedPages(browser)
            pages.allowed += CUT
            page = pages.open(url)
            page.evaluate("window.stays = true")
            online = page.locator(".online")
            expect(online).to_have_text("live")
            page.get_by_role("link", name="Summary").last.click()
            expect(page.get_by_alt_text(f"What the camera of {name} saw")).to_be_visible()
            assert len(tunnels(calls)) == 1
            assert any("admin.key" in call["command"] for call in calls()), "so that it may act"
            beside = ConsolePage(url, "slow")
            wait_for(lambda: beside.act("pause", run="slow", confirm=True)[0] == 200, "its pause")

            os.kill(tunnels(calls)[0]["pid"], signal.SIGKILL)
            wait_for(lambda: len(tunnels(calls)) > 1, "another tunnel")
            expect(online).to_have_text("live")
            wait_for(lambda: beside.act("resume", run="slow", confirm=True)[0] == 200, "the end")
            page.evaluate(f"location.hash = '#/run/slow/case/{name}'")
            expect(
                page.get_by_text(re.compile(r"Live; the picture|The picture lags"))
            ).to_be_visible()
            page.get_by_role("button", name="Pause case").click()
            page.get_by_role("dialog").get_by_role("button", name="Pause case").click()
            wait_for(lambda: case.look().paused, "the pause")
            assert page.evaluate("window.stays") is True
            pages.check("http://127.0.0.1:")

        # Rerun's wall has a tunnel of its own, when somebody first asks for it.
        host = url.partition("//")[2].partition("/")[0]
        dug = len(tunnels(calls))
        reads = {"Origin": f"http://{host}", "Content-Type": "application/grpc-web+proto"}
        beside.request("POST", READS, b"", reads)
        wait_for(lambda: len(tunnels(calls)) > dug, "the tunnel of the hub")
        assert any("viewer.key" in call["command"] for call in calls())
    finally:
        case.close()
        for process in (child, worker, conductor):
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)
    assert child.returncode == 0


def test_the_laptop_is_not_told_how_to_reach_itself(marked, calls, tmp_path):
    child = marked.start("viewer", "web", "--ssh", "me@login", "--run", str(tmp_path / "none"))
    assert "(Ctrl-C ends)" in child.stdout.readline()
    wait_for(lambda: calls(), "a look for the conductor")
    said = child.stderr.readline()
    assert f"me@login:{tmp_path / 'none'}/conductor.json: no conductor serves this folder" in said
    assert "waiting for it (Ctrl-C ends)" in said
    child.send_signal(signal.SIGINT)
    out, err = child.communicate()
    assert (child.returncode, out, err) == (0, "", "")


@pytest.mark.parametrize(
    ("arguments", "path", "code", "words"),
    [
        (("--ssh", "me@nowhere"), True, 3, "ssh me@nowhere: ssh: Could not resolve hostname"),
        (("--ssh", "me@login"), False, 2, "there is no ssh on this machine; install OpenSSH's"),
        (("--ssh", "-oProxyCommand=evil"), True, 2, "expected a host as ssh takes it"),
        (("--node", "cn042"), True, 2, "--node is reached through --ssh me@login; give both"),
    ],
)
def test_what_is_in_the_way_is_one_line(
    marked, calls, tmp_path, monkeypatch, arguments, path, code, words
):
    if not path:
        monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    child = marked.start("viewer", "web", "--run", "runs/x", *arguments, "--output", "json")
    out, err = child.communicate()
    assert child.returncode == code, err
    assert words in err
    assert len(err.splitlines()) == 1
    assert all("url" in json.loads(line) for line in out.splitlines())
