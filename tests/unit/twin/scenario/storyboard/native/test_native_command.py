"""``twin validate scenario`` and ``twin play`` on scenario files."""

from __future__ import annotations

import csv
import json

import msgspec
import pytest
from typer.testing import CliRunner

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import scenario_text

from twin.base.errors import InfrastructureError, UsageError
from twin.cli import app as twin
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native
from twin.scenario.storyboard.program.program import ElementKind
from twin.validate.command import app
from twin.validate.scenario_picture import write_scenario_picture
from twin.validate.scenario_play import play_scenario

VAN = "van: {kind: van, lane: 3, ahead_m: 40, speed_mps: 25}"
EVENT = "brake: {at_s: 0.2, do: {van: {stop: true}}}"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "test.yaml"
    path.write_text(scenario_text(VAN, EVENT, end="{after_s: 0.5}"))
    return path


def test_it_says_what_a_file_does(file):
    result = CliRunner().invoke(app, ["scenario", str(file)])
    assert result.exit_code == 0, result.output
    assert result.output.splitlines() == [
        "scenario test on road motorway",
        "ego: car at x 100.0 m, y -7.6 m, road motorway, OpenDRIVE lane -3, 20 m/s",
        "van: van at x 144.9 m, y -3.9 m, road motorway, OpenDRIVE lane -2, 25 m/s",
        "event brake: van: speed; when 0.2 s",
        "ends when 0.5 s",
    ]


def test_json_has_the_mistakes(file):
    file.write_text(scenario_text(VAN.replace("lane: 3", "lane: 9"), EVENT))
    result = CliRunner().invoke(app, ["scenario", str(file), "--output", "json"])
    assert result.exit_code == 2
    answer = json.loads(result.output)
    assert not answer["valid"]
    assert len(answer["mistakes"]) == 1
    assert answer["mistakes"][0].startswith(f"{file}: actors.van.lane: lane 9 is not on road")


def test_mistakes_are_lines(file):
    file.write_text("scenario: test\n")
    with pytest.raises(UsageError) as caught:
        CliRunner().invoke(app, ["scenario", str(file)], catch_exceptions=False)
    assert str(caught.value).splitlines() == [
        f"{file}: road: missing; text needed",
        f"{file}: ego: missing; a mapping needed",
    ]


def test_a_distribution_varies_no_scenario_file(file):
    with pytest.raises(UsageError, match="a campaign varies scenario files, no distribution does"):
        CliRunner().invoke(
            app, ["scenario", str(file), "--distribution", "a.xosc"], catch_exceptions=False
        )


@pytest.mark.slow
def test_a_picture_is_drawn_the_same_each_time(file, tmp_path):
    paths = [tmp_path / "new" / "one.png", tmp_path / "two.png"]
    for path in paths:
        result = CliRunner().invoke(app, ["scenario", str(file), "--picture", str(path)])
        assert result.exit_code == 0, result.output
    one, two = (path.read_bytes() for path in paths)
    assert one == two
    assert one.startswith(b"\x89PNG")
    assert len(one) > 10_000


@pytest.mark.slow
def test_a_picture_needs_the_name_of_one(file, tmp_path):
    with pytest.raises(UsageError, match=r"look\.jpeg: a picture is a \.png or \.svg file"):
        CliRunner().invoke(
            app,
            ["scenario", str(file), "--picture", str(tmp_path / "look.jpeg")],
            catch_exceptions=False,
        )


@pytest.mark.slow
def test_a_picture_that_cannot_be_written_is_no_mistake_of_the_file(file):
    with pytest.raises((UsageError, InfrastructureError), match="no-such-device"):
        CliRunner().invoke(
            app,
            ["scenario", str(file), "--picture", "/proc/no-such-device/a.png"],
            catch_exceptions=False,
        )


@pytest.mark.slow
def test_a_scenario_file_is_played(file, tmp_path):
    poses = tmp_path / "poses.csv"
    result = CliRunner().invoke(twin, ["play", str(file), "--csv", str(poses), "--output", "json"])
    assert result.exit_code == 0, result.output
    # Nothing else is said on stdout.
    assert json.loads(result.stdout)
    lines = poses.read_text().splitlines()
    rows = [row for row in csv.DictReader(lines) if row["entity"] == "van"]
    assert float(rows[0]["speed_mps"]) == 25.0
    assert float(rows[-1]["time_s"]) == pytest.approx(0.5)
    # Braking by 3 m/s2 since 0.2 s.
    assert float(rows[-1]["speed_mps"]) == pytest.approx(25.0 - 0.3 * 3.0, abs=0.04)


@pytest.mark.slow
def test_events_are_those_of_their_actors_whatever_their_group_is_called(file, tmp_path):
    program = compile_native(load_native(file))
    elements = [
        msgspec.structs.replace(one, name="group") if one.kind is ElementKind.GROUP else one
        for one in program.elements
    ]
    play = play_scenario(msgspec.structs.replace(program, elements=tuple(elements)))
    assert [(event.actor, event.name) for event in play.events] == [("van", "brake")]
    write_scenario_picture(tmp_path / "look.svg", RoadMap(program.network), play)
    assert "0.20 s van: brake" in (tmp_path / "look.svg").read_text()
