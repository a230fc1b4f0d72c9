"""conductor.run.twin_check: scenes and plug-ins are checked before a case is leased."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest
import yaml
from plugin_site import EXAMPLE, ROOT, beside

from conductor.run.source import check

CAR = {"kind": "car", "name": "broken", "waypoints": [[60.0, -2.9]]}
VAN = {"kind": "van", "waypoints": [[62.0, -2.4]], "yaw_deg": 30}
WALKER = {"kind": "pedestrian", "name": "walker", "waypoints": [[9, 9], [9, 0]], "speed_mps": 1}


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """A cache folder that nothing is in."""
    monkeypatch.delenv("WARP_CACHE_PATH", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def lines(tmp_path, scene, **changes):
    """What is wrong with a campaign in this scene."""
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump({"schema": 1, "scene": "own", **scene}))
    data = {"campaign": "c", "scenario": {"scene": str(path)}, "matrix": {"repeat": [0]}, **changes}
    _, mistakes = check(data)
    return [mistake.line("c.yaml") for mistake in mistakes]


def test_a_good_scene_passes(tmp_path):
    objects = [CAR, {**VAN, "waypoints": [[66.5, -2.4]]}, WALKER]
    free = {"objects": objects, "furniture": {"parked_cars": 0.0}}
    varied = {"objects": {"walker": {"speed_mps": 2.0, "start_s": 1.0, "offset_m": -3.0}}}
    assert lines(tmp_path, free, **varied) == []


def test_a_mistake_of_the_scene_file_is_told_with_the_campaigns(tmp_path):
    (line,) = lines(tmp_path, {"obstacel": {"x_m": 200}})
    assert "scenario.scene" in line
    assert "did you mean 'obstacle'?" in line


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (
            {"objects": [CAR, VAN], "furniture": {"parked_cars": 0.0}},
            ["objects[0] (car 'broken') at (60.0, -2.9) overlaps objects[1] (van) at (62.0, -2.4)"],
        ),
        (
            {"objects": [CAR], "furniture": {"parked_cars": 1.0}},
            ["overlaps a parked car of the street", "lower furniture.parked_cars"],
        ),
        (
            {"obstacle": {"x_m": 200, "y_m": -0.7}, "objects": [{**CAR, "waypoints": [[203, 0]]}]},
            ["obstacle at (2", "overlaps objects[0]"],
        ),
    ],
)
def test_parked_cars_that_overlap_are_one_line_each(tmp_path, scene, words):
    found = lines(tmp_path, scene)
    assert found
    assert all("overlaps" in line for line in found)
    assert all(word in found[0] for word in words), found


@pytest.mark.parametrize(
    ("axis", "words"),
    [
        ("objects.walkr.start_s", ["no object of this name", "did you mean 'walker'?"]),
        ("objects.broken.start_s", ["objects.broken: start_s: it has one waypoint"]),
        ("objects.broken.speed_mps", ["no speed_mps of its own"]),
    ],
)
def test_an_object_that_cannot_be_varied_is_one_line(tmp_path, axis, words):
    scene = {"objects": [CAR, WALKER], "furniture": {"parked_cars": 0.0}}
    (line,) = lines(tmp_path, scene, matrix={axis: [1.0, 2.0]})[:1]
    assert all(word in line for word in words), line


def test_objects_of_a_shipped_scene_are_checked():
    data = {"campaign": "c", "matrix": {"objects.nobody.start_s": [1.0]}}
    _, (mistake,) = check(data)
    assert "nobody" in mistake.message
    assert "stroller" in mistake.message


def test_a_load_that_the_vehicle_cannot_carry_is_one_line_each():
    data = {"campaign": "c", "matrix": {"scenario.load_kg": [0, 400, 720, 900]}}
    assert check({**data, "matrix": {"scenario.load_kg": [0, 400]}})[1] == []
    _, mistakes = check(data)
    told = [mistake.line("c.yaml") for mistake in mistakes]
    assert len(told) == 2
    assert all("scenario.vehicle: vehicle opencav: a load of" in line for line in told)
    assert "mass_max_kg 2750" in told[0]


def test_what_was_good_is_not_looked_at_again_until_it_changes(tmp_path, monkeypatch):
    good, varied = {"objects": [WALKER]}, {"matrix": {"objects.walker.start_s": [1.0]}}
    bad = {**good, "obstacel": {"x_m": 200}}
    assert lines(tmp_path, good) == []
    assert lines(tmp_path, bad)
    monkeypatch.setattr(sys, "executable", "/nothing/that/runs")
    assert lines(tmp_path, good) == []
    for scene, changes in ((bad, {}), (good, varied), ({"objects": [CAR]}, {})):
        with pytest.raises(FileNotFoundError):  # it is asked
            lines(tmp_path, scene, **changes)


def test_a_vehicle_that_was_good_is_not_looked_at_again_until_it_changes(tmp_path, monkeypatch):
    car = tmp_path / "car.yaml"
    shutil.copy(ROOT / "twin" / "vehicle" / "models" / "opencav.yaml", car)
    data = {"campaign": "c", "scenario": {"vehicle": str(car)}, "matrix": {"repeat": [0]}}
    assert check(data)[1] == []
    monkeypatch.setattr(sys, "executable", "/nothing/that/runs")
    assert check(data)[1] == []
    car.write_text(car.read_text() + "\n# changed\n")
    with pytest.raises(FileNotFoundError):  # it is asked
        check(data)


STOPS = """\
campaign: c
scenario: {type: stop_line, line_m: 4}
sensors: {thermometer: {}}
matrix: {repeat: [0]}
"""


@pytest.fixture
def example(tmp_path):
    """Folder of a copy of the example's modules, and what `conductor validate` says beside it."""
    env = beside(tmp_path / "site", "1.0")
    copy = tmp_path / "plugin_example"
    shutil.copytree(EXAMPLE / "plugin_example", copy, ignore=shutil.ignore_patterns("__pycache__"))
    env["PYTHONPATH"] = env["PYTHONPATH"].replace(str(EXAMPLE), str(tmp_path))
    (tmp_path / "c.yaml").write_text(STOPS)

    def validate() -> tuple[int, list[str]]:
        command = [sys.executable, "-m", "conductor", "validate", str(tmp_path / "c.yaml")]
        done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True)
        return done.returncode, (done.stdout + done.stderr).splitlines()

    return copy, validate


@pytest.mark.slow
def test_an_implementation_that_cannot_be_imported_is_one_line_with_its_distribution(example):
    copy, validate = example
    assert validate()[0] == 0
    good = (copy / "thermometer.py").read_text()
    (copy / "thermometer.py").write_text("print('hello')\nimport nothing_like_it\n")
    code, said = validate()
    assert code == 2
    assert [line.partition("c.yaml: ")[2] for line in said if "thermometer" in line] == [
        "sensors.thermometer: plugin-example 1.0: 'plugin_example.thermometer:Thermometer' cannot "
        "be imported: No module named 'nothing_like_it' (line 3); see docs/campaign.md"
    ], said
    (copy / "thermometer.py").write_text(good)
    (copy / "stop_line.py").write_text("raise SystemExit(0)\n")
    code, said = validate()
    assert code == 2
    assert [line for line in said if "scenario.type: plugin-example 1.0: " in line], said


def test_an_implementation_that_takes_its_process_down_is_named(example):
    copy, validate = example
    (copy / "thermometer.py").write_text("import os\nos._exit(7)\n")
    code, said = validate()
    assert code == 3
    assert [line for line in said if "scenes, vehicles, plugin-example 1.0: " in line], said
    assert not [line for line in said if "Traceback" in line]
