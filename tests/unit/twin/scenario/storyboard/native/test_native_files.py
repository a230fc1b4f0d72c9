"""Scenario files: what is read, what is refused, and numbers by path."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.scenario.storyboard.native.document import (
    SHIPPED,
    NativeDocument,
    is_native,
    load_native,
    numbers_of,
    scenario_path,
    shipped_scenarios,
    with_values,
)

CUT_IN = """\
scenario: cut-in
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 30}
actors:
  van: {kind: van, lane: 3, ahead_m: 40, speed_mps: 25}
events:
  cut_in:
    when: {van: {gap_m: {below: 25}}}
    do: {van: {change_lane: 2, in_s: 3.0, shape: sinusoidal}}
  brake:
    after: cut_in
    do: {van: {speed_mps: 15, at_mps2: 4}}
end: {after_s: 15}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(text)
    return path


def lines_of(path: Path) -> list[str]:
    """Mistakes without the file's name."""
    with pytest.raises(ValueError) as caught:
        load_native(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


def test_a_cut_in_takes_a_dozen_lines(tmp_path):
    document = load_native(written(tmp_path, CUT_IN))
    assert len(CUT_IN.splitlines()) == 13
    assert document.scenario.actors["van"].ahead_m == 40.0
    assert document.scenario.events["brake"].after == "cut_in"
    assert document.scenario.end.after_s == 15.0


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "lane: 2, s_m: 60",
            "lane: 2, s_m: 60, lan: 2",
            "ego.lan: unknown key; did you mean 'lane'?",
        ),
        ("kind: van", "kind: vann", "actors.van.kind: given 'vann', allowed: animal, bicycle,"),
        ("ahead_m: 40", "ahead_m: -1", "actors.van.ahead_m: given -1, allowed: a number >= 0"),
        ("ahead_m: 40", "ahead_m: .nan", "actors.van.ahead_m: given nan, allowed: a number"),
        ("ahead_m: 40, ", "", "actors.van: given none of them, exactly one needed of s_m,"),
        ("lane: 3, ", "lane: 3, parked: left, ", "actors.van: given lane and parked, exactly one"),
        ("{below: 25}", "{}", "events.cut_in.when.van.gap_m: given neither below nor above"),
        ("{below: 25}", "{below: 1, above: 2}", "events.cut_in.when.van.gap_m: above 2 must be"),
        ("{gap_m: {below: 25}}", "{}", "events.cut_in.when.van: nothing to wait for; give one of"),
        ("speed_mps: 15, at", "speed_mps: 15, stop: true, at", "events.brake.do.van: given speed_"),
        ("speed_mps: 15, at_mps2", "at_mps2", "events.brake.do.van: at_mps2 is of a change of"),
        ("at_mps2: 4", "at_mps2: 4, in_s: 2", "events.brake.do.van: given at_mps2 and in_s: give"),
        (
            "change_lane: 2",
            "change_lane: 2, offset_m: 1",
            "events.cut_in.do.van: given change_lane",
        ),
        ("change_lane: 2", "change_lane: up", "events.cut_in.do.van.change_lane: given 'up', all"),
        ("after_s: 15", "after_s: 0", "end.after_s: given 0, allowed: a number > 0"),
        ("road: motorway\n", "", "road: missing; text needed"),
        ("  van:", "  Van:", "actors.Van: given 'Van', allowed: text matching"),
        ("  van:", "  ego:", "actors: 'ego' has a section of its own; use another name"),
        ("speed_mps: 25}", "speed_mps: 25, idm: {}}", "actors.van: idm sets up `behaviour: idm`"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, old, new, line):
    assert old in CUT_IN
    lines = lines_of(written(tmp_path, CUT_IN.replace(old, new, 1)))
    assert len(lines) == 1
    assert lines[0].startswith(line)


def test_all_mistakes_come_at_once(tmp_path):
    text = CUT_IN.replace("lane: 2, s_m", "lan: 2, s_m").replace("kind: van", "kind: vann")
    assert len(lines_of(written(tmp_path, text))) == 2


def test_what_is_no_yaml_names_the_line(tmp_path):
    path = written(tmp_path, "scenario: [")
    with pytest.raises(ValueError, match=r"scenario\.yaml:1:12: "):
        load_native(path)


def test_names_and_paths():
    assert scenario_path("cut-in") == SHIPPED / "cut-in.yaml"
    assert scenario_path("mine/cut-in.yaml") == Path("mine/cut-in.yaml")
    assert is_native("cut-in")
    assert is_native("a.yml")
    assert not is_native("a.xosc")
    with pytest.raises(
        ValueError, match=r"^scenario 'cutin' is not shipped; did you mean 'cut-in'"
    ):
        scenario_path("cutin")


@pytest.mark.parametrize("name", shipped_scenarios())
def test_shipped_scenarios_say_what_they_are_for(name):
    document = load_native(name)
    assert document.scenario.scenario == name
    comment = [line for line in document.file.read_text().splitlines() if line.startswith("#")]
    assert len(comment) >= 4
    assert comment[1] == "#"


@pytest.fixture
def cut_in(tmp_path) -> NativeDocument:
    return load_native(written(tmp_path, CUT_IN))


def test_every_number_has_a_path(cut_in):
    numbers = numbers_of(cut_in)
    assert numbers["actors.van.ahead_m"] == 40.0
    assert numbers["events.cut_in.when.van.gap_m.below"] == 25.0
    assert numbers["events.cut_in.do.van.change_lane"] == 2
    assert numbers["ego.offset_m"] == 0.0  # by default
    assert "actors.van.visible" not in numbers
    assert "actors.van.s_m" not in numbers


def test_numbers_of_lists_are_counted():
    numbers = numbers_of(load_native("animal-on-rural-road"))
    assert numbers["events.run.do.deer.path.0.1"] == -1.75


def test_a_number_is_changed_and_nothing_else(cut_in):
    changed = with_values(
        cut_in, {"actors.van.ahead_m": 30, "events.cut_in.do.van.change_lane": 1.0}
    )
    before, after = numbers_of(cut_in), numbers_of(changed)
    assert {path for path in before if before[path] != after[path]} == {
        "actors.van.ahead_m",
        "events.cut_in.do.van.change_lane",
    }
    assert after["actors.van.ahead_m"] == 30.0
    assert numbers_of(cut_in) == before
    assert with_values(cut_in, {}).scenario == cut_in.scenario


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        (
            "actors.van.ahed_m",
            1.0,
            "actors.van.ahed_m: no number of this scenario; did you mean 'ac",
        ),
        ("actors.van.kind", 1.0, "actors.van.kind: no number of this scenario; did you mean"),
        ("nothing", 1.0, "nothing: no number of this scenario; allowed: ego.lane, ego.s_m"),
        ("actors.van.ahead_m", -3.0, "actors.van.ahead_m: given -3.0, allowed: a number >= 0"),
        ("ego.lane", 1.5, "ego.lane: given 1.5, allowed: a whole number >= 1"),
    ],
)
def test_a_wrong_path_or_value_is_one_line(cut_in, path, value, line):
    with pytest.raises(ValueError) as caught:
        with_values(cut_in, {path: value})
    (words,) = str(caught.value).splitlines()
    assert words.startswith(f"{cut_in.file}: {line}")
