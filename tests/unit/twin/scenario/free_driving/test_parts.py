"""Parts of free driving: what they hold follows from a commit and a number."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from itertools import combinations
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip("lxml", reason="lxml is not installed")

from schemas.files.yaml_file import parse_yaml
from schemas.identity import rig_key
from schemas.names import WEATHERS
from schemas.plan import expand, parse_campaign
from twin.base.errors import UsageError
from twin.cli import app
from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.free_driving.chance import Draws, part_seed
from twin.scenario.free_driving.classes import CLASSES, MOTORWAY, RURAL, STREET
from twin.scenario.free_driving.ledger import LEDGER_FILE, make_part
from twin.scenario.free_driving.part import CAMPAIGN_FILE, part_files, shipped_files
from twin.scenario.free_driving.traffic import scenario_file
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.native.document import SHIPPED

COMMIT, OTHER = "a" * 40, "b" * 40


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return part_files(COMMIT, 3)


def test_seeds_are_digests_of_commit_and_part():
    text = hashlib.sha256(f"free driving {COMMIT} 3".encode()).hexdigest()
    assert part_seed(COMMIT, 3) == int(text[:16], 16) // 2
    assert len({part_seed(commit, part) for commit in (COMMIT, OTHER) for part in range(9)}) == 18


def test_a_part_has_the_same_bytes_again_and_another_part_others(files):
    assert part_files(COMMIT, 3) == files
    other = part_files(COMMIT, 4)
    assert other.keys() == files.keys()
    assert all(other[name] != data for name, data in files.items())


def test_cases_are_every_weather_by_day_and_night_on_every_class(files):
    campaign, mistakes = parse_campaign(parse_yaml(files[CAMPAIGN_FILE].decode(), CAMPAIGN_FILE))
    assert campaign is not None, mistakes
    assert campaign.seed == part_seed(COMMIT, 3)
    cases = [tuple(case.values())[:3] for case in campaign.cases]
    assert len(set(cases)) == 96
    for road_class in CLASSES:
        mine = [case for case in cases if case[0].startswith(road_class.name)]
        assert len({case[0] for case in mine}) == 32
        wanted = {(weather, hour) for weather in WEATHERS for hour in ("13:00", "23:00")}
        assert {case[1:] for case in mine} == wanted


def test_cases_of_a_road_share_a_rig(files):
    campaign, mistakes = parse_campaign(parse_yaml(files[CAMPAIGN_FILE].decode(), CAMPAIGN_FILE))
    assert campaign is not None, mistakes
    keys = Counter((rig_key(case), case.rig.scene) for case in expand(campaign))
    assert {scene: count for (_, scene), count in keys.items()} == {
        f"{road_class.name}.xodr": 32 for road_class in CLASSES
    }
    assert len(keys) == 3


def test_a_part_is_100_km_and_most_of_it_fast():
    way = {road_class: 32 * road_class.drive_m for road_class in CLASSES}
    assert 102e3 < sum(way.values()) < 110e3
    assert way[STREET] < 0.25 * sum(way.values())


@pytest.mark.parametrize("road_class", CLASSES, ids=lambda road_class: road_class.name)
def test_roads_are_smooth_and_have_what_confuses(road_class, files, tmp_path):
    path = tmp_path / f"{road_class.name}.xodr"
    path.write_bytes(files[path.name])
    network = load_network(path)
    assert not find_gaps(network, RoadMap(network).frames)
    (road,) = network.roads.values()
    assert road.length_m > road_class.length_m
    names = [thing.name for thing in road.objects]
    assert names.count("bridge") == road_class.bridges
    assert names.count("gantry") == road_class.gantries
    covers = [thing for thing in road.objects if thing.name in ("manhole cover", "joint")]
    assert len(covers) >= 4
    assert all(thing.height_m < 0.02 for thing in covers)
    rails = [thing for thing in road.objects if thing.subtype == "guardRail"]
    assert (len(rails) >= 4) is (road_class is not STREET)


def test_every_scenario_of_a_part_can_be_played(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, data in files.items():
        Path(name).write_bytes(data)
    for name in sorted(files):
        if name.endswith(".yaml") and name != CAMPAIGN_FILE and name[-6] in "05":
            program = load_storyboard(name, {}).program
            assert program.entities[0].ego
            assert 8 <= len(program.entities) <= 33
            assert program.models[0].politeness < 0.0, "the robot keeps its lane"


def test_nobody_on_a_footway_starts_in_somebody_else():
    for seed in range(1000):
        actors = scenario_file(STREET, "street.xodr", "street-13", seed)["actors"]
        walkers = [actor for actor in actors.values() if "footway" in actor]
        for one, other in combinations(walkers, 2):
            assert one["footway"] != other["footway"] or abs(one["s_m"] - other["s_m"]) > 0.99


def test_what_ships_is_what_is_generated():
    folder = SHIPPED / "free-driving"
    written = shipped_files()
    assert {path.name for path in folder.iterdir()} == set(written)
    for name, data in written.items():
        assert (folder / name).read_bytes() == data


def test_parts_are_listed_once_and_before_they_run(tmp_path):
    first = make_part(tmp_path, COMMIT, 3)
    assert first == tmp_path / "part-03"
    make_part(tmp_path, COMMIT, 3)
    make_part(tmp_path, COMMIT, 1)
    rows = [json.loads(line) for line in (tmp_path / LEDGER_FILE).read_text().splitlines()]
    assert [(row["part"], row["commit"]) for row in rows] == [(3, COMMIT), (1, COMMIT)]
    assert rows[0]["seed"] == part_seed(COMMIT, 3)


def test_a_part_of_another_commit_takes_no_ones_place(tmp_path):
    make_part(tmp_path, COMMIT, 3)
    with pytest.raises(UsageError, match="of another commit, or changed"):
        make_part(tmp_path, OTHER, 3)
    assert OTHER not in (tmp_path / LEDGER_FILE).read_text()


@pytest.mark.parametrize("commit", ["", "HEAD", "a" * 39, "A" * 40])
def test_what_is_no_commit_is_refused(commit, tmp_path):
    done = CliRunner().invoke(
        app, ["driving", "--part", "1", "--commit", commit, "--out", str(tmp_path / "new")]
    )
    assert isinstance(done.exception, UsageError)
    assert "40 hexadecimal digits" in str(done.exception)
    assert not (tmp_path / "new").exists()


def test_draws_do_not_depend_on_other_purposes():
    first = Draws(5, "a")
    again = Draws(5, "a")
    Draws(5, "b").share()
    values = [first.share() for _ in range(5)]
    assert [again.share() for _ in range(5)] == values
    assert all(0.0 <= value < 1.0 for value in values)
    assert Draws(5, "b").share() != values[0]
    lots = [Draws(k, "c").between(2.0, 4.0, 0.5) for k in range(200)]
    assert set(lots) == {2.0, 2.5, 3.0, 3.5, 4.0}
    assert sum(Draws(k, "d").happens(0.25) for k in range(2000)) == pytest.approx(500, abs=80)


def test_speeds_are_those_of_the_roads():
    assert min(MOTORWAY.speed_mps[0]) > 80 / 3.6
    assert min(RURAL.speed_mps[0]) > 70 / 3.6
    assert max(STREET.speed_mps[0]) <= 50 / 3.6
