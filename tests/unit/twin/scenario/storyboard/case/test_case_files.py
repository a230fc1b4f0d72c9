"""Scenario files of cases: what is found wrong before a lease, and what counts in identities."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from schemas.case import Case
from schemas.files.assets import asset_digest, asset_files
from schemas.identity import case_digest, rig_key
from schemas.plan import expand, parse_campaign
from tests.road_files import lane, road, section, xodr
from twin.actors.palette import CLASS_OF, build_palette
from twin.scenario.storyboard.case.bodies import SlotBodies
from twin.scenario.storyboard.case.checks import case_mistakes
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.program.entities import EntityCategory
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.meshes.mesh import DECAL

SCENARIO = """scenario: own
road: {road}
ego: {{lane: 1, s_m: 10, speed_mps: 10}}
actors:
{actors}end: {{after_s: 2}}
"""
ACTOR = "  a{n}: {{kind: {kind}, lane: 1, ahead_m: {ahead}, speed_mps: 1}}\n"


def write(folder: Path, actors: str = ACTOR.format(n=1, kind="car", ahead=30)) -> Path:
    (folder / "own.xodr").write_bytes(xodr(road(900.0, lanes=section(right=lane(-1)))))
    path = folder / "own.yaml"
    path.write_text(SCENARIO.format(road="own.xodr", actors=actors))
    return path


def cases(storyboard: object, matrix: dict[str, Any] | None = None, **more: Any) -> list[Case]:
    scenario = {"type": "storyboard", "storyboard": str(storyboard), **more.pop("scenario", {})}
    campaign, mistakes = parse_campaign(
        {
            "campaign": "own",
            "scenario": scenario,
            "matrix": matrix or {"weather": ["clear"]},
            **more,
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)


def test_a_good_case_has_no_mistakes(tmp_path):
    assert case_mistakes(cases(write(tmp_path))) == []
    assert case_mistakes(cases("cut-in")) == []


@pytest.mark.parametrize(
    ("scenario", "more", "words"),
    [
        ({"storyboard": "cut-inn"}, {}, "did you mean 'cut-in'"),
        ({"storyboard": "gone.yaml"}, {}, "gone.yaml: no such file"),
        ({"storyboard": "gone.xosc"}, {}, "gone.xosc: no such file"),
        ({"scene": "rural"}, {}, "not on the scene's"),
        ({"scene": "downtown-loop"}, {}, "the scene is none"),
        ({"numbers": {"actors.van.ahead": 3.0}}, {}, "actors.van.ahead_m"),
        ({"ego_speed_mps": 3.0}, {}, "leave ego_speed_mps away"),
        ({}, {"control_hz": 250, "camera": {"hz": 10}}, "at most 100 Hz"),
        ({}, {"autonomy": {"cosim": True}}, "autonomy.cosim"),
    ],
)
def test_what_no_case_can_have_is_one_line(scenario, more, words):
    lines = case_mistakes(cases("cut-in", scenario=scenario, **more))
    assert len(lines) == 1, lines
    assert words in lines[0]


def test_there_is_room_for_so_many_bodies(tmp_path):
    many = "".join(ACTOR.format(n=n, kind="car", ahead=20 * n) for n in range(1, 34))
    lines = case_mistakes(cases(write(tmp_path, many)))
    assert lines == [f"{tmp_path / 'own.yaml'}: 33 actors beside the ego, at most 32"]


def test_every_mistake_of_a_file_is_told(tmp_path):
    path = write(tmp_path, ACTOR.format(n=1, kind="tank", ahead=30))
    path.write_text(path.read_text().replace("lane: 1, s_m: 10", "lane: 1, s_m: -10"))
    lines = case_mistakes(cases(path))
    assert len(lines) == 2
    assert all(line.startswith(str(path)) for line in lines)


def test_a_road_without_a_driving_lane_is_no_scene(tmp_path):
    path = write(tmp_path)
    side = section(left="", right=lane(-1, kind="sidewalk"))
    (tmp_path / "own.xodr").write_bytes(xodr(road(900.0, lanes=side)))
    assert case_mistakes(cases(path))


def test_files_count_by_their_contents(tmp_path):
    path = write(tmp_path)
    before = asset_digest(path)
    assert {file.name for file in asset_files(path)} == {"own.yaml", "own.xodr"}
    (tmp_path / "own.xodr").write_bytes(xodr(road(910.0)))
    assert asset_digest(path) != before


def test_files_of_an_openscenario_file_count(tmp_path):
    (tmp_path / "roads").mkdir()
    (tmp_path / "catalogs").mkdir()
    (tmp_path / "roads/a.xodr").write_bytes(xodr())
    (tmp_path / "roads/b & c.xodr").write_bytes(xodr())
    (tmp_path / "catalogs/cars.xosc").write_text("<OpenSCENARIO/>")
    (tmp_path / "other.xosc").write_text("<OpenSCENARIO/>")
    path = tmp_path / "drive.xosc"
    path.write_text(
        "<OpenSCENARIO><ParameterDeclaration name='Road' value='roads/a.xodr'/>"
        "<LogicFile filepath='$Road'/><Old filepath = \"roads/b &amp; c.xodr\"/>"
        '<Directory path="catalogs"/></OpenSCENARIO>'
    )
    names = [str(file.relative_to(tmp_path)) for file in asset_files(path)]
    assert names == ["drive.xosc", "roads/a.xodr", "roads/b & c.xodr", "catalogs/cars.xosc"]


def with_file(case: Case, path: Path) -> Case:
    files = {str(path): asset_digest(path)}
    variation = msgspec.structs.replace(case.variation, files=files)
    rig = msgspec.structs.replace(case.rig, files=files)
    return msgspec.structs.replace(case, variation=variation, rig=rig)


def test_a_case_is_the_same_wherever_its_file_lies(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    one, two = write(tmp_path / "one"), write(tmp_path / "two")
    first, second = (with_file(cases(path)[0], path) for path in (one, two))
    assert case_digest(first) == case_digest(second)
    assert rig_key(first) == rig_key(second)
    two.write_text(two.read_text().replace("speed_mps: 1}", "speed_mps: 2}"))
    changed = with_file(cases(two)[0], two)
    assert case_digest(changed) != case_digest(first)


def test_storyboards_of_a_scene_share_a_rig_and_others_do_not():
    scene = {"scene": "motorway"}
    matrix = {"scenario.storyboard": ["cut-in", "cut-out"]}
    assert len({rig_key(case) for case in cases("cut-in", matrix, scenario=scene)}) == 1
    assert len({rig_key(case) for case in cases("cut-in", matrix)}) == 2


def test_numbers_of_the_file_are_axes():
    axis = "storyboard.actors.van.ahead_m"
    found = cases("cut-in", {axis: [30, -5.5]}, scenario={"numbers": {"ego.speed_mps": 20.0}})
    assert [case.id for case in found] == [
        "actors.van.ahead_m_30",
        "actors.van.ahead_m_minus_5.5",
    ]
    assert [case.variation.scenario.numbers for case in found] == [
        {"ego.speed_mps": 20.0, "actors.van.ahead_m": 30.0},
        {"ego.speed_mps": 20.0, "actors.van.ahead_m": -5.5},
    ]
    assert len({rig_key(case) for case in found}) == 1
    assert len({case_digest(case) for case in found}) == 2


@pytest.mark.parametrize(
    ("scenario", "matrix", "words"),
    [
        ({"type": "lane_keeping"}, {"storyboard.a": [1]}, "belongs to scenario type storyboard"),
        ({"type": "storyboard", "storyboard": "a"}, {"storyboard.a": ["x"]}, "x"),
        ({"type": "storyboard", "storyboard": "a"}, {"storyboard.": [1]}, "unknown axis"),
        ({"type": "storyboard", "storyboard": "a"}, {"scenario.numbers": [1]}, "unknown axis"),
        ({"type": "storyboard"}, {"weather": ["clear"]}, "storyboard"),
        ({"type": "lane_keeping", "storyboard": "a"}, {"weather": ["clear"]}, "belongs to type"),
    ],
)
def test_axes_and_keys_that_make_no_sense(scenario, matrix, words):
    _, mistakes = parse_campaign({"campaign": "own", "scenario": scenario, "matrix": matrix})
    assert len(mistakes) == 1, mistakes
    assert words in mistakes[0].line("own")


def test_programs_are_loaded_once(tmp_path):
    path = write(tmp_path)
    first = load_storyboard(str(path), {})
    assert load_storyboard(str(path), {}) is first
    assert load_storyboard(str(path), {"actors.a1.ahead_m": 40.0}) is not first
    path.write_text(path.read_text().replace("after_s: 2", "after_s: 3"))
    assert load_storyboard(str(path), {}) is not first


def test_weathers_that_would_change_nothing_are_said(tmp_path):
    """Where the file says the weather from the beginning on, by an event that waits for nothing."""
    path, both = write(tmp_path), {"weather": ["clear", "heavy_fog"]}
    assert case_mistakes(cases(path, both)) == []
    text = path.read_text()
    path.write_text(text + "events: {now: {weather: heavy_rain}}\n")
    (line,) = case_mistakes(cases(path, both))
    assert line == (
        f"{path}: the file says the weather, so that clear, heavy_fog are the same: "
        "set scenario.environment: campaign, or leave one weather"
    )
    assert case_mistakes(cases(path)) == []
    assert case_mistakes(cases(path, both, scenario={"environment": "campaign"})) == []
    for later in ("weather: heavy_rain, at_s: 1", "time_of_day: '22:00'", "friction_factor: 0.5"):
        path.write_text(text + f"events: {{now: {{{later}}}}}\n")
        assert case_mistakes(cases(path, both)) == []


@pytest.mark.parametrize("name", ["opencav", "bmw_320i"])
def test_the_ego_of_a_case_is_as_large_as_its_vehicle(tmp_path, name):
    """Its place is where the middle of the vehicle is, and a gap ends at the vehicle's front."""
    path, vehicle = write(tmp_path), load_vehicle(name)
    ego, other = load_storyboard(str(path), {}, vehicle).program.entities
    assert (ego.box.length_m, ego.box.width_m) == (vehicle.length_m, vehicle.width_m)
    assert ego.start.s_m + vehicle.centre_offset_m == pytest.approx(10.0)
    front_m = ego.start.s_m + vehicle.front_offset_m
    rear_m = other.start.s_m + other.box.centre_x_m - other.box.length_m / 2
    assert rear_m - front_m == pytest.approx(30.0)
    kind = load_storyboard(str(path), {}).program.entities[0]
    assert kind.box.length_m == 4.5


def test_a_vehicle_whose_origin_is_at_its_rear_end_has_its_middle_before_it(tmp_path):
    vehicle = msgspec.structs.replace(load_vehicle("opencav"), rear_overhang_m=0.0)
    ego = load_storyboard(str(write(tmp_path)), {}, vehicle).program.entities[0]
    assert ego.box.centre_x_m == vehicle.length_m / 2
    assert ego.start.s_m == pytest.approx(10.0 - vehicle.length_m / 2)


def test_bodies_that_start_inside_the_vehicle_are_said(tmp_path):
    """A car of 4.5 m would end before the other one; the vehicle is longer."""
    near = "  a1: {kind: obstacle, lane: 1, s_m: 12.8, length_m: 1.0, width_m: 1.0}\n"
    path = write(tmp_path, near)
    assert len(load_storyboard(str(path), {}).bodies) == 1
    (line,) = case_mistakes(cases(path))
    assert line.endswith("actors.a1: starts in the same place as 'ego': move one of them")


def test_every_category_of_bodies_has_a_look(tmp_path):
    loaded = load_storyboard(str(write(tmp_path)), {})
    palette = build_palette()
    index = loaded.bodies[0]
    for category in EntityCategory:
        entities = list(loaded.program.entities)
        entities[index] = msgspec.structs.replace(entities[index], category=category)
        program = msgspec.structs.replace(loaded.program, entities=tuple(entities))
        bodies = SlotBodies(2, 32)
        things = bodies.begin(1, type(loaded)(program, loaded.ego, loaded.road))
        sort = palette.kinds[int(bodies.kind[1, 0])].name
        assert sort in CLASS_OF, category
        assert bodies.half_m[1, 0].tolist() == [4.5 / 2, 1.8 / 2], (
            "its own size, whatever it looks like"
        )
        assert things[0].name == "a1"
        assert bodies.there.sum() == 1


def test_a_look_is_the_nearest_in_size_and_others_differ_in_colour():
    palette = build_palette()
    suv = palette.look("car", (4.62, 1.9, 1.72), 0)
    assert suv.size_m == (4.6, 1.88, 1.70)
    assert palette.look("car", (4.62, 1.9, 1.72), 1).kind != suv.kind
    assert palette.look("car", (4.62, 1.9, 1.72), 4).kind == suv.kind
    assert palette.look("trailer", (12.0, 2.5, 4.0), 0).size_m[0] == 13.0


@pytest.mark.parametrize(
    ("sort", "size"),
    [
        ("car", (4.023, 1.712, 1.427)),  # global vehicle target
        ("car", (4.3, 1.8, 1.5)),
        ("motorcycle", (2.08, 0.79, 1.5)),
        ("bicycle", (1.89, 0.6, 1.86)),
        ("pedestrian", (None, None, 1.8)),
        ("child", (None, None, 1.154)),
    ],
)
def test_targets_of_rulebooks_look_as_large_as_they_are(sort, size):
    palette = build_palette()
    given = [0.5 if value is None else value for value in size]
    mesh = palette.kinds[palette.look(sort, given, 0).kind].mesh
    drawn = mesh.points_m[mesh.faces[mesh.tag != DECAL]].reshape(-1, 3)  # without the shade
    extent = drawn.max(axis=0) - drawn.min(axis=0)
    if sort == "car":
        extent[1] = np.ptp(drawn[drawn[:, 2] < 0.8, 1])  # below the mirrors
    for axis, value in enumerate(size):
        if value is not None:
            assert extent[axis] == pytest.approx(value, abs=0.06), (axis, extent)


def test_what_lies_flat_looks_flat_and_is_no_object():
    palette = build_palette()
    plate = palette.look("obstacle", (3.7, 2.4, 0.025), 0)
    assert plate.size_m == (3.7, 2.4, 0.025)
    mesh = palette.kinds[plate.kind].mesh
    assert float(mesh.points_m[:, 2].max()) == pytest.approx(0.025, abs=1e-4)
    assert (mesh.tag == DECAL).all()
    assert palette.look("obstacle", (0.6, 0.6, 0.012), 0).size_m[2] <= 0.02
    assert palette.look("obstacle", (0.3, 0.3, 0.15), 0).size_m == (0.3, 0.3, 0.15)
    assert palette.look("obstacle", (0.3, 1.0, 1.2), 0).size_m == (0.3, 1.0, 1.2)
    assert palette.look("car", (4.6, 1.8, 0.05), 0).sort == "car", "no car is flat"
