"""What of a recorded drive becomes a scenario, and the files that are written."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from schemas.files.yaml_file import load_yaml
from twin.base.errors import UsageError
from twin.drives.check import check_scenario
from twin.drives.drive import DrivenObject, RecordedDrive
from twin.drives.road_along import LANE_M, road_text
from twin.drives.scenario import FAR_M, DriveCut, cut_drive
from twin.drives.thinning import (
    HEADING_TOLERANCE_RAD,
    PLACE_TOLERANCE_M,
    at_times,
    cut,
    thinned,
    unwrapped,
)
from twin.drives.writing import scenario_name, write_drive
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.native.sections import ACTORS_MAX

TIMES = np.arange(0.0, 10.01, 0.1)


def straight(x: float, y: float, speed: float, times=TIMES, heading: float = 0.0) -> np.ndarray:
    moved = speed * (times - times[0])
    x_m, y_m = x + moved * math.cos(heading), y + moved * math.sin(heading)
    rest = np.zeros_like(times)
    return np.column_stack([times, x_m, y_m, rest, rest + heading])


def seen(name: str, poses: np.ndarray, kind: str = "car", size=(4.4, 1.8, 1.5)) -> DrivenObject:
    return DrivenObject(name, kind, np.array(size), poses)


def drive(*objects: DrivenObject, ego: np.ndarray | None = None) -> RecordedDrive:
    poses = straight(0.0, 0.0, 10.0) if ego is None else ego
    return RecordedDrive("/odom", "/objects", "map", poses, list(objects), [], [])


def wanted(from_s=0.0, to_s=None, range_m=120.0, moved=True) -> DriveCut:
    return DriveCut(from_s, to_s, range_m, moved)


def test_scenario_begins_where_the_stack_takes_over():
    lead = seen("lead", straight(30.0, 1.0, 8.0))
    made = cut_drive(drive(lead), wanted(from_s=2.55, to_s=7.0))
    assert made.duration_s == pytest.approx(4.45)
    assert made.ego[0] == pytest.approx([0.0, 25.5, 0.0, 0.0, 0.0])
    assert made.ego[-1] == pytest.approx([4.45, 70.0, 0.0, 0.0, 0.0])
    (actor,) = made.actors
    assert actor.poses[0] == pytest.approx([0.0, 30.0 + 8.0 * 2.55, 1.0, 0.0, 0.0])
    assert (actor.name, actor.source) == ("car_1", "lead")
    assert (actor.appears_s, actor.vanishes_s) == (None, None)


def test_who_comes_later_or_goes_earlier_appears_and_vanishes():
    times = np.arange(3.0, 6.01, 0.1)
    guest = seen("guest", straight(30.0, 3.0, 1.0, times), "pedestrian", (0.5, 0.5, 1.7))
    (actor,) = cut_drive(drive(guest), wanted(from_s=1.0)).actors
    assert (actor.appears_s, actor.vanishes_s) == pytest.approx((2.0, 5.0))
    assert actor.poses[:2, 0] == pytest.approx([0.0, 2.0])
    assert actor.poses[0, 1:] == pytest.approx(actor.poses[1, 1:])


def test_left_out_are_the_ego_the_far_and_the_many():
    itself = straight(1.5, 0.1, 10.0)
    far = straight(0.0, 500.0, 0.0)
    many = [seen(f"p{index:03}", straight(20.0 + index, 5.0, 0.0)) for index in range(70)]
    made = cut_drive(drive(seen("self", itself), seen("far", far), *many), wanted())
    assert len(made.actors) == ACTORS_MAX
    assert made.notes == [
        "left out: 1 objects that never come nearer than 120 m (--range)",
        "left out: 1 objects that are the ego itself",
        f"left out: 7 objects beyond the nearest {ACTORS_MAX}",
    ]


@pytest.mark.parametrize(("from_s", "to_s"), [(9.9, None), (11.0, None), (3.0, 3.1)])
def test_stretches_that_are_too_short_say_what_is_there(from_s, to_s):
    with pytest.raises(UsageError, match="the ego is recorded from 0 to 10 s"):
        cut_drive(drive(), wanted(from_s, to_s))


def test_far_places_are_moved_by_whole_metres():
    ego = straight(81_377.4, 49_916.8, 5.0)
    made = cut_drive(drive(seen("a", straight(81_390.0, 49_920.0, 5.0)), ego=ego), wanted())
    assert made.origin_m == (81_377.0, 49_916.0)
    assert made.ego[0, 1:3] == pytest.approx([0.4, 0.8])
    assert made.actors[0].poses[0, 1:3] == pytest.approx([13.0, 4.0])
    kept = cut_drive(drive(ego=ego), wanted(moved=False))
    assert kept.ego[0, 1] > FAR_M


def test_thinned_poses_say_the_same():
    angle = 0.002 * TIMES * TIMES
    heading = np.mod(angle + math.pi - 0.2, 2.0 * math.pi) - math.pi
    poses = unwrapped(
        np.column_stack([TIMES, 40.0 * np.sin(angle), 40.0 * np.cos(angle), 0.0 * angle, heading])
    )
    few = thinned(poses)
    assert len(few) < len(poses)
    assert few[0] == pytest.approx(poses[0])
    assert few[-1] == pytest.approx(poses[-1])
    again = at_times(few, poses[:, 0])
    assert np.hypot(*(again - poses)[:, 1:3].T).max() <= PLACE_TOLERANCE_M
    assert np.abs(again - poses)[:, 4].max() <= HEADING_TOLERANCE_RAD
    standing = straight(3.0, 4.0, 0.0)
    assert len(thinned(standing)) == 2


def test_cut_keeps_the_ends_of_a_stretch():
    poses = straight(0.0, 0.0, 10.0)
    part = cut(poses, 0.25, 0.55)
    assert part[:, 0] == pytest.approx([0.25, 0.3, 0.4, 0.5, 0.55])
    assert part[:, 1] == pytest.approx(10.0 * part[:, 0])
    assert len(cut(poses, 11.0, 12.0)) == 0
    assert len(cut(poses, 10.0, 12.0)) == 1


def frame_of(text: str):
    return next(iter(RoadMap(read_network(text.encode(), "road.xodr")).frames.values()))


def test_road_lies_under_the_way_of_the_ego():
    angle = np.linspace(0.0, 1.2, 200)
    x, y = 60.0 * np.sin(angle), 60.0 * (1.0 - np.cos(angle))
    frame = frame_of(road_text(x, y, 0.0, "r"))
    place = frame.locate(x, y)
    assert np.abs(place.t_m).max() < 0.1
    assert set(frame.lane_at(place.s_m, place.t_m).tolist()) == {-1}
    assert set(frame.lane_at(place.s_m, place.t_m + LANE_M).tolist()) == {1}
    assert frame.road.length_m > 72.0 + 250.0


@pytest.mark.parametrize("way", ["stands", "turns on the spot", "drives back"])
def test_ways_that_are_no_roads_get_a_straight_one(way):
    if way == "stands":
        x = y = np.zeros(50)
    elif way == "drives back":
        x = np.concatenate([np.linspace(0.0, 40.0, 50), np.linspace(40.0, 0.0, 50)])
        y = np.zeros(100)
    else:
        angle = np.linspace(0.0, 12.0, 300)
        x, y = 4.0 * np.sin(angle), 4.0 * np.cos(angle)
    frame = frame_of(road_text(x, y, 0.3, "r"))
    assert float(frame.pose(0.0, 0.0).heading_rad) == pytest.approx(0.3, abs=1e-9)
    assert float(frame.curvature(30.0)) == 0.0


def test_written_files_can_be_played(tmp_path):
    times = np.arange(3.0, 6.01, 0.1)
    objects = (
        seen("a b\n'\x1b", straight(30.0, 0.5, 8.0)),
        seen("walker", straight(30.0, 6.0, 1.0, times, -1.5), "pedestrian", (0.0, 0.0, 0.0)),
        seen("long", straight(60.0, 4.0, 0.0), "trailer", (39.0, 2.5, 0.05)),
    )
    recorded = drive(*objects)
    made = cut_drive(recorded, wanted(from_s=1.0))
    files = write_drive(tmp_path, "drive", recorded, made, "")
    assert [path.name for path in files] == ["scenario.yaml", "campaign.yaml", "road.xodr"]
    check_scenario(tmp_path / "scenario.yaml")
    told = load_yaml(tmp_path / "scenario.yaml")
    assert set(told["actors"]) == {"car_1", "pedestrian_1", "truck_1"}
    assert "length_m" not in told["actors"]["pedestrian_1"]
    assert told["actors"]["truck_1"]["height_m"] == 0.2
    assert told["events"]["pedestrian_1_appears"] == {
        "at_s": 2,
        "do": {"pedestrian_1": {"visible": True}},
    }
    campaign = load_yaml(tmp_path / "campaign.yaml")
    assert campaign["scenario"]["storyboard"] == str(tmp_path / "scenario.yaml")
    assert campaign["scenario"]["duration_s"] == 10
    assert campaign["autonomy"]["parameters"]["cruise_speed_mps"] == 10.0


def test_who_brakes_later_cruises_as_at_the_beginning(tmp_path):
    times_s = np.linspace(0.0, 5.0, 51)
    way_m = np.where(times_s < 3.0, 12.0 * times_s, 36.0)
    recorded = drive(ego=np.column_stack([times_s, way_m, *np.zeros((3, 51))]))
    write_drive(tmp_path, "d", recorded, cut_drive(recorded, wanted()), "motorway")
    campaign = load_yaml(tmp_path / "campaign.yaml")
    assert campaign["autonomy"]["parameters"]["cruise_speed_mps"] == 12.0


def test_own_road_is_named_and_nothing_is_moved(tmp_path):
    recorded = drive()
    files = write_drive(tmp_path, "d", recorded, cut_drive(recorded, wanted()), "motorway")
    assert [path.name for path in files] == ["scenario.yaml", "campaign.yaml"]
    assert load_yaml(tmp_path / "scenario.yaml")["road"] == "motorway"


def test_names_of_recordings_become_names_of_scenarios(tmp_path):
    assert scenario_name(tmp_path / "Rosbag2_2024-01-01 (Test).mcap") == "rosbag2-2024-01-01-test"
    assert scenario_name(tmp_path / "äöü.mcap") == "drive"
