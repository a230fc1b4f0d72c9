"""twin.road.surface: triangles against the exact surface."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, WIDTH, geometry, lane, road, section, xodr
from road_networks import composed, junction, shapes, turned

from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.records import RoadNetwork
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.mark_strips import ABOVE_M
from twin.road.surface.patch import SurfacePatch
from twin.road.surface.stations import STEP_M, section_stations
from twin.road.surface.surface import road_surface

FILES = Path(__file__).parents[6] / "shared" / "data" / "openscenario"
SURFACE_M = 0.01
PROFILES = (
    '<elevationProfile><elevation s="0" a="3" b="0.02" c="0.002" d="-0.00002"/></elevationProfile>'
    '<lateralProfile><superelevation s="0" a="0.02" b="0.001" c="0" d="0"/></lateralProfile>'
)


def heights_at(patches: list[SurfacePatch], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """z of the highest triangle above or below each point, NaN where there is none."""
    highest = np.full(len(x), -np.inf)
    for patch in patches:
        a, b, c = patch.points_m[patch.faces].transpose(1, 0, 2)
        ab, ac = b - a, c - a
        det = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
        level = np.abs(det) > 1e-12
        a, ab, ac, det = a[level], ab[level], ac[level], det[level]
        for index in range(len(x)):
            dx, dy = x[index] - a[:, 0], y[index] - a[:, 1]
            u = (dx * ac[:, 1] - dy * ac[:, 0]) / det
            v = (ab[:, 0] * dy - ab[:, 1] * dx) / det
            inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
            if inside.any():
                z = (a[:, 2] + u * ab[:, 2] + v * ac[:, 2])[inside]
                highest[index] = max(highest[index], float(z.max()))
    return np.where(np.isfinite(highest), highest, np.nan)


def hill() -> RoadNetwork:
    """A spiral over a hump with superelevation, marks, a raised sidewalk on each side."""
    raised = WIDTH + '<height sOffset="0" inner="0.14" outer="0.14"/>'
    solid = WIDTH + '<roadMark sOffset="0" type="solid" color="white" width="0.12"/>'
    broken = WIDTH + '<roadMark sOffset="2" type="broken" color="yellow" width="0.15"/>'
    lanes = section(
        left=lane(2, raised, "sidewalk") + lane(1, solid),
        right=lane(-1, broken) + lane(-2, solid) + lane(-3, raised, "sidewalk"),
    )
    bend = geometry('<spiral curvStart="0" curvEnd="0.02"/>', 90.0)
    return read_network(xodr(road(90.0, bend, lanes, more=PROFILES)), "hill")


def of_kind(surface: tuple[SurfacePatch, ...], *kinds: str) -> list[SurfacePatch]:
    return [patch for patch in surface if patch.kind in kinds]


@pytest.mark.parametrize("network", [hill, composed, shapes])
def test_lanes_are_within_a_centimetre(network: Callable[[], RoadNetwork]) -> None:
    roads = RoadMap(network())
    lanes = of_kind(road_surface(roads), "lane")
    rng = np.random.default_rng(1)
    met = 0
    for frame in roads.frames.values():
        if np.abs(frame.curvature(frame.road.length_m)) * 8.0 > 1.0:
            continue  # lanes that fold over themselves
        s = rng.uniform(0.2, 0.98, 60) * frame.road.length_m
        index = frame.section_at(s)
        for k, cross in enumerate(frame.sections):
            mine = s[index == k]
            for record in cross.section.lanes:
                width = cross.width(record.id, mine)
                at = mine[width > 0.1]
                if record.type == "sidewalk" or not len(at):
                    continue
                share = rng.uniform(-0.45, 0.45, len(at))
                t = cross.centre(record.id, at)[0] + share * cross.width(record.id, at)
                exact = frame.pose(at, t)
                z = heights_at(lanes, exact.x_m, exact.y_m)
                assert not np.isnan(z).any()
                slope = np.tan(np.abs(exact.pitch_rad)) + np.tan(np.abs(exact.roll_rad))
                assert (np.abs(z - exact.z_m) < SURFACE_M * (1.0 + slope)).all()
                met += len(at)
    assert met > 100


def test_borders_are_within_a_centimetre_in_the_plane() -> None:
    """Middles of the outermost edges against the nearest place of the exact border."""
    frame = RoadFrame(hill().roads["0"])
    s = section_stations(frame, 0)
    for lane_id in (2, -3):
        t = frame.sections[0].outer(lane_id, s)[0]
        pose = frame.pose(s, t)
        x, y = (0.5 * (v[:-1] + v[1:]) for v in (pose.x_m, pose.y_m))
        place = frame.locate(x, y)
        off = np.abs(place.t_m - frame.sections[0].outer(lane_id, place.s_m)[0])
        assert 0.0 < off.max() < SURFACE_M
    assert np.diff(s).max() <= STEP_M


def test_straight_roads_have_few_triangles() -> None:
    surface = road_surface(RoadMap(read_network(xodr(), "t")))
    (lanes,) = of_kind(surface, "lane")
    assert len(lanes.faces) == 2 * 2 * math.ceil(100.0 / STEP_M)


def test_faces_look_up_and_have_an_area() -> None:
    for network in (hill(), shapes(), junction(), turned()):
        for patch in of_kind(road_surface(RoadMap(network)), "lane", "mark", "ground"):
            a, b, c = patch.points_m[patch.faces].transpose(1, 0, 2)
            assert (np.cross(b - a, c - a)[:, 2] > 0.0).all(), patch.look


def test_kerbs_rise_from_the_lane_to_the_sidewalk() -> None:
    surface = road_surface(RoadMap(hill()))
    (kerbs,) = of_kind(surface, "kerb")
    count = len(kerbs.points_m) // 4
    first = kerbs.points_m[: 2 * count].reshape(2, count, 3)
    rise = np.linalg.norm(first[0] - first[1], axis=1)
    np.testing.assert_allclose(rise, 0.14, atol=1e-6)


def test_marks_lie_just_above_the_lanes() -> None:
    """Corners and middles of all strokes, over a hump and through a dip."""
    surface = road_surface(RoadMap(hill()))
    lanes = of_kind(surface, "lane")
    marks = of_kind(surface, "mark")
    assert {mark.look for mark in marks} == {"white", "yellow"}
    for mark in marks:
        middles = mark.points_m[mark.faces].mean(axis=1)[::3]
        z = heights_at(lanes, middles[:, 0], middles[:, 1])
        inner = ~np.isnan(z) & (np.abs(z - middles[:, 2]) < 0.1)
        assert inner.mean() > 0.45
        gap = middles[inner, 2] - z[inner]
        assert gap.min() > 0.001
        assert gap.max() < ABOVE_M + 0.006


def test_broken_marks_begin_where_they_are_said_to() -> None:
    plain = WIDTH + '<roadMark sOffset="2" type="broken" color="yellow" width="0.15"/>'
    network = read_network(xodr(road(lanes=section(left="", right=lane(-1, plain)))), "t")
    (mark,) = of_kind(road_surface(RoadMap(network)), "mark")
    starts = np.unique(np.round(mark.points_m[:, 0], 6))
    assert {2.0, 5.0, 11.0, 14.0, 20.0} <= set(starts.tolist())
    assert not ((starts > 5.0) & (starts < 11.0)).any()
    np.testing.assert_allclose(np.unique(np.round(mark.points_m[:, 1], 6)), [-3.575, -3.425])


def test_the_ground_lies_below_all_lanes() -> None:
    for network in (hill(), shapes(), junction()):
        roads = RoadMap(network)
        surface = road_surface(roads)
        ground = of_kind(surface, "ground")
        points = np.concatenate([p.points_m for p in of_kind(surface, "lane")])[::7]
        z = heights_at(ground, points[:, 0], points[:, 1])
        assert not np.isnan(z).any()
        # Slopes begin at the outermost border itself.
        assert (z <= points[:, 2] + 1e-6).all()


def test_lanes_that_begin_with_no_width_leave_no_slivers() -> None:
    opening = '<width sOffset="0" a="0" b="0" c="0.0026" d="-0.0000173"/>'
    network = read_network(xodr(road(lanes=section(right=lane(-1) + lane(-2, opening)))), "t")
    for patch in road_surface(RoadMap(network)):
        assert np.isfinite(patch.points_m).all()


def test_widths_that_jump() -> None:
    """A lane that is 2 m wider from one millimetre to the next."""
    jump = WIDTH + '<width sOffset="50" a="5.5" b="0" c="0" d="0"/>'
    network = read_network(xodr(road(lanes=section(left="", right=lane(-1, jump)))), "t")
    s = section_stations(RoadFrame(network.roads["0"]), 0)
    assert 50.0 in s
    assert np.isclose(s, 49.999).any()
    (lanes,) = of_kind(road_surface(RoadMap(network)), "lane")
    z = heights_at([lanes], np.array([49.9, 50.1]), np.array([-4.5, -4.5]))
    assert np.isnan(z).tolist() == [True, False]


def test_a_section_with_too_many_points_is_refused() -> None:
    """20 km with 2,000 lanes beside one another."""
    lanes = section(left="", right="".join(lane(-k) for k in range(1, 2001)))
    file = xodr(road(20_000.0, geometry(LINE, 20_000.0), lanes))
    roads = RoadMap(read_network(file, "wide.xodr"))
    with pytest.raises(ValueError, match=r"^wide\.xodr: road 0: its lanes would have more than"):
        road_surface(roads)


def test_a_network_without_any_width_is_refused() -> None:
    none = '<width sOffset="0" a="0" b="0" c="0" d="0"/>'
    lanes = section(left="", right=lane(-1, none))
    network = read_network(xodr(road(plan=geometry(LINE, 100.0), lanes=lanes)), "thin.xodr")
    with pytest.raises(ValueError, match=r"^thin\.xodr: no lane has an area$"):
        road_surface(RoadMap(network))


@pytest.mark.slow
@pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")
def test_roads_of_others() -> None:
    for path in sorted(FILES.rglob("*.xodr")):
        surface = road_surface(RoadMap(load_network(path)))
        assert {patch.kind for patch in surface} >= {"lane", "ground"}, path
        assert sum(len(patch.faces) for patch in surface) < 300_000, path
