"""Houses and trees that scene files put beside OpenDRIVE roads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import crossing, geometry, road, xodr

from schemas.messages import SEMANTIC_CLASSES
from twin.render.light.ground_light import GroundLight
from twin.validate.scene_check import Variant, check_scenes
from twin.world.roadside.lamp_rows import LAMPS_MAX
from twin.world.roadside.scenery import HOUSES_MAX, TREES_MAX
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world


def scene_with(folder: Path, scenery: str, data: bytes | None = None) -> str:
    (folder / "own.xodr").write_bytes(xodr(road(200.0)) if data is None else data)
    path = folder / "scene.yaml"
    path.write_text(
        f"schema: 1\nscene: own\nstreet: false\nbake: false\nopendrive: own.xodr\n{scenery}"
    )
    return str(path)


def build(folder: Path, scenery: str, data: bytes | None = None) -> World:
    return build_world(load_scene(scene_with(folder, scenery, data)))


HOUSES = "scenery: {houses: [{offset_m: 4, width_m: [10, 10], gap_m: [5, 5], depth_m: 8%s}]}\n"


def test_houses_stand_in_rows_with_their_fronts_to_the_road(tmp_path):
    world = build(tmp_path, HOUSES % "")
    hulls = world.colliders
    # The lanes end at 3.5 m; fronts are 4 m outside, and a house is 8 m deep.
    left, right = hulls[hulls[:, 1] > 0], hulls[hulls[:, 1] < 0]
    assert len(left) == len(right) == 13
    assert left[:, 0] == pytest.approx(5.0 + 15.0 * np.arange(13))
    assert left[:, 1] == pytest.approx(3.5 + 4.0 + 4.0)
    assert right[:, 1] == pytest.approx(-11.5)
    assert hulls[:, 3:] == pytest.approx(np.array([(5.0, 4.0)] * 26))
    building = world.mesh.semantic == SEMANTIC_CLASSES.index("building")
    walls = world.mesh.points_m[world.mesh.faces[building]]
    assert np.abs(walls[..., 1]).min() > 3.5 + 4.0 - 2.0, "at most awnings before the fronts"
    assert {thing.kind for thing in world.things} == {"building"}


def test_a_row_may_be_a_part_of_one_side(tmp_path):
    world = build(tmp_path, HOUSES % ", side: left, from_m: 50, to_m: 90, road: '0'")
    assert world.colliders[:, 0] == pytest.approx([55.0, 70.0, 85.0])
    assert (world.colliders[:, 1] > 0).all()


def test_fronts_follow_a_curve(tmp_path):
    bend = xodr(road(150.0, geometry('<arc curvature="0.01"/>', 150.0)))
    world = build(tmp_path, HOUSES % ", side: right", bend)
    radius = np.hypot(*(world.colliders[:, :2] - (0.0, 100.0)).T)
    assert radius == pytest.approx(111.5, abs=1e-6)
    turn = np.arctan2(world.colliders[:, 0], 100.0 - world.colliders[:, 1])
    apart = np.mod(world.colliders[:, 2] - turn + 0.5 * np.pi, np.pi) - 0.5 * np.pi
    assert apart == pytest.approx(0.0, abs=1e-6)


def test_nothing_stands_on_a_road_or_in_another_house(tmp_path):
    rows = "{offset_m: 1, gap_m: [0, 3]}, {offset_m: 2}"
    trees = "trees: [{offset_m: 0.5, spacing_m: 4}]"
    world = build(tmp_path, f"scenery: {{houses: [{rows}], {trees}}}\n", cross_roads())
    lanes = world.mesh.semantic == SEMANTIC_CLASSES.index("road")
    points = world.mesh.points_m[world.mesh.faces[lanes]].mean(axis=1)
    assert len(world.colliders) > 20
    for x, y, yaw, length, width in world.colliders:
        local = points[:, :2] - (x, y)
        along = local @ (np.cos(yaw), np.sin(yaw))
        across = local @ (-np.sin(yaw), np.cos(yaw))
        assert not ((np.abs(along) < length) & (np.abs(across) < width)).any()
    houses = world.colliders[[thing.kind == "building" for thing in world.things]]
    near = np.hypot(*(houses[:, None, :2] - houses[None, :, :2]).T)
    assert near[~np.eye(len(houses), dtype=bool)].min() > 6.0


def cross_roads() -> bytes:
    """Two roads across each other, joined by nothing."""
    across = road(120.0, geometry("<line/>", 120.0, at=(60.0, -60.0, 0.5 * np.pi)), road_id="1")
    return xodr(road(120.0), across)


def test_trees_stand_at_their_spacing(tmp_path):
    row = "{spacing_m: 25, offset_m: 2, side: right, height_m: [6, 6]}"
    world = build(tmp_path, f"scenery: {{trees: [{row}]}}\n")
    assert world.colliders[:, :2] == pytest.approx(
        np.array([(25.0 * k, -5.5) for k in range(9)]), abs=1e-9
    )
    assert {thing.kind for thing in world.things} == {"vegetation"}


def test_roads_of_a_junction_are_left_out_and_seeds_change_houses(tmp_path):
    rows = "scenery: {trees: [{spacing_m: 5, offset_m: 3, jitter_m: 1}]}\n"
    one = build(tmp_path, rows, crossing())
    assert not ((one.colliders[:, 0] > 52) & (one.colliders[:, 0] < 68)).any()
    again = build(tmp_path, rows, crossing())
    other = build(tmp_path, rows + "seed: 4\n", crossing())
    assert np.array_equal(one.mesh.points_m, again.mesh.points_m)
    assert not np.array_equal(one.colliders, other.colliders)


def test_a_share_of_the_places_is_built_on(tmp_path):
    every = len(build(tmp_path, HOUSES % "").colliders)
    half = len(build(tmp_path, HOUSES % ", share: 0.5").colliders)
    assert 0 < half < every
    assert not len(build(tmp_path, HOUSES % ", share: 0").colliders)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenery: {houses: [{road: gone}]}", "scenery.houses[0].road: "),
        ("scenery: {trees: [{}, {road: '0', from_m: 900}]}", "road 0 is 200 m long"),
        ("scenery: {trees: [{from_m: 90, to_m: 20}]}", "to_m 20 must lie behind from_m 90"),
        ("scenery: {trees: [{spacing_m: -1}]}", "spacing_m"),
        ("scenery: {trees: [{offset_m: .nan}]}", "offset_m"),
        ("scenery: {trees: [{height_m: [9, 5]}]}", "smallest first"),
        ("scenery: {houses: [{width_m: [1, 5]}]}", "at least 4 m wide"),
        ("scenery: {houses: [{gap_m: [-5, 5]}]}", "gap_m"),
        ("scenery: {house: []}", "house"),
    ],
)
def test_scenery_that_cannot_be_is_one_line(tmp_path, text, words):
    findings = check_scenes([Variant(scene_with(tmp_path, text + "\n"), {})])
    assert len(findings.mistakes) == 1
    assert words in findings.mistakes[0]
    assert "\n" not in findings.mistakes[0]


def test_scenery_needs_roads(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("schema: 1\nscene: odd\nscenery: {trees: [{}]}\n")
    findings = check_scenes([Variant(str(path), {})])
    assert "name it in opendrive" in findings.mistakes[0]


@pytest.mark.parametrize(
    ("kind", "row", "most"),
    [
        ("trees", "{spacing_m: 2, offset_m: 5}", TREES_MAX),
        ("houses", "{width_m: [4, 5]}", HOUSES_MAX),
    ],
)
def test_too_much_scenery_is_one_line(tmp_path, kind, row, most):
    rows = ", ".join([row] * 6)
    text = f"scenery: {{{kind}: [{rows}]}}\n"
    findings = check_scenes([Variant(scene_with(tmp_path, text, xodr(road(2000.0))), {})])
    assert len(findings.mistakes) == 1
    assert f"at most {most}; use fewer" in findings.mistakes[0]


LAMPS = "furniture: {lamp_height_m: 9.0}\nscenery: {lamps: [{%s}]}\n"


def test_street_lamps_stand_in_rows_and_reach_over_the_road(tmp_path):
    row = "from_m: 20, to_m: 70, spacing_m: 25, lateral_m: -6"
    world = build(tmp_path, LAMPS % row)
    assert world.lamps == pytest.approx(np.array([(20.0, -4.1), (45.0, -4.1), (70.0, -4.1)]))
    assert world.colliders[:, :2] == pytest.approx(np.array([(20, -6), (45, -6), (70, -6)]))
    assert {thing.name for thing in world.things} == {"street lamp"}
    lamp = world.mesh.semantic == SEMANTIC_CLASSES.index("lamp")
    luminaires = world.mesh.points_m[world.mesh.faces[lamp]]
    assert luminaires[..., 2].min() == pytest.approx(9.09, abs=0.01)
    assert luminaires[..., 1].min() > -4.6
    left = build(tmp_path, LAMPS % "spacing_m: 100, lateral_m: 6")
    assert left.lamps == pytest.approx(np.array([(0.0, 4.1), (100.0, 4.1), (200.0, 4.1)]))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("lateral_m: 5, road: '9'", "scenery.lamps[0].road: "),
        (
            "lateral_m: 5, from_m: 300, road: '0'",
            "scenery.lamps[0].from_m 300: road 0 is 200 m long",
        ),
        ("lateral_m: 5, from_m: 90, to_m: 80", "to_m 80 must lie behind from_m 90"),
        ("from_m: 5", "lateral_m"),
    ],
)
def test_rows_of_lamps_that_cannot_be_are_refused(tmp_path, row, message):
    with pytest.raises(ValueError, match=r"lamps|lateral_m|to_m") as refused:
        build(tmp_path, LAMPS % row)
    assert message in str(refused.value)


def test_too_many_lamps_are_refused(tmp_path):
    rows = ", ".join(["{spacing_m: 2, lateral_m: 6}"] * 20)
    with pytest.raises(ValueError, match=f"more than {LAMPS_MAX} lamps"):
        build(tmp_path, f"scenery: {{lamps: [{rows}]}}\n")


def test_the_lit_track_has_the_light_of_night_tests_where_pedestrians_are_met():
    scene = load_scene("track-lit")
    light = GroundLight(build_world(scene), scene.furniture, 1)
    line = [light.lamps_lx((150.0, y), 0.0) for y in np.linspace(-5.75, 4.25, 21)]
    assert 15.0 < min(line) <= max(line) < 18.0
    path = [light.lamps_lx((x, -1.75), 0.0) for x in np.arange(90.0, 150.0, 0.5)]
    assert np.mean(path) == pytest.approx(22.0, abs=1.0)
    assert scene.opendrive == load_scene("track").opendrive
