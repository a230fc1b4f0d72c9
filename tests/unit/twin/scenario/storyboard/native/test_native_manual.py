"""The manual of scenario files says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import mistakes_of, program_of

from schemas.files.yaml_file import parse_yaml
from schemas.plan import expand, parse_campaign
from twin.play.permutations import play_file
from twin.scenario.storyboard.case.checks import case_mistakes
from twin.scenario.storyboard.native.bodies import BODIES
from twin.scenario.storyboard.native.document import (
    SHIPPED,
    load_native,
    numbers_of,
    shipped_scenarios,
)
from twin.scenario.storyboard.native.orders import POINTS_MAX
from twin.scenario.storyboard.native.reference import reference_tables
from twin.scenario.storyboard.native.sections import ACTORS_MAX, EVENTS_MAX
from twin.scenario.storyboard.program.conditions import ElementState

PAGE = (Path(__file__).parents[6] / "docs" / "scenarios.md").read_text()
FIRST, CAMPAIGN, MEETING, PASSING, *_ = re.findall(
    r"^```yaml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE
)


def test_all_keys_are_listed():
    assert PAGE.endswith("\n## All keys\n\n" + reference_tables())


def test_the_first_scenario_is_one(tmp_path):
    program = program_of(tmp_path, FIRST)
    assert [entity.name for entity in program.entities] == ["ego", "van"]
    assert program.name == "my-cut-in"


def test_the_first_campaign_is_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my-cut-in.yaml").write_text(FIRST)
    campaign, mistakes = parse_campaign(parse_yaml(CAMPAIGN, "my-cut-ins.yaml"))
    assert campaign is not None, mistakes
    assert not case_mistakes(expand(campaign))


def test_the_walker_of_the_manual_is_the_shipped_one(tmp_path):
    shipped = load_native("pedestrian-between-parked-cars").file.read_text()
    lines = [line for line in shipped.splitlines() if "walker: {kind" not in line]
    text = "\n".join(lines).partition("events:\n")[0]
    walker = "  walker: {kind: pedestrian, footway: right, s_m: 107.3}\n"
    program = program_of(tmp_path, f"{text}{walker}events:\n{MEETING}")
    assert len(program.trajectories) == 1


def test_the_overtaker_of_the_manual_cuts_in_ahead_of_the_ego(tmp_path):
    head, _, _ = FIRST.partition("actors:\n")
    path = tmp_path / "passing.yaml"
    path.write_text(head + PASSING + "end: {after_s: 10}\n")
    (one,) = play_file(path, None, None, step_s=0.01, every=100, until_s=20.0)
    elements = one.played.program.elements
    starts = {
        elements[each.element].name: each.step
        for each in one.played.transitions
        if each.state is ElementState.START_TRANSITION
    }
    assert 200 < starts["beside"] < starts["cut_in"] < 700
    last = {row.entity: row for row in one.played.rows}
    assert last["hurry"].x_m - last["ego"].x_m > 5.0
    assert abs(last["hurry"].y_m - last["ego"].y_m) < 0.1


def test_mistakes_read_as_the_manual_says(tmp_path):
    start = FIRST.replace("lane: 3, ahead_m: 40", "lane: 4, ahead_m: 40")
    assert f"my.yaml: {mistakes_of(tmp_path, start)[0]}\n" in PAGE
    other = FIRST.replace("after: cut_in", "after: cutin")
    assert f"my.yaml: {mistakes_of(tmp_path, other)[0]}\n" in PAGE
    apart = FIRST.replace("speed_mps: 15, at_mps2: 4", "arrive: {}")
    assert f"my.yaml: {mistakes_of(tmp_path, apart)[0]}\n" in PAGE
    twice = FIRST.replace("events:", "  car: {kind: car, lane: 3, ahead_m: 41}\nevents:")
    assert f"my.yaml: {mistakes_of(tmp_path, twice)[0]}\n" in PAGE


def test_shipped_scenarios_are_listed_with_their_first_lines():
    for name in shipped_scenarios():
        document = load_native(name)
        first = document.file.read_text().splitlines()[0].removeprefix("# ")
        assert f"| `{name}` | `{document.scenario.road}` | {first} |\n" in PAGE
        if document.file.parent == SHIPPED:  # a rulebook's has no picture of its own
            assert f"](images/scenario-{name}.png)" in PAGE


def test_kinds_are_listed():
    for name, body in BODIES.items():
        size = f"{body.length_m:g} | {body.width_m:g} | {body.height_m:g} | {body.mass_kg:g}"
        speeds = f"{body.speed_max_mps:g} | {body.acceleration_max_mps2:g}"
        row = f"| `{name}` | {size} | {speeds}, {body.deceleration_max_mps2:g} |\n"
        assert row in PAGE


def test_paths_of_numbers_in_the_manual_exist():
    numbers = numbers_of(load_native("cut-in")) | numbers_of(load_native("animal-on-rural-road"))
    paths = re.findall(r"`((?:actors|events)\.[\w.]+)`", PAGE)
    assert len(paths) == 3
    assert set(paths) <= set(numbers)


def test_limits_are_those_of_the_code():
    words = f"At most {ACTORS_MAX} actors, {EVENTS_MAX} events and {POINTS_MAX} points of a path"
    assert words in PAGE
