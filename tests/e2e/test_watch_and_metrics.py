"""`conductor status --watch` and `conductor serve --metrics`, with real processes."""

import json
import os
import pty
import signal
import subprocess
import sys
import urllib.request

import pytest
import yaml
from processes import PATIENCE_S, wait_for

from twin.base.errors import UsageError
from twin.fabric.discovery import find_conductor


@pytest.fixture
def served(marked, tmp_path):
    """A conductor with metrics and a campaign of 40 cases that simulate nothing."""
    state = tmp_path / "state"
    server = marked.start("conductor", "serve", "--state", str(state), "--metrics", "127.0.0.1:0")
    url = server.stdout.readline().split()[-1]
    wait_for(lambda: listens(state), "the conductor")
    path = tmp_path / "idle.yaml"
    data = {"campaign": "idle", "simulator": "noop", "matrix": {"repeat": list(range(40))}}
    path.write_text(yaml.safe_dump(data))
    done = marked.run("conductor", "submit", str(path), "--state", str(state))
    assert done.returncode == 0, done.stderr
    yield state, url
    server.terminate()
    assert server.wait() in (0, 75)


def listens(state):
    """Whether the conductor has announced itself."""
    try:
        return find_conductor(state)
    except UsageError:
        return None


def metric(url, name):
    """One value of a scrape."""
    with urllib.request.urlopen(url) as answer:
        lines = answer.read().decode().splitlines()
    return next(float(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(name))


def test_watch_ends_with_the_campaign(marked, served):
    state, url = served
    cases = 'drivetwin_conductor_cases{campaign="idle",state="%s"}'
    assert metric(url, cases % "waiting") == 40
    where = ("--state", str(state))
    lines = marked.start("conductor", "status", "--watch", *where)
    objects = marked.start("conductor", "status", "--watch", "--output", "json", *where)
    assert lines.stdout.readline().startswith("idle: 0 of 40 cases ended")
    assert json.loads(objects.stdout.readline())["left"] == 40
    done = marked.run("twin", "worker", *where, "--slots", "4", "--until-done")
    assert done.returncode == 0, done.stderr
    out, err = lines.communicate(timeout=PATIENCE_S)
    assert (lines.returncode, err) == (0, "")
    assert out.splitlines()[-1].startswith("idle: 40 of 40 cases ended")
    out, err = objects.communicate(timeout=PATIENCE_S)
    assert (objects.returncode, err) == (0, "")
    assert json.loads(out.splitlines()[-1])["left"] == 0
    assert metric(url, cases % "passed") == 40
    assert metric(url, "drivetwin_conductor_commits_total") > 0


def test_watch_on_a_terminal_and_ctrl_c(marked, served):
    state, _ = served
    ours, theirs = pty.openpty()
    command = ("-m", "conductor", "status", "--watch", "--state", str(state))
    watcher = subprocess.Popen(
        [sys.executable, *command],
        stdout=theirs,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "160"},
    )
    os.close(theirs)
    shown = ""
    while "idle" not in shown:
        shown += os.read(ours, 65536).decode()
    assert "ETA" in shown
    watcher.send_signal(signal.SIGINT)
    _, err = watcher.communicate(timeout=PATIENCE_S)
    os.close(ours)
    assert watcher.returncode == 130
    assert "Traceback" not in err


def test_metrics_at_a_port_in_use(marked, served, tmp_path):
    _, url = served
    address = url.split("/")[2]
    other = marked.run(
        *("conductor", "serve", "--state", str(tmp_path / "other"), "--metrics", address)
    )
    assert other.returncode == 2
    assert "already in use" in other.stderr
    assert len(other.stderr.splitlines()) == 1


def test_running_cases_are_listed(marked, tmp_path):
    """Of a campaign that runs, one line per case; of one that waits, that there is none."""
    state = tmp_path / "state"
    server = marked.start(
        *("conductor", "serve", "--campaign", "chaos-16", "--until-done", "--state", str(state))
    )
    wait_for(lambda: listens(state), "the conductor")
    command = ("conductor", "status", "--cases", "--state", str(state))
    assert marked.run(*command).stdout == "no case runs now\n"
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "2")

    def running():
        said = marked.run(*command, "--output", "json").stdout
        return json.loads(said)["running"] if said else []

    wait_for(lambda: len(running()) == 2, "two running cases")
    shown = marked.run(*command)
    assert shown.returncode == 0
    assert "chaos-16" in shown.stdout
    refused = marked.run(*command, "--watch")
    assert refused.returncode == 2
    worker.terminate()
    worker.wait()
    server.terminate()
    assert server.wait() == 75
