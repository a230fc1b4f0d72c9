"""What one viewer process does with what comes, without a conductor."""

import subprocess
import sys
from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner
from unit.viewer.recording.test_viewer_focus import Stream
from view_messages import camera, start, state, thumbnail
from waiting import PATIENCE_S

from schemas import SCHEMA_VERSION
from schemas.wire.codec import encode
from twin.base.errors import UsageError
from twin.fabric.bus import Sample
from twin.fabric.discovery import RunEndedError
from twin.view.samples import jpeg
from viewer.cli import app
from viewer.live import command as lively
from viewer.live.command import Live, LiveOptions, run_live
from viewer.recording import naming

PICTURE = jpeg(np.zeros((90, 160, 3), np.uint8))


class Hub:
    """A hub whose viewers keep up, or do not."""

    def __init__(self):
        self.url = "rerun+http://127.0.0.1:1/proxy"
        self.stuck = False
        self.walls = self.told = 0

    def open(self):
        return not self.stuck

    def show(self, _overview, _now_s):
        self.walls += 1

    def tell(self, _pulse, _now_s):
        self.told += 1

    def close(self):
        pass


@pytest.fixture
def streams(monkeypatch):
    """Recordings of cases in full, as they are opened."""
    opened = []

    def open_stream(_url, _start):
        opened.append(Stream())
        return opened[-1]

    monkeypatch.setattr(lively, "open_stream", open_stream)
    return opened


@pytest.fixture
def shown(streams, port):
    """A viewer of the case clear-1; nobody answers where it looks for a conductor."""
    where = f"tcp/127.0.0.1:{port}"
    live = Live(LiveOptions(connect=where, cases=("clear-1",)), Hub())
    yield live
    live.close()


def put(live, stream, message, payload=None):
    key = f"view/demo/clear-1/{stream}"
    data = encode(message)
    live.slots.put(Sample(key, data, b"") if payload is None else Sample(key, payload, data))


def test_the_wall_is_shown_twice_a_second_at_most(shown):
    for turn in range(21):
        put(shown, "thumbnail", thumbnail(), PICTURE)
        shown.turn(100.0 + turn * 0.05)
    assert shown.hub.walls == 3
    shown.turn(200.0)
    assert shown.hub.walls == 3, "nothing has changed since"


def test_while_viewers_are_stuck_the_newest_waits(shown, streams):
    shown.hub.stuck = True
    for tick in range(50):
        put(shown, "live/start", start(seq=-1))
        put(shown, "live/state", state(-1, tick))
        put(shown, "live/camera", camera(-1, tick), PICTURE)
        shown.turn(100.0 + tick)
    assert streams == []
    assert len(shown._waiting) == 3
    shown.hub.stuck = False
    shown.turn(200.0)
    [stream] = streams
    speeds = [path for path, _, static in stream.logged if path == naming.SPEED and not static]
    assert len(speeds) == 1
    assert timedelta(milliseconds=49 * 50) in stream.times


def test_cases_of_two_campaigns_with_one_name_do_not_end_each_other(shown, streams):
    for campaign in ("demo", "other", "demo", "other"):
        message = start(seq=-1, campaign=campaign, token=7 + (campaign == "demo"))
        shown.slots.put(Sample(f"view/{campaign}/clear-1/live/start", encode(message), b""))
        shown.turn(100.0)
    assert [stream.open for stream in streams] == [True, True]
    assert shown.attempts == 2


def test_it_ends_though_a_viewer_is_frozen():
    program = (
        "import atexit, sys, threading\n"
        "from viewer import cli\nfrom viewer.live import hub\n"
        "atexit.register(threading.Event().wait)  # as Rerun's hook would\n"
        "class Stream:\n"
        "    def flush(self, timeout_sec):\n"
        "        raise RuntimeError('timeout')\n"
        "hub.leave(Stream())\n"
        "sys.argv = ['viewer', *sys.argv[1:]]\n"
        "cli.main()\n"
    )
    for arguments, code, words in (
        (["live", "--help"], 0, "--connect"),
        (["live"], 2, "give one of --connect"),
    ):
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        assert done.returncode == code
        assert words in done.stdout + done.stderr


def test_strangers_are_told_once(shown, capsys):
    for _ in range(3):
        put(shown, "thumbnail", thumbnail(v=SCHEMA_VERSION + 1), PICTURE)
        put(shown, "live/state", state(-1), b"\xff")
        shown.turn(100.0)
    shown.hub.stuck = False
    said = [line for line in capsys.readouterr().err.splitlines() if "not told" in line]
    assert len(said) == 1
    assert "install the same version" in said[0]
    assert shown.strangers >= 3


def test_a_typed_name_opens_a_case_and_the_oldest_makes_room(shown, capsys):
    for index in range(9):
        put(shown, "thumbnail", thumbnail(f"c{index}"), PICTURE)
        shown.turn(100.0 + index)
        shown.choose(f"c{index}")
    assert list(shown._focuses) == ["clear-1", *(f"c{i}" for i in range(2, 9))]
    shown.choose("c8")
    shown.choose("snow")
    assert "'snow' is in no name on the wall" in capsys.readouterr().err
    assert len(shown._focuses) == 8


def test_nine_cases_are_too_many():
    with pytest.raises(UsageError, match="9 cases given, at most 8"):
        run_live(LiveOptions(connect="tcp/127.0.0.1:1", cases=tuple("abcdefghi")))


def test_without_a_display_a_laptop_is_told_how(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("viewer.playback.native.sys.platform", "linux")
    hub = SimpleNamespace(url="rerun+http://127.0.0.1:9000/proxy", port=9000)
    lively._tell(hub, LiveOptions(connect="tcp/127.0.0.1:1"))
    told = capsys.readouterr().out
    assert "no display here to open a window on" in told
    assert "ssh -N -L 9876:127.0.0.1:9000" in told


@pytest.mark.parametrize("command", [["live", "--run"], ["shot"]])
def test_nobody_waits_for_a_run_that_has_ended(tmp_path, command):
    """The console shows it instead: tests/e2e/test_console.py."""
    (tmp_path / "outcomes.json").write_text('{"complete": true}')
    done = CliRunner().invoke(app, [*command, str(tmp_path)])
    assert isinstance(done.exception, RunEndedError)
    assert "viewer replay" in str(done.exception)
    done = CliRunner().invoke(app, [*command, str(tmp_path / "none")])
    assert "no such folder" in str(done.exception)
