"""Broken scenes and vehicles are one line with the file's name before a rig is started."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from broken_assets import BROKEN_SCENES, BROKEN_VEHICLES, OBJ, write_scene, write_vehicle
from many_commands import run_many
from processes import outcomes

PICTURE = ("--width", "32", "--weather", "clear", "--time", "12:00")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """All broken scenes, by name."""
    folder = tmp_path_factory.mktemp("scenes")
    return {name: write_scene(folder, name) for name in BROKEN_SCENES}


@pytest.fixture(scope="module")
def vehicles(tmp_path_factory):
    """All broken vehicles, by name."""
    folder = tmp_path_factory.mktemp("vehicles")
    return {name: write_vehicle(folder, name) for name in BROKEN_VEHICLES}


@pytest.fixture(scope="module")
def validated(scenes, vehicles):
    """What `twin validate` says of each."""
    words = [["validate", "scene", str(path)] for path in scenes.values()]
    words += [["validate", "vehicle", str(path)] for path in vehicles.values()]
    imports = ("twin.validate.scene_check", "twin.vehicle.vehicle_file")
    return dict(zip([*scenes, *vehicles.values()], run_many("twin", words, imports), strict=True))


@pytest.fixture(scope="module")
def pictured(scenes, vehicles, tmp_path_factory):
    """What `twin snapshot` says of each."""
    out = tmp_path_factory.mktemp("out") / "picture.png"
    words = [["snapshot", "--scene", str(path)] for path in scenes.values()]
    words += [["snapshot", "--vehicle", str(path)] for path in vehicles.values()]
    commands = [[*each, *PICTURE, "--out", str(out)] for each in words]
    done = run_many("twin", commands, ("twin.snapshot",))
    assert not out.exists()
    return dict(zip([*scenes, *vehicles.values()], done, strict=True))


def campaign(folder: Path, axis: str, files: list[Path]) -> Path:
    """A campaign over these scenes or vehicles."""
    path = folder / "c.yaml"
    path.write_text(json.dumps({"campaign": "c", "matrix": {axis: list(map(str, files))}}))
    return path


def conducted(folder: Path, axis: str, files: list[Path]) -> list[subprocess.CompletedProcess[str]]:
    """What `conductor validate` and `conductor run` say of a campaign over ``files``."""
    path, out = campaign(folder, axis, files), folder / "run"
    commands = [["validate", str(path)], ["run", str(path), "--out", str(out)]]
    done = run_many("conductor", commands)
    assert not out.exists(), "a rig was started, or a conductor"
    return done


@pytest.fixture(scope="module")
def refused_scenes(scenes, tmp_path_factory):
    """A campaign over all broken scenes."""
    folder = tmp_path_factory.mktemp("campaign")
    return conducted(folder, "scenario.scene", list(scenes.values()))


@pytest.fixture(scope="module")
def refused_vehicles(vehicles, tmp_path_factory):
    """A campaign over all broken vehicles."""
    folder = tmp_path_factory.mktemp("campaign")
    return conducted(folder, "scenario.vehicle", list(vehicles.values()))


def one_line(done, *words):
    """The command failed with exit code 2 and one line that holds ``words``."""
    assert done.returncode == 2, (done.stdout, done.stderr)
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert not [word for word in words if word not in lines[0]], lines[0]


def a_line_of(done, path, *words):
    """The command failed with exit code 2, and one of its lines is about ``path``."""
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    lines = [line for line in done.stderr.splitlines() if str(path) in line]
    assert len(lines) == 1, done.stderr
    assert not [word for word in words if word not in lines[0]], lines[0]


@pytest.mark.parametrize("name", BROKEN_SCENES)
def test_a_broken_scene(name, scenes, validated, pictured, refused_scenes):
    words = BROKEN_SCENES[name][1]
    one_line(validated[name], *words)
    one_line(pictured[name], *words)
    for done in refused_scenes:
        a_line_of(done, scenes[name].parent, "scenario.scene", *words)


@pytest.mark.parametrize("name", BROKEN_VEHICLES)
def test_a_broken_vehicle(name, vehicles, validated, pictured, refused_vehicles):
    path, words = vehicles[name], (f"{name}.yaml", BROKEN_VEHICLES[name][2])
    one_line(validated[path], *words)
    one_line(pictured[path], *words)
    for done in refused_vehicles:
        a_line_of(done, path, "scenario.vehicle", *words)


@pytest.mark.parametrize("axis", ["scenario.scene", "scenario.vehicle"])
def test_a_campaign_with_one_mistake_says_one_line(tmp_path, axis):
    write = write_scene if axis == "scenario.scene" else write_vehicle
    name = "mesh-nan" if axis == "scenario.scene" else "flat"
    for done in conducted(tmp_path, axis, [write(tmp_path, name)]):
        one_line(done, axis, name)


def test_a_good_scene_of_files_runs(marked, tmp_path):
    """Files that are not broken, in the simulator of a worker; no process of theirs is left."""
    (tmp_path / "wall.obj").write_text(OBJ)
    np.save(tmp_path / "hill.npy", np.zeros((3, 4)))
    scene = {
        "street": False,
        "terrain": {"heightmap": "hill.npy", "size_m": [400, 400]},
        "meshes": [{"file": "wall.obj", "position_m": [30, 5, 0]}],
    }
    path = tmp_path / "own.yaml"
    path.write_text(json.dumps({"schema": 1, "scene": "own", **scene}))
    file = campaign(tmp_path, "scenario.scene", [path])
    data = {**json.loads(file.read_text()), "camera": {"width": 32, "height": 18}}
    file.write_text(json.dumps({**data, "scenario": {"duration_s": 0.2}}))
    out = tmp_path / "run"
    done = marked.run("conductor", "run", str(file), "--out", str(out), "--workers", "1")
    assert done.returncode in (0, 1), done.stderr
    (row,) = outcomes(out).values()
    assert row["outcome"] == "verdict", row
