"""`viewer play` of a scenario file: recording, picture and browser, by real processes."""

from __future__ import annotations

import json
import signal
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from played_files import write_cut_in
from processes import PATIENCE_S
from recordings import read_recording

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.base.gpu.vulkan import has_vulkan
from twin.records.play_file import points_of, poses_of, read_play
from viewer.playing import paths

needs_vulkan = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)
NEAR_VIEW = (slice(70, 445), slice(0, 780))
"""Rows and columns [px] of the view that follows the ego, in a picture of 1280 x 720."""


def pixels(picture: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Places of pixels of about this colour (red, green, blue) [N, 2]: row and column."""
    off = np.abs(picture[..., ::-1].astype(int) - color).max(axis=2)
    return np.argwhere(off <= 24)


def test_a_cut_in_is_played_saved_and_recorded(marked, tmp_path: Path) -> None:
    file, play, out = write_cut_in(tmp_path), tmp_path / "c.play", tmp_path / "c.rrd"
    done = marked.run("twin", "play", str(file), "--save", str(play))
    assert done.returncode == 0, done.stderr
    saved = read_play(play)
    assert [(body.name, body.category, body.ego) for body in saved.entities] == [
        ("Ego", "car", True),
        ("van", "van", False),
        ("parked bus", "bus", False),
        ("walker", "pedestrian", False),
    ]
    assert (saved.step_s, saved.period_s, saved.end_s) == (0.01, 0.05, pytest.approx(9.0))
    assert saved.finished
    starts = {
        saved.elements[item.element].name: item.time_s
        for item in saved.transitions
        if item.transition == "start"
    }
    # The gap of 30 m shrinks by 2 m/s to less than 25 m.
    assert starts["cut in"] == pytest.approx(2.5, abs=0.02)
    assert starts["walk across"] == pytest.approx(4.0)
    event = next(element for element in saved.elements if element.name == "cut in")
    assert (event.trigger, event.actors) == ("van is near", [1])
    assert event.path == "story::act::cutting in::cutting in maneuver::cut in"
    van = poses_of(saved.entities[1].poses)
    assert van[0, 2] == pytest.approx(-1.75, abs=1e-3)
    [walk] = saved.paths
    assert (walk.kind, walk.name) == ("trajectory", "across")
    assert len(points_of(walk.points)) == 2
    done = marked.run("viewer", "play", str(file), "--save", str(out))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{out}: 9.00 s, 4 entities, 2 events began\n"
    recorded = read_recording(out)
    assert recorded.rows[f"{paths.SPEEDS}/000-Ego"] == len(poses_of(saved.entities[0].poses)) == 181
    assert recorded.rows[paths.EVENTS] == len(saved.transitions)
    assert not list(tmp_path.glob("*.tmp"))


@needs_vulkan
def test_a_picture_shows_bodies_lanes_and_marks(marked, tmp_path: Path) -> None:
    file, out = write_cut_in(tmp_path), tmp_path / "c.png"
    done = marked.run("viewer", "play", str(file), "--shot", str(out), "--at-s", "4")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert done.stdout == f"{out}: 4 s\n"
    picture = cv2.imread(str(out))
    assert picture.shape == (720, 1280, 3)
    near = picture[NEAR_VIEW]
    ego = pixels(near, paths.EGO_COLOR)
    van = pixels(near, paths.CATEGORY_COLORS["van"])
    assert len(ego) > 300
    assert len(van) > 300
    # The van is before the ego, and half a lane to its left in the middle of its change.
    assert np.median(van[:, 1]) > np.median(ego[:, 1]) + 20
    assert 4 < np.median(ego[:, 0]) - np.median(van[:, 0]) < 24
    assert len(pixels(near, (242, 194, 48))) > 300, "yellow marks"
    assert len(pixels(near, (64, 68, 77))) > 20_000, "lanes"


def test_what_cannot_be_played_is_one_line(marked, tmp_path: Path) -> None:
    file = write_cut_in(tmp_path)
    file.write_text(
        file.read_text().replace('entityRef="van" value="25"', 'entityRef="bike" value="25"')
    )
    for words in (["--shot", str(tmp_path / "c.png")], ["--web"]):
        done = marked.run("viewer", "play", str(file), *words)
        assert (done.returncode, done.stdout) == (2, "")
        [line] = done.stderr.splitlines()
        assert line.startswith(f"twin: {file}:")
        assert "bike" in line
    assert not (tmp_path / "c.png").exists()


@pytest.mark.parametrize(("at", "moment"), [([], None), (["--at-s", "4.5"], 4.5)])
def test_a_browser_gets_the_recording_from_one_port(marked, tmp_path: Path, at, moment) -> None:
    file = write_cut_in(tmp_path)
    child = marked.start("viewer", "play", str(file), "--web", *at)
    url = child.stdout.readline().split()[0]
    home, _, when = url.partition("view?case=cut-in")
    assert when == ("" if moment is None else f"#when=sim_time@+{moment}s")
    with urllib.request.urlopen(f"{home}about.json", timeout=PATIENCE_S) as answer:
        about = json.load(answer)
    assert about["cases"][0]["moment_s"] == moment
    with urllib.request.urlopen(f"{home}recording/cut-in.rrd", timeout=PATIENCE_S) as answer:
        assert answer.read(4) == b"RRF2"
    child.send_signal(signal.SIGINT)
    assert (child.wait(PATIENCE_S), child.stderr.read()) == (0, "")


def test_with_a_speed_the_player_calls_the_viewer(
    marked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is no display the viewer says so, and the player names what to do."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    file = write_cut_in(tmp_path)
    done = marked.run("twin", "play", str(file), "--speed", "4")
    assert done.returncode == 2
    assert "walk across" in done.stdout, "its table comes first"
    first, second = done.stderr.splitlines()[-2:]
    assert first.startswith("viewer: no display here")
    assert second.startswith("twin: --speed 4 opens a window")
    assert f"viewer play {file} --speed 4 --web" in second
