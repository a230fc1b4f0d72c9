"""Who comes along the other lane of a curve is no threat, and who comes in one's own is."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.health import SensorHealth
from devkit.fusion.parameters import StagingParameters, TrackingParameters
from devkit.fusion.path import CarPath
from devkit.fusion.sightings import LABELS
from devkit.fusion.threats import find_threats
from devkit.fusion.tracks import TrackStore

LANE_M, SPEED_MPS = 3.5, 20.0
STAGING = StagingParameters()


def road(bends, at_m):
    """x, y and direction after ``at_m`` on a road of (length, curvature) pieces."""
    x = y = heading = 0.0
    for length, bend in bends:
        for _ in range(round(min(length, at_m) / 0.05)):
            x, y = x + 0.05 * math.cos(heading), y + 0.05 * math.sin(heading)
            heading += 0.05 * bend
        at_m -= length
        if at_m <= 0:
            break
    return x, y, heading


def comes(bends, way_m, lane_m, *, named=True, q_vv=0.1):
    """Threats of a car that comes along the road, ``lane_m`` left of the ego's lane."""
    x, y, heading = road(bends, way_m)
    tracks = TrackStore(1, TrackingParameters())
    for name, value in {
        "live": True,
        "x_m": x - lane_m * math.sin(heading),
        "y_m": y + lane_m * math.cos(heading),
        "vx_mps": -SPEED_MPS * math.cos(heading),
        "vy_mps": -SPEED_MPS * math.sin(heading),
        "p_vv": 0.1,
        "q_vv": q_vv,
        "right_m": -0.9,
        "left_m": 0.9,
        "radial_mps": -SPEED_MPS,
        "probability": 0.999,
        "age_s": 3.0,
        "turn_radps": -SPEED_MPS * next(b for s, b in bends_from(bends, way_m) if s > 0),
        "label": LABELS.index("car") if named else 0,
        "named": 2.0 if named else 0.0,
    }.items():
        getattr(tracks, name)[0, 0] = value
    seen = (tracks.camera, tracks.radar) if named else (tracks.radar,)
    ego, health = EgoMotion(1), SensorHealth(1)
    ego.speed_mps[:], ego.curvature_per_m[:] = SPEED_MPS, bends[0][1]
    place = tracks.y_m[0, 0] - 0.5 * bends[0][1] * tracks.x_m[0, 0] ** 2
    for memory in seen:
        memory.age_s[0, 0], memory.hits[0, 0] = 0.0, 20
        memory.inside[0, 0] = float(abs(place) < 2.0)
    found = find_threats(tracks, ego, health, STAGING)
    return SimpleNamespace(
        counts=bool(found.agreed[0, 0] | found.single[0, 0]),
        inside=bool(tracks.radar.inside[0, 0]),
        ttc_s=float(found.ttc_s[0, 0]),
    )


def bends_from(bends, at_m):
    """What is left of the pieces from ``at_m`` on; the last goes on."""
    for length, bend in bends:
        yield length - at_m, bend
        at_m -= length
    yield math.inf, bends[-1][1]


RADIUS_M = (-400.0, -250.0, 250.0, 400.0)
ROADS = [
    pytest.param(
        [(first, before), (500.0, after)], id=f"{first:.0f} m of {before:.4f}, {after:.4f}"
    )
    for first in (10.0, 25.0, 40.0, 60.0)
    for radius in RADIUS_M
    for before, after in ((0.0, 1 / radius), (1 / radius, 0.0), (1 / radius, 1 / radius))
]


@pytest.mark.parametrize("bends", ROADS)
def test_who_comes_along_the_other_lane_is_no_threat(bends):
    found = [comes(bends, way_m, LANE_M) for way_m in range(20, 110, 5)]
    assert not [one.ttc_s for one in found if one.counts]
    found = [comes(bends, way_m, LANE_M, named=False) for way_m in range(20, 110, 5)]
    assert not [one.ttc_s for one in found if one.counts]


def test_such_roads_bring_the_others_onto_the_foreseen_path():
    """Else the test above would not try anything."""
    tried = [
        comes(each.values[0], way_m, LANE_M).inside for each in ROADS for way_m in range(20, 110, 5)
    ]
    assert 60 < sum(tried) < len(tried)


@pytest.mark.parametrize(
    "bends", [[(500.0, 0.0)], [(500.0, 1 / 250.0)], [(500.0, -1 / 250.0)], [(500.0, 1 / 400.0)]]
)
def test_who_comes_in_the_own_lane_is_one_in_time(bends):
    assert all(comes(bends, way_m, 0.0).counts for way_m in range(20, 110, 5))
    near = [comes(bends, way_m, 0.0, named=False) for way_m in range(20, 36, 2)]
    assert all(one.counts for one in near), "radar alone, at last"
    assert max(one.ttc_s for one in near) > 0.7


def test_what_comes_far_ahead_and_no_camera_names_needs_a_known_lane():
    """Radar alone at 100 m: half a second tells nothing of where its road goes."""
    road = [(500.0, 0.0)]
    assert comes(road, 100.0, 0.0, named=False).counts
    assert not comes(road, 100.0, 0.0, named=False, q_vv=1.77**2).counts
    assert comes(road, 100.0, 0.0, q_vv=1.77**2).counts, "named"
    assert comes(road, 30.0, 0.0, named=False, q_vv=1.77**2).counts, "near"


def test_who_leaves_the_path_at_the_last_moment_counts_as_long_as_he_is_there():
    """A car that crosses from the right has left the path by its place, though echoes of its
    middle were in the path a moment ago."""
    tracks = TrackStore(1, TrackingParameters())
    for name, value in {
        "live": True,
        "x_m": 30.0,
        "y_m": 1.5,
        "vx_mps": 1.5,
        "vy_mps": 8.0,
        "p_vv": 0.1,
        "q_vv": 0.1,
        "right_m": -2.2,
        "left_m": 2.2,
        "probability": 0.999,
        "age_s": 3.0,
        "label": LABELS.index("car"),
    }.items():
        getattr(tracks, name)[0, 0] = value
    for memory in (tracks.camera, tracks.radar):
        memory.age_s[0, 0], memory.hits[0, 0], memory.inside[0, 0] = 0.0, 20, 1.0
    ego, health = EgoMotion(1), SensorHealth(1)
    ego.speed_mps[:] = SPEED_MPS
    assert not find_threats(tracks, ego, health, STAGING).agreed[0, 0], (
        "gone in 0.2 s, there in 1.3 s"
    )
    tracks.vy_mps[0, 0] = 1.4
    assert find_threats(tracks, ego, health, STAGING).agreed[0, 0]


def beside(
    label="",
    *,
    lidar_hits=20,
    radar_hits=20,
    camera_hits=20,
    age_s=3.0,
    speed_mps=8.0,
    inside=False,
    boxes_inside=None,
    sweeps_inside=None,
    ends_along=1.0,
    sweeps_on_end=None,
    followed=False,
    has_radar=True,
    radar_age_s=0.0,
    lidar_age_s=0.0,
    bend_per_m=0.0,
    reach_m=0.0,
    sight_m=1e4,
    **values,
):
    """Whether somebody beside the path of a car at ``speed_mps`` is braked for."""
    tracks = TrackStore(1, TrackingParameters())
    given = {"live": True, "p_vv": 0.1, "q_vv": 0.1, "right_m": -0.3, "left_m": 0.3}
    given |= {"probability": 0.999, "age_s": age_s, "label": LABELS.index(label)}
    given |= {"named": min(camera_hits, 2)}
    # He has come two metres across, and radar measures what he does.
    x_m, y_m, vx_mps, vy_mps = (
        values.get(name, 0.0) for name in ("x_m", "y_m", "vx_mps", "vy_mps")
    )
    if "from_x_m" not in values and "from_y_m" not in values:
        given |= {"from_x_m": x_m, "from_y_m": y_m - math.copysign(2.0, vy_mps)}
    ahead_m = x_m - STAGING.front_m
    given |= {"radial_mps": (ahead_m * vx_mps + y_m * vy_mps) / math.hypot(ahead_m, y_m)}
    for name, value in (given | values).items():
        getattr(tracks, name)[0, 0] = value
    hits_of = (
        (tracks.lidar, lidar_hits),
        (tracks.radar, radar_hits),
        (tracks.camera, camera_hits * bool(label)),
    )
    for memory, hits in hits_of:
        memory.age_s[0, 0], memory.hits[0, 0] = (0.0 if hits else 1e9), hits
        memory.inside[0, 0] = float(inside)
    tracks.ends.along[0, 0] = ends_along
    tracks.ends.sweeps[0, 0] = lidar_hits if sweeps_on_end is None else sweeps_on_end
    if followed:
        tracks.live[0, 1], tracks.age_s[0, 1], tracks.radar.hits[0, 1] = True, 14.0, 260
        tracks.x_m[0, 1], tracks.y_m[0, 1], tracks.vx_mps[0, 1] = x_m, y_m, vx_mps
        tracks.radar.age_s[0, 1] = 0.0
    tracks.radar.age_s[0, 0] += radar_age_s
    tracks.lidar.age_s[0, 0] += lidar_age_s
    if boxes_inside is not None:
        tracks.camera.inside[0, 0] = float(boxes_inside)
    if sweeps_inside is not None:
        tracks.lidar.inside[0, 0] = float(sweeps_inside)
    ego, health = EgoMotion(1), SensorHealth(1)
    ego.speed_mps[:], health.radar_sees[:] = speed_mps, has_radar
    ego.curvature_per_m[:], health.reach_m[:] = bend_per_m, reach_m
    health.sight_m[:] = sight_m
    found = find_threats(tracks, ego, health, STAGING)
    near = found.ttc_s[0, 0] < STAGING.partial_ttc_s
    return bool(near and (found.agreed[0, 0] | found.single[0, 0]))


CROSSES = {"x_m": 11.3, "y_m": -3.0, "vx_mps": 2.0, "vy_mps": 4.0, "right_m": -0.9, "left_m": 0.9}


@pytest.mark.parametrize("label", ["car", ""])
def test_a_vehicle_that_crosses_is_braked_for_once_its_speed_across_is_known(label):
    assert beside(label, **CROSSES)
    step = "a step from one corner to the next"
    assert not beside(label, age_s=0.3, lidar_hits=2, **CROSSES), step
    assert beside(label, age_s=0.3, **CROSSES) == bool(label), "named, and where its points are"
    thin = CROSSES | {"right_m": -0.1, "left_m": 0.1}
    assert not beside("car", age_s=0.3, **thin), "a vehicle is no single point of LiDAR"
    assert beside("bicycle", age_s=0.3, **CROSSES), "there is no time to be surer"
    unsure = CROSSES | {"q_vv": 2.5}
    assert beside("bicycle", age_s=0.3, **unsure)
    assert not beside("bicycle", age_s=0.3, **(CROSSES | {"q_vv": 2.6}))
    unsure |= {"right_m": -0.3, "left_m": 0.3}
    assert beside("bicycle", age_s=0.3, **unsure)
    once = "the box of somebody on the footway behind a lorry's corner"
    assert not beside("bicycle", age_s=0.3, camera_hits=1, **unsure), once


def test_a_vehicle_crosses_once_it_has_been_seen_to_come_across():
    """The front of a car that comes, then a sliver of its flank: a step of half its width."""
    sliver = {"x_m": 12.2, "y_m": 2.6, "vx_mps": -8.0, "vy_mps": -2.5, "from_x_m": 17.3}
    sliver |= {"right_m": -0.17, "left_m": 0.17, "lidar_hits": 6, "radar_hits": 3}
    assert not beside("car", from_y_m=3.86, **sliver)
    assert beside("car", from_y_m=4.3, **sliver)
    assert not beside("car", from_y_m=2.2, **sliver), "it has gone the other way"


def test_the_way_since_a_track_was_seen_last_is_a_guess():
    come = CROSSES | {"from_x_m": 11.3, "from_y_m": -4.7, "radar_hits": 0}
    assert beside("car", **come)
    assert not beside("car", lidar_age_s=0.4, **come)


def test_what_radar_measures_to_stand_does_not_cross_by_places():
    """Echoes of one parked car after the other, which no camera names."""
    row = {"x_m": 10.6, "y_m": 4.33, "vx_mps": 0.99, "vy_mps": -3.06, "from_y_m": 6.73}
    row |= {"from_x_m": 10.4, "q_vv": 0.09, "p_vv": 0.08, "lidar_hits": 1, "radar_hits": 6}
    row |= {"speed_mps": 12.7, "right_m": -0.06, "left_m": 0.06}
    assert not beside("car", radial_mps=-0.15, **row)
    assert beside("car", radial_mps=-0.9, **row)


def test_what_radar_alone_sees_go_aside_does_not_cross():
    """One end and wheel of a lorry that goes by after the other."""
    passing = {"x_m": 15.7, "y_m": 1.95, "vx_mps": -2.6, "vy_mps": -2.17, "q_vv": 0.3}
    passing |= {"radar_hits": 10}
    assert not beside(lidar_hits=2, **passing)
    assert beside(lidar_hits=6, **passing)
    assert beside("truck", lidar_hits=2, **passing)
    assert beside(lidar_hits=0, **(CROSSES | {"q_vv": 0.24})), "its speed across is beyond doubt"
    assert not beside(lidar_hits=0, **(CROSSES | {"q_vv": 0.8}))


def test_what_radar_alone_has_seen_walk_is_braked_for():
    """A pedestrian whom no network names, beyond the reach of LiDAR, as late as he must be."""
    walker = {"x_m": 32.0, "y_m": -2.4, "vx_mps": -0.2, "vy_mps": 1.45, "q_vv": 0.1}
    walker |= {"lidar_hits": 0, "radar_hits": 90, "speed_mps": 16.67, "from_x_m": 40.0}
    assert beside(**walker, from_y_m=-5.6)
    assert not beside(**walker, from_y_m=-3.3), "from one end of a parked car to the other"
    assert not beside(**(walker | {"radar_hits": 15}), from_y_m=-5.6)
    assert not beside(**(walker | {"left_m": 1.2}), from_y_m=-5.6), "too wide for a person"
    assert not beside(**(walker | {"x_m": 60.0}), from_y_m=-5.6), "there is time"


def test_a_car_that_crosses_at_right_angles_moves_along_the_ray():
    """It has no speed along the path, and radar sees that it is none that stands."""
    crosses = {
        "x_m": 13.0,
        "y_m": -4.0,
        "vx_mps": 0.0,
        "vy_mps": 5.0,
        "right_m": -2.0,
        "left_m": 2.0,
    }
    assert beside("car", **crosses)
    assert not beside("car", **crosses, radar_hits=0, lidar_hits=4, q_vv=1.2), "one of its ends"


MOTORCYCLE = {
    "x_m": 18.0, "y_m": 17.0, "vx_mps": 0.0, "vy_mps": -11.1, "right_m": -0.4, "left_m": 0.4,
    "from_x_m": 18.0, "from_y_m": 24.0, "speed_mps": 11.1, "radar_hits": 0, "age_s": 1.0,
}  # fmt: skip


def test_who_comes_from_far_beside_the_road_is_braked_for_by_lidar_alone():
    """At a right angle radar does not look, and he has no speed along the path."""
    assert beside(lidar_hits=5, **MOTORCYCLE)
    assert not beside(lidar_hits=4, **MOTORCYCLE)
    assert not beside(lidar_hits=5, **(MOTORCYCLE | {"q_vv": 5.0})), "his speed is not sure"
    assert not beside(lidar_hits=5, **(MOTORCYCLE | {"from_y_m": 18.0})), "he has not come far"
    near = {"y_m": 5.4, "from_y_m": 8.0, "vy_mps": -6.0, "x_m": 12.0}
    assert not beside(lidar_hits=5, **(MOTORCYCLE | near)), "it was never far aside: fog"
    assert beside(lidar_hits=5, **(MOTORCYCLE | near | {"from_y_m": 10.0}))
    slow = {"vy_mps": -4.5, "y_m": 7.0, "from_y_m": 12.0}
    assert not beside(lidar_hits=5, **(MOTORCYCLE | slow)), "posts of a fence"
    assert beside(lidar_hits=5, **(MOTORCYCLE | slow | {"right_m": -2.0, "left_m": 2.0}))


def test_who_comes_from_far_beside_need_not_be_old_where_radar_sees_him_move():
    car = MOTORCYCLE | {"right_m": -2.0, "left_m": 2.0, "age_s": 0.4, "radar_hits": 6}
    assert beside(lidar_hits=4, **car)
    assert not beside(lidar_hits=3, **car)
    assert not beside(lidar_hits=4, **(car | {"radar_hits": 0}))


def test_what_radar_sees_stand_beside_a_turn_does_not_cross():
    """Of a car that waits, other parts are seen while the ego turns: it seems to go at 3.1 m/s,
    across the ray on which radar measures nothing."""
    stands = {"x_m": 8.1, "y_m": -4.0, "vx_mps": 1.9, "vy_mps": 2.4, "q_vv": 0.1}
    stands |= {"right_m": -1.9, "left_m": 1.9, "speed_mps": 5.0}
    assert not beside("car", **stands)
    assert beside("car", radar_hits=0, **stands), "no radar says otherwise"
    assert beside("car", **(stands | {"vx_mps": 0.0})), "it drives along the ray"


def test_radar_that_disagrees_with_a_velocity_does_not_vouch_for_it():
    jumps = {"x_m": 7.7, "y_m": 1.8, "vx_mps": -2.9, "vy_mps": -10.2, "lidar_hits": 3}
    jumps |= {"right_m": -0.5, "left_m": 0.5, "p_vv": 0.5, "q_vv": 0.7, "speed_mps": 6.6}
    assert beside("car", **jumps)
    assert not beside("car", **jumps, agrees=0.36)


def test_who_drives_along_the_road_is_no_pedestrian_that_no_camera_names():
    """Of an oncoming car only an edge is seen in fog, and it seems to go aside."""
    edge = {"x_m": 14.9, "y_m": 2.8, "vy_mps": -1.2, "right_m": -0.1, "left_m": 0.1, "q_vv": 0.07}
    edge |= {"lidar_hits": 6, "turn_radps": 0.17, "speed_mps": 7.8}
    assert not beside(**edge, vx_mps=-8.8)
    assert beside(**edge, vx_mps=-3.9), "who runs"


def test_of_what_radar_alone_sees_standing_the_driver_is_warned():
    def warned(x_m=56.0, hits=40, bend=0.0, inside=1.0):
        tracks = TrackStore(1, TrackingParameters())
        for name, value in {
            "live": True, "x_m": x_m, "p_vv": 0.1, "q_vv": 0.1, "right_m": -0.3, "left_m": 0.3,
            "probability": 0.999, "age_s": 3.0,
        }.items():  # fmt: skip
            getattr(tracks, name)[0, 0] = value
        for memory in (tracks.camera, tracks.lidar):
            memory.age_s[0, 0] = 1e9
        tracks.radar.age_s[0, 0], tracks.radar.hits[0, 0] = 0.0, hits
        tracks.radar.inside[0, 0] = inside
        ego = EgoMotion(1)
        ego.speed_mps[:], ego.curvature_per_m[:] = 16.67, bend
        found = find_threats(tracks, ego, SensorHealth(1), STAGING)
        assert not found.agreed[0, 0] | found.single[0, 0]
        return bool(found.foreseen[0, 0])

    assert warned(), "3.1 s before it"
    assert not warned(x_m=70.0), "4.0 s"
    assert not warned(hits=20), "a second is too short"
    assert not warned(inside=0.8)
    assert not warned(bend=0.004), "beside a curve, perhaps"


def test_nobody_brakes_for_the_flank():
    """Who would be in the path when the car's rear passes is too late for a brake to help."""
    walker = {"y_m": 3.7, "vx_mps": 0.0, "vy_mps": -1.7, "right_m": -0.6, "left_m": 0.6}
    assert not beside("pedestrian", x_m=7.2, **walker), "0.4 s before it: he comes 0.8 s later"
    assert beside("pedestrian", x_m=12.0, **walker), "1.0 s: he may be faster"


def test_who_turns_off_ahead_is_left_alone_as_soon_as_the_brake_could_begin():
    """At 3.1 s he is half out of the path and will be gone in half a second."""
    ahead = {"x_m": 17.3, "y_m": -1.3, "right_m": -1.1, "left_m": 1.1, "vx_mps": 4.0}
    assert not inside(**ahead, vy_mps=-1.3, turn_radps=-0.17)
    assert not inside(**ahead, vy_mps=-0.2, turn_radps=0.0), "he may turn off yet"
    near = ahead | {"x_m": 10.5}
    assert inside(**near, vy_mps=-0.2, turn_radps=0.0), "he stays"
    assert inside(**ahead, vy_mps=-0.2, turn_radps=0.0, accel_mps2=-3.0), "he brakes"


def test_who_turns_off_shows_his_flank_bit_by_bit():
    """His middle goes aside faster than his way explains, and radar has followed him all along."""
    turns = {"x_m": 10.0, "y_m": -1.8, "right_m": -1.4, "left_m": 1.4, "vx_mps": 3.8}
    turns |= {"vy_mps": -1.8, "turn_radps": -0.22, "steady": 0.13}
    assert not inside(**turns)
    assert inside(**turns, radar_hits=5), "or LiDAR goes from one thing to the next"


def inside(**values):
    """Whether a slower car in the path of one at 8.3 m/s is braked for."""
    return beside("car", speed_mps=8.33, inside=True, **values)


def test_two_boxes_are_no_measurement_where_radar_has_made_some():
    """A car comes along the next lane, and two boxes half a second apart reach into the path."""
    comes = {"x_m": 27.0, "y_m": 2.3, "vx_mps": -4.0, "lidar_hits": 0, "boxes_inside": True}
    assert not beside("car", camera_hits=2, radar_hits=19, **comes)
    assert beside("car", camera_hits=3, radar_hits=4, **comes)
    assert not beside("car", camera_hits=3, radar_hits=4, **(comes | {"y_m": 2.6})), "far beside"
    assert beside("car", camera_hits=2, **(comes | {"radar_hits": 2, "lidar_hits": 3})) is False


def test_two_boxes_beside_the_path_are_a_measurement():
    """A box of two cars that come one behind the other draws their track towards the own lane."""
    comes = {"x_m": 26.0, "y_m": 1.77, "vx_mps": -13.35, "right_m": -2.24, "left_m": 2.24}
    comes |= {"lidar_hits": 0, "inside": True, "boxes_inside": False, "speed_mps": 9.9}
    assert beside("car", camera_hits=1, **comes)
    assert not beside("car", camera_hits=2, **comes)


def test_radar_alone_has_to_be_surer_of_what_comes():
    """Of a car in the other lane of a curve radar sees now this part, now that."""
    comes = {"x_m": 26.0, "y_m": 1.9, "vx_mps": -9.5, "right_m": -1.9, "left_m": 1.9}
    comes |= {"lidar_hits": 0, "radar_hits": 35, "speed_mps": 10.0}
    assert beside(**comes, inside=0.85)
    assert not beside(**comes, inside=0.7)
    assert beside(**(comes | {"vx_mps": 0.0}), camera_hits=0, inside=0.7) is False, "it stands"
    assert beside("car", **comes, camera_hits=3, inside=0.7), "the camera says so, too"
    assert beside(**(comes | {"lidar_hits": 3}), inside=0.7), "so does LiDAR"


def test_who_is_called_a_person_and_is_as_fast_as_a_car_comes_along_the_other_lane():
    comes = {"x_m": 16.2, "y_m": 1.88, "vx_mps": -25.28, "vy_mps": 3.29, "q_vv": 1.7, "p_vv": 0.6}
    comes |= {"right_m": -0.48, "left_m": 0.48, "lidar_hits": 0, "inside": True, "speed_mps": 19.3}
    comes |= {"from_x_m": 18.1, "from_y_m": 0.44, "age_s": 0.4}
    assert not beside("pedestrian", camera_hits=4, radar_hits=1, **comes)
    assert beside("pedestrian", camera_hits=4, radar_hits=1, **(comes | {"vx_mps": -5.0}))


def test_a_person_whom_the_camera_alone_shows_is_none_where_lidar_would_see_him():
    """Where a curve begins, who walks beside it is straight ahead, and nobody measures how far."""
    walker = {"x_m": 26.0, "y_m": 0.2, "vx_mps": 0.0, "vy_mps": 0.0, "lidar_hits": 0}
    walker |= {"inside": True, "speed_mps": 11.6}
    assert beside("pedestrian", radar_hits=1, **walker), "LiDAR does not see so far"
    assert not beside("pedestrian", radar_hits=1, reach_m=47.0, **walker)
    late = walker | {"x_m": 17.0, "speed_mps": 10.5}
    assert beside("pedestrian", radar_hits=1, **late)
    assert not beside("pedestrian", radar_hits=1, reach_m=47.0, **late), "an echo of the rain"
    assert not beside("pedestrian", radar_hits=19, reach_m=47.0, **walker), "of a corner behind him"
    assert beside("pedestrian", radar_hits=20, reach_m=47.0, **walker), "radar sees him"


def test_what_stands_far_ahead_in_a_curve_is_left_for_later():
    parked = {"x_m": 38.0, "y_m": 0.005 * 0.5 * 38.0**2, "vx_mps": 0.0, "vy_mps": 0.0}
    parked |= {"inside": True, "bend_per_m": 0.005, "speed_mps": 12.0}
    assert not beside("car", **parked)
    assert beside("car", **(parked | {"x_m": 33.0, "y_m": 0.005 * 0.5 * 33.0**2})), "near"
    assert beside("car", **(parked | {"speed_mps": 19.0})), "late"
    assert beside("car", **(parked | {"bend_per_m": 0.0, "y_m": 0.0})), "a straight road"


def test_what_lidar_sees_run_at_the_end_of_its_sight_is_fog():
    runs = {"x_m": 20.9, "y_m": -11.2, "vx_mps": 0.5, "vy_mps": 6.05, "q_vv": 0.2, "lidar_hits": 8}
    runs |= {"radar_hits": 0, "from_x_m": 20.5, "from_y_m": -15.9, "speed_mps": 12.3}
    assert beside(**runs)
    assert not beside(sight_m=120.0, **runs), "heavy fog"


def test_who_seems_to_cross_within_a_moment_goes_by():
    """A car in the next lane, whose front and flank LiDAR sees one after the other."""
    passing = {"x_m": 7.1, "y_m": 2.51, "vx_mps": -10.1, "vy_mps": -2.57, "from_x_m": 12.9}
    passing |= {"from_y_m": 4.6, "right_m": -0.62, "left_m": 0.62, "speed_mps": 11.6}
    assert not beside(lidar_hits=8, radar_hits=3, **passing)
    assert beside(lidar_hits=8, radar_hits=3, **(passing | {"x_m": 14.0, "from_x_m": 20.0}))


def test_boxes_and_many_echoes_have_the_same_say_in_who_is_in_the_path():
    """One box is of two parked cars and reaches into the path, where no echo has been."""
    parked = {"x_m": 21.0, "y_m": -2.1, "lidar_hits": 0, "boxes_inside": True}
    assert beside("car", radar_hits=4, **parked), "boxes tell directions better than a few echoes"
    assert not beside("car", radar_hits=5, **parked)
    assert beside("pedestrian", radar_hits=19, **parked), "nobody parks people in rows"
    assert not beside("car", radar_hits=20, **(parked | {"lidar_hits": 1})), "nor one sweep"
    assert beside("car", radar_hits=20, radar_age_s=0.8, **parked), "echoes of long ago"
    assert beside("car", radar_hits=20, **(parked | {"inside": True}))
    assert not beside("car", radar_hits=4, **(parked | {"lidar_hits": 3})), "LiDAR knows best"
    ahead = parked | {"y_m": 0.0, "inside": True, "boxes_inside": False}
    assert not beside("car", radar_hits=20, **ahead), "boxes beside the path count as much"


def test_a_box_at_speed_counts_only_with_echoes_or_points():
    """A lorry labelled as a car half as far away, and echoes of the guard rail there."""
    box = {"x_m": 33.0, "inside": True, "speed_mps": 31.0, "lidar_hits": 0}
    for label in ("car", "truck", "bus"):
        for echoes in (0, 1, 4):
            assert not beside(label, radar_hits=echoes, **box)
        assert beside(label, radar_hits=5, **box), "radar sees it as often as it sees vehicles"
        assert beside(label, radar_hits=1, **(box | {"lidar_hits": 3})), "LiDAR sees it"
    near = box | {"x_m": 18.0}
    assert beside("car", radar_hits=1, **(near | {"speed_mps": 10.0})), "slow enough"
    assert not beside("car", radar_hits=1, **(near | {"speed_mps": 10.1}))
    assert beside("car", radar_hits=0, has_radar=False, **box), "there is no radar, or it is silent"
    assert beside("pedestrian", radar_hits=1, **box), "echoes of people come and go"


def test_a_radar_that_is_silent_sees_nothing():
    health, day = SensorHealth(2), np.array([[1e4, 0.0], [1e4, 0.0]])
    has, none = np.array([True, False]), np.zeros(2, bool)
    health.echoed(0)
    health.update(day, np.full(2, 0.05), none, has, none)
    assert health.radar_sees.tolist() == [True, False], "the second car has none"
    for _ in range(20):
        health.update(day, np.full(2, 0.05), none, has, none)
    assert health.radar_sees.tolist() == [False, False]


def test_a_narrow_thing_that_lidar_alone_sees_cross_is_no_vehicle():
    """From one post of a fence to the next, in fog: 5 m/s aslant, and radar saw nothing move."""
    post = {"x_m": 8.7, "y_m": -4.7, "vx_mps": 2.6, "vy_mps": 3.9, "lidar_hits": 8, "q_vv": 0.07}
    post |= {"right_m": -0.16, "left_m": 0.16}
    assert not beside(radar_hits=0, **post)
    assert beside(radar_hits=3, **post), "radar sees it too"
    assert not beside("car", radar_hits=5, **(post | {"lidar_hits": 4})), "a wheel that goes by"
    assert beside(radar_hits=0, **(post | {"right_m": -0.9, "left_m": 0.9})), "wide enough"
    assert not beside("car", radar_hits=0, **post), "named by the box of a car behind it"
    unseen = post | {"lidar_hits": 2, "lidar_age_s": 1.0}
    assert beside("car", radar_hits=0, **unseen), "no LiDAR says otherwise"


@pytest.mark.parametrize("radius_m", [90.0, -90.0])
@pytest.mark.parametrize("aside_m", [-3.2, 3.2])
def test_how_far_who_walks_in_a_curve_has_come_counts_from_the_foreseen_path(radius_m, aside_m):
    """Radar alone has seen him 20 degrees round the curve, where along the road is aside in the
    car's axes. His velocity points into the path in all cases: it may be noise."""
    bend = 1.0 / radius_m

    def place(way_m, beside_m):
        angle, left_m = way_m * bend, radius_m - beside_m
        return left_m * math.sin(angle), radius_m - left_m * math.cos(angle)

    def braked_for(before, now):
        heading = 32.0 * bend - math.copysign(math.pi / 2.0, aside_m)
        (from_x_m, from_y_m), (x_m, y_m) = place(*before), place(*now)
        walker = {"right_m": -0.3, "left_m": 0.3, "q_vv": 0.05, "p_vv": 0.05, "x_m": x_m}
        walker |= {"vx_mps": 1.4 * math.cos(heading), "vy_mps": 1.4 * math.sin(heading)}
        return beside(
            lidar_hits=0, radar_hits=90, speed_mps=16.67, bend_per_m=bend,
            from_x_m=from_x_m, from_y_m=from_y_m, y_m=y_m, **walker,
        )  # fmt: skip

    assert braked_for((32.0, 1.8 * aside_m), (32.0, 0.75 * aside_m)), "he has walked across"
    for along_m in (-9.0, 9.0):
        along = (32.0 + along_m, 0.75 * aside_m), (32.0, 0.75 * aside_m)
        assert not braked_for(*along), "along the road, and no step nearer"


def test_how_far_aside_something_was_counts_from_the_curve():
    """Narrow, and LiDAR alone has seen it come: in fog it goes from one post to the next."""
    bend = 1.0 / 60.0
    comes = {"x_m": 18.0, "y_m": 9.0, "vx_mps": 0.0, "vy_mps": -6.0, "lidar_hits": 8, "q_vv": 0.1}
    comes |= {"right_m": -0.3, "left_m": 0.3, "radar_hits": 0, "speed_mps": 11.1, "age_s": 1.4}
    for place, beside_m in (((36.0, 19.5), 5.8), ((36.0, 23.5), 8.7), ((36.0, 25.0), 9.8)):
        assert CarPath(bend).beside_circle_m(*place) == pytest.approx(beside_m, abs=0.1)
        came = beside(bend_per_m=bend, from_x_m=place[0], from_y_m=place[1], **comes)
        assert came == (beside_m > 9.0)


PARKED = {"x_m": 18.0, "y_m": -2.4, "vy_mps": 1.5, "q_vv": 0.2, "speed_mps": 12.0}
"""The gap between two parked cars, which LiDAR and a network take for somebody who walks."""


def test_a_person_is_named_by_two_boxes_and_placed_by_four_sweeps():
    walker = PARKED | {"from_y_m": -3.0, "lidar_hits": 4, "radar_hits": 5, "age_s": 0.5}
    assert beside("pedestrian", camera_hits=2, **walker)
    assert not beside("pedestrian", camera_hits=1, **walker)
    assert not beside("pedestrian", camera_hits=2, **(walker | {"lidar_hits": 3}))
    assert not beside("pedestrian", camera_hits=2, **walker, sweeps_on_end=3), (
        "it was another thing before"
    )
    assert beside("pedestrian", camera_hits=2, **(walker | {"lidar_hits": 0})), "LiDAR is blind"
    assert not beside("pedestrian", camera_hits=2, **walker, radial_mps=-11.4), "a car that comes"


def test_who_walks_unnamed_has_to_be_surer():
    walker = PARKED | {"from_y_m": -3.0, "lidar_hits": 7, "radar_hits": 5}
    assert beside(**walker)
    assert not beside(**(walker | {"q_vv": 0.26}))
    assert not beside(**walker, sweeps_on_end=5), "it was another thing before"
    assert not beside(**walker, ends_along=0.59), "one of its ends stays: more of it is seen"
    posts = walker | {"radar_hits": 20, "lidar_hits": 10, "from_y_m": -4.5, "ends_along": 0.2}
    assert not beside(**posts), "of a guard rail across the road"
    assert beside(**(posts | {"lidar_hits": 0})), "LiDAR does not see him"


def test_lidar_that_sees_now_this_now_that_tells_no_speed():
    """Walls and parked cars in fog, where a curve begins: they seemed to run."""
    runs = CROSSES | {"lidar_hits": 7, "radar_hits": 0}
    assert beside(**runs)
    assert not beside(**runs, sweeps_on_end=3)
    echoes = runs | {"radar_hits": 7, "vx_mps": 0.0}
    assert beside(**echoes, sweeps_on_end=3), "it moves by Doppler"
    assert not beside(**echoes, sweeps_on_end=3, radial_mps=0.0), "it does not"


def test_a_second_view_of_what_comes_tells_its_way_once_both_ends_have_gone_it():
    """A motorcycle while the car turns to the left, and the nose and flank of a lorry."""
    comes = {"x_m": 14.1, "y_m": 2.4, "vx_mps": -7.9, "vy_mps": -4.0, "speed_mps": 2.7}
    comes |= {"radar_hits": 2, "right_m": -0.6, "left_m": 0.6}
    comes |= {"from_x_m": 22.0, "from_y_m": 5.4}
    assert beside(lidar_hits=6, followed=True, **comes)
    assert not beside(lidar_hits=5, followed=True, **comes)
    assert beside(lidar_hits=5, **comes), "it is the only view"
    assert not beside(lidar_hits=6, followed=True, ends_along=0.59, **comes), "its nose stays"


def test_what_comes_out_of_a_bend_follows_the_road():
    """By radar alone, 39 m before a car on a straight that will bend to the right."""
    comes = {"x_m": 43.2, "y_m": 1.4, "vx_mps": -11.0, "vy_mps": 0.14, "speed_mps": 11.8}
    comes |= {"right_m": -0.8, "left_m": 0.8, "q_vv": 0.12, "q_xx": 0.1, "inside": True}
    comes |= {"lidar_hits": 0, "radar_hits": 47, "from_x_m": 82.6}
    assert not beside(**comes, from_y_m=-4.2)
    assert beside(**comes, from_y_m=1.2), "along the car's own lane"
    assert beside(**(comes | {"from_x_m": 55.0}), from_y_m=-0.2), "too short a way to tell"


def test_sweeps_that_all_lie_beside_the_path_say_more_than_radar():
    parked = {"x_m": 19.0, "y_m": -1.8, "speed_mps": 12.0, "radar_hits": 22, "inside": True}
    assert beside(lidar_hits=1, **parked)
    assert not beside(lidar_hits=1, sweeps_inside=False, **parked)


def test_a_way_that_its_places_contradict_tells_no_speed_across():
    assert beside("car", **CROSSES)
    assert not beside("car", **CROSSES, steady=0.62)


def test_a_car_that_comes_fast_from_far_aside_crosses_though_more_and_more_of_it_is_seen():
    """At 60 km/h: each sweep shows it further on than its first speeds say."""
    comes = {"x_m": 17.4, "y_m": 22.6, "vx_mps": -0.1, "vy_mps": -10.7, "from_x_m": 17.4}
    comes |= {"right_m": -1.5, "left_m": 1.5, "lidar_hits": 5, "speed_mps": 11.1, "age_s": 0.4}
    comes |= {"from_y_m": 26.7, "q_vv": 0.9, "radar_hits": 0, "steady": 0.36, "sweeps_on_end": 1}
    assert beside(**comes)
    assert not beside(**(comes | {"from_y_m": 25.0})), "it has come less far"
    assert not beside(**comes, sight_m=100.0), "in fog LiDAR goes from one thing to the next"
    near = comes | {"y_m": 5.0, "vy_mps": -6.0, "steady": 1.0}
    assert not beside(**(near | {"from_y_m": 8.5}))


def test_what_comes_along_the_other_lane_does_not_cross_by_radar_alone():
    """Radar sees the middle of a car far ahead and its near corner near by."""
    comes = {"x_m": 29.0, "y_m": 3.4, "vx_mps": -15.0, "vy_mps": -3.8, "from_y_m": 8.3}
    comes |= {"from_x_m": 71.0, "right_m": -0.7, "left_m": 0.7, "speed_mps": 13.0, "q_vv": 0.14}
    assert not beside(lidar_hits=0, radar_hits=22, **comes)
    assert beside(lidar_hits=6, radar_hits=22, **comes)
    assert beside(lidar_hits=0, radar_hits=22, **(comes | {"vy_mps": -4.8})), "it turns off"


def test_an_echo_of_another_speed_says_that_a_track_goes_from_one_thing_to_the_next():
    jumps = {"x_m": 13.5, "y_m": 3.0, "vx_mps": 3.0, "vy_mps": -3.0, "lidar_hits": 6}
    jumps |= {"right_m": -0.6, "left_m": 0.6, "speed_mps": 12.0, "from_y_m": 5.8, "radar_hits": 2}
    assert beside("car", **jumps, radial_mps=2.0)
    assert not beside("car", **jumps, radial_mps=-2.5)


def test_what_comes_near_by_radar_alone_is_a_mirror_image_where_lidar_would_see_it():
    image = {"x_m": 28.0, "vx_mps": -10.4, "inside": True, "lidar_hits": 0, "speed_mps": 10.0}
    assert beside(**image)
    assert not beside(**image, reach_m=60.0)
    assert beside("car", **(image | {"lidar_hits": 3}), reach_m=60.0)


def test_a_single_box_does_not_agree_that_something_stands():
    stands = {"x_m": 33.0, "inside": True, "lidar_hits": 0, "radar_hits": 5, "speed_mps": 20.0}
    assert beside("car", camera_hits=2, **stands)
    assert not beside("car", camera_hits=1, **stands)


def test_a_person_whom_radar_has_never_seen_is_none_at_speed():
    box = {"x_m": 17.0, "inside": True, "lidar_hits": 0, "camera_hits": 5}
    assert not beside("pedestrian", **box, radar_hits=0, speed_mps=20.0)
    assert beside("pedestrian", **box, radar_hits=1, speed_mps=20.0)
    assert beside("pedestrian", **box, radar_hits=0, speed_mps=9.0)
    assert beside("pedestrian", **box, radar_hits=0, speed_mps=20.0, has_radar=False)


def test_a_fast_car_has_to_see_a_vehicle_come_further_across():
    comes = CROSSES | {"x_m": 24.0, "from_x_m": 24.0, "vx_mps": 0.0, "y_m": -3.5, "vy_mps": 6.0}
    assert beside("car", **comes, from_y_m=-5.7, speed_mps=20.0)
    assert not beside("car", **comes, from_y_m=-5.7, speed_mps=30.0)
    assert beside("car", **comes, from_y_m=-6.3, speed_mps=30.0)


def test_radar_alone_has_to_be_sure_that_a_walker_is_in_the_path():
    walks = {"x_m": 20.0, "y_m": -1.5, "vx_mps": 1.1, "speed_mps": 13.0, "lidar_hits": 0}
    assert beside(**walks, inside=0.9)
    assert not beside(**walks, inside=0.7), "he goes along the footway"
    assert beside(**(walks | {"vx_mps": 4.5}), inside=0.7), "nobody walks so fast"


def test_one_echo_does_not_make_a_car_ahead_an_oncoming_one():
    ahead = {"x_m": 25.0, "vx_mps": -9.6, "inside": True, "speed_mps": 10.7, "camera_hits": 4}
    assert not beside("car", **ahead, lidar_hits=2, radar_hits=1)
    assert beside("car", **ahead, lidar_hits=2, radar_hits=3)


def test_one_box_does_not_tell_where_a_road_goes_on_behind_a_curve():
    """Somebody on a bicycle in the other lane, 50 m ahead."""
    comes = {"x_m": 54.0, "y_m": 6.0, "vx_mps": -5.2, "vy_mps": -1.0, "inside": True}
    comes |= {"speed_mps": 14.5, "lidar_hits": 0, "bend_per_m": 0.0036, "q_vv": 0.25}
    assert not beside("car", **comes, camera_hits=1)
    assert beside("car", **comes, camera_hits=3)
