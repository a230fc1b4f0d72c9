"""`viewer play`: what it takes, what it refuses, and at which moment it opens."""

from __future__ import annotations

from pathlib import Path

import pytest
from played_files import played
from recordings import read_recording
from typer.testing import CliRunner

from schemas.files.played_scenario import PlayElement, PlayTransition
from twin.base.errors import UsageError
from twin.records.play_file import read_play, write_play
from viewer.cli import app
from viewer.playing import paths
from viewer.playing.command import PlayerError, PlayOptions, find_moment, load_play, run_play


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "s.play"
    write_play(path, played())
    return path


def test_a_recording_is_written_and_told(file: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "new" / "s.rrd"
    assert run_play(PlayOptions(file, save=out)) == 0
    assert capsys.readouterr().out == f"{out}: 2.00 s, 3 entities, 1 event began\n"
    assert read_recording(out).application_id == paths.APP


def test_the_same_file_gives_the_same_rows(file: Path, tmp_path: Path) -> None:
    outs = [tmp_path / "a.rrd", tmp_path / "b.rrd"]
    for out in outs:
        run_play(PlayOptions(file, save=out))
    first, second = (read_recording(out) for out in outs)
    assert (first.rows, first.recording_id) == (second.rows, second.recording_id)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("s.csv", r"expected a scenario file \(.xosc, .yaml, .yml\), or what `twin play FILE"),
        ("folder", "expected a scenario file"),
        ("none.play", "No such file"),
    ],
)
def test_other_files_are_refused_in_a_line(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError, match=reason) as error:
        load_play(tmp_path / name, tmp_path)
    assert "\n" not in str(error.value)


def test_options_of_the_player_are_for_scenario_files(file: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="it was played already; --until-s=3 is for a scenario"):
        load_play(file, tmp_path, ("--until-s=3",))


def test_outputs_are_looked_at_before_anything_is_read(tmp_path: Path) -> None:
    missing = tmp_path / "none.play"
    with pytest.raises(UsageError, match=r"ends in \.rrd"):
        run_play(PlayOptions(missing, save=tmp_path / "s.png"))
    with pytest.raises(UsageError, match=r"ends in \.png"):
        run_play(PlayOptions(missing, shot=tmp_path / "s.rrd"))


def test_without_a_display_it_says_what_works(file: Path, monkeypatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UsageError, match="no display here; give --web"):
        run_play(PlayOptions(file))


def test_moments(file: Path) -> None:
    play = read_play(file)
    picture = PlayOptions(file, shot=Path("s.png"))
    moment = find_moment(play, picture)
    assert (moment.sim_time_ns, moment.label) == (500_000_000, "event cut in begins at 0.50 s")
    assert find_moment(play, PlayOptions(file)).sim_time_ns == 0
    assert find_moment(play, PlayOptions(file, at_s=2.0)).sim_time_ns == 2_000_000_000
    with pytest.raises(UsageError, match=r"--at-s 2\.1: the scenario ends at 2 s"):
        find_moment(play, PlayOptions(file, at_s=2.1))
    hostile = PlayElement(level="event", name="a\x1b[2J", path="")
    start = PlayTransition(time_s=1.0, element=0, transition="start")
    label = find_moment(played(elements=[hostile], transitions=[start]), picture).label
    assert label == r"event a\x1b[2J begins at 1.00 s"
    assert find_moment(played(transitions=[]), picture).label == "the beginning"


def test_what_the_player_refuses_is_its_line_and_its_exit_code(tmp_path: Path, capfd) -> None:
    path = tmp_path / "broken.xosc"
    path.write_text("<OpenSCENARIO>")
    with pytest.raises(PlayerError) as error:
        load_play(path, tmp_path)
    assert error.value.exit_code == 2
    assert str(error.value) == ""
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"twin: {path}:1: ")
    assert not list(tmp_path.glob("*.play"))


def test_a_name_alone_is_left_to_the_player(tmp_path: Path, capfd) -> None:
    with pytest.raises(PlayerError):
        load_play(Path("no-such-scenario"), tmp_path)
    assert capfd.readouterr().err.startswith("twin: no-such-scenario")


def test_the_command_line(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "s.rrd"
    runner = CliRunner()
    done = runner.invoke(app, ["play", str(file), "--save", str(out), "--speed", "4"])
    assert done.exit_code == 0, done.output
    assert out.exists()
    for words in (["--at-s", "-1"], ["--at-s", "nan"], ["--speed", "0"], ["--permutation", "-1"]):
        assert runner.invoke(app, ["play", str(file), *words]).exit_code == 2, words
    lone = ["--distribution", "d.xosc", "--save", str(out)]
    refused = runner.invoke(app, ["play", str(file), *lone])
    assert "--distribution needs --permutation" in str(refused.exception)
    helped = runner.invoke(app, ["play", "--help"]).output
    assert "viewer play cut-in.xosc --shot cut-in.png --at-s 4.5" in " ".join(helped.split())
