"""Scripts of movable objects against closed forms; the same whatever else is asked for."""

import math
from dataclasses import fields

import numpy as np
import pytest

from schemas.sections.objects import ObjectVariation
from twin.actors.motion import Placement
from twin.actors.objects import build_cast
from twin.actors.path import build_path, law_of_times
from twin.actors.variations import Variations
from twin.world.content import SceneObject
from twin.world.scene import load_scene
from twin.world.street.build import build_world

_OPTIONAL = ("half_m", "class_index", "lights", "signals", "pitch_rad", "roll_rad")
FIELDS = [key.name for key in fields(Placement) if key.name not in _OPTIONAL]
"""What a script says; sizes and classes of its objects are those of the scene."""


def cast(**given):
    return build_cast([SceneObject(**given)])


def at(script, times):
    return script.motion.at(np.atleast_1d(np.asarray(times, float)))


def test_even_speed_on_a_straight_way():
    one = cast(kind="car", waypoints=[[10, 2], [110, 2]], speed_mps=8.0, start_s=3.0)
    found = at(one, [0.0, 3.0, 5.5, 15.5, 99.0])
    np.testing.assert_allclose(found.position_m[:, 0, 0], [10, 10, 30, 110, 110], atol=1e-6)
    np.testing.assert_allclose(found.position_m[:, 0, 1], 2.0)
    np.testing.assert_allclose(found.velocity_mps[:, 0, 0], [0, 8, 8, 0, 0])
    assert (found.kind == 0).all()


def test_speed_changes_evenly_and_brakes_light_up():
    """From 10 m/s to 0 over 50 m takes 10 s, v = 10 - t, s = 10 t - t^2 / 2."""
    way = [[0, 0], [50, 0], [80, 0]]
    one = cast(kind="truck", waypoints=way, speeds_mps=[10, 0, 6], waits_s=[0, 2, 0])
    t = np.array([0.5, 3.0, 9.0, 11.0, 13.0])
    found = at(one, t)
    np.testing.assert_allclose(found.position_m[:3, 0, 0], 10 * t[:3] - t[:3] ** 2 / 2)
    np.testing.assert_allclose(found.velocity_mps[:3, 0, 0], 10 - t[:3])
    np.testing.assert_allclose(found.position_m[3, 0], [50, 0, 0])
    # Then 30 m at up to 6 m/s in 10 s: 0.6 m/s^2 from t = 12 s on.
    np.testing.assert_allclose(found.position_m[4, 0, 0], 50.3)
    assert found.brake[:, 0].tolist() == [1, 1, 1, 1, 0]
    assert found.lamps[0, 0] == 1.0


def test_turns_are_arcs_and_heading_follows_velocity():
    one = cast(kind="car", waypoints=[[0, 0], [40, 0], [40, 40]], speed_mps=5.0, corner_m=8.0)
    length = 32 + 8 * math.pi / 2 + 32
    t = np.linspace(0.0, length / 5.0 - 1e-6, 400)
    found = at(one, t)
    p, v = found.position_m[:, 0], found.velocity_mps[:, 0]
    np.testing.assert_allclose(p[-1, :2], [40, 40], atol=1e-4)
    turning = np.abs(found.yaw_rate_radps[:, 0]) > 0
    np.testing.assert_allclose(np.hypot(p[turning, 0] - 32, p[turning, 1] - 8), 8.0, atol=1e-6)
    np.testing.assert_allclose(found.yaw_rate_radps[turning, 0], 5.0 / 8.0)
    np.testing.assert_allclose(np.arctan2(v[:, 1], v[:, 0]), found.yaw_rad[:, 0], atol=1e-6)
    moved = np.diff(p, axis=0) / np.diff(t)[:, None]
    middle = (v[1:] + v[:-1]) / 2
    assert np.abs(moved - middle).max() < 0.06


def test_times_are_met_and_it_never_goes_back():
    times = [0.0, 4.0, 5.0, 12.0]
    one = cast(kind="cyclist", waypoints=[[0, 0], [10, 0], [18, 0], [20, 0]], times_s=times)
    np.testing.assert_allclose(at(one, times).position_m[:, 0, 0], [0, 10, 18, 20], atol=1e-6)
    x = at(one, np.linspace(0, 12, 500)).position_m[:, 0, 0]
    assert (np.diff(x) >= 0).all()
    law = law_of_times(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]), loop=True)
    np.testing.assert_allclose(law.speed_mps, 1.0)


def test_a_loop_closes_and_a_repeat_begins_anew():
    square = [[0, 0], [20, 0], [20, 20], [0, 20]]
    path = build_path(np.array([[*p, 0.0] for p in square], float), 4.0, loop=True)
    assert path.length_m == pytest.approx(4 * 12 + 2 * math.pi * 4)
    one = cast(kind="bus", waypoints=square, speed_mps=6.0, corner_m=4.0, loop=True)
    lap = path.length_m / 6.0
    first, later = at(one, 5.0), at(one, 5.0 + 7 * lap)
    np.testing.assert_allclose(later.position_m, first.position_m, atol=1e-6)
    dense = at(one, np.linspace(0, 3 * lap, 4000)).position_m[:, 0]
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() < 6.0 * 3 * lap / 3999 * 1.01
    again = cast(
        kind="car", waypoints=[[0, 0], [30, 0]], speed_mps=10.0, repeat_s=8.0, present="moving"
    )
    found = at(again, [-1.0, 1.0, 5.0, 9.0])
    assert found.kind[:, 0].tolist() == [-1, 0, -1, 0]
    np.testing.assert_allclose(found.position_m[[1, 3], 0, 0], 10.0)


def test_people_walk_in_phases_and_stand_still():
    one = cast(kind="pedestrian", waypoints=[[0, 0, 0.14], [3, 0, 0.0]], speed_mps=1.5, start_s=2.0)
    found = at(one, np.linspace(0.0, 1.9, 20))
    assert set(found.kind[:, 0]) == {0}
    walking = at(one, np.linspace(2.0, 3.99, 200)).kind[:, 0]
    assert set(walking) == set(range(1, len(one.kinds)))
    assert at(one, 9.0).kind[0, 0] == 0
    np.testing.assert_allclose(at(one, 3.0).position_m[0, 0], [1.5, 0, 0.07], atol=1e-6)
    assert not found.brake.any()
    assert not found.lamps.any()
    for kind in one.kinds:
        assert 300 <= len(kind.mesh.faces) <= 800
        assert kind.mesh.points_m[:, 2].min() > -0.06
        assert 1.5 < kind.mesh.points_m[:, 2].max() < 1.95
        assert np.abs(kind.mesh.points_m[:, :2]).max() < 0.9


@pytest.mark.parametrize("scene", ["downtown", "crossing"])
def test_values_depend_on_the_time_alone(scene):
    world = build_world(load_scene(scene))
    times = np.random.default_rng(3).uniform(0.0, 80.0, 37)
    together = world.motion.at(times)
    order = np.random.default_rng(4).permutation(37)
    mixed = world.motion.at(times[order])
    for name in FIELDS:
        whole = getattr(together, name)
        assert whole[order].tobytes() == getattr(mixed, name).tobytes(), name
        for slot in (0, 17, 36):
            alone = getattr(world.motion.at(times[slot : slot + 1]), name)
            assert alone[0].tobytes() == whole[slot].tobytes(), name


def test_shipped_downtown_keeps_the_lane_free():
    scene = load_scene("downtown")
    world = build_world(scene)
    found = world.motion.at(np.arange(0.0, 400.0, 0.05))
    half_length = np.array([k.half_length_m for k in world.kinds])[found.kind]
    half_width = np.array([k.half_width_m for k in world.kinds])[found.kind]
    reach = half_length * np.abs(np.sin(found.yaw_rad)) + half_width * np.abs(np.cos(found.yaw_rad))
    x, y = found.position_m[..., 0], found.position_m[..., 1]
    before = (x - half_length < scene.obstacle.x_m + 6.0) & (found.kind >= 0)
    lane = scene.road.lane_width_m / 2
    assert before.sum() > 1000
    assert ((y - reach > lane) | (y + reach < -lane))[before].all()


def test_the_crossing_is_crossed_before_the_ego():
    world = build_world(load_scene("crossing"))
    y = world.motion.at(np.array([4.5, 6.0, 7.5])).position_m[:, 0, 1]
    assert y[0] < -1.75 < y[1] < 1.75 < y[2]


LEG = [[0, 0], [5, 0]]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"waypoints": LEG}, "give one of speed_mps, speeds_mps, times_s; given: none"),
        ({"waypoints": LEG, "speeds_mps": [1]}, "1 values for 2 waypoints, needed 2"),
        ({"waypoints": LEG, "times_s": [0, 0]}, "begin with 0 and grow"),
        ({"waypoints": LEG, "speeds_mps": [0, 0]}, "never arrive"),
        ({"waypoints": LEG[:1], "speed_mps": 1}, "one waypoint"),
        ({"waypoints": LEG, "speeds_mps": [1, 1], "waits_s": [1, 0]}, "only wait"),
        ({"waypoints": LEG, "speed_mps": 1, "loop": True, "repeat_s": 9}, "one of them"),
        ({"waypoints": [*LEG, [5, 0]], "speed_mps": 1}, "waypoints 2 and 3 are at the same"),
        ({"waypoints": [*LEG, [1, 0]], "speed_mps": 1}, "turns back on the spot"),
        ({"waypoints": [[0, 0], [50, 0]], "speed_mps": 1, "repeat_s": 9}, "shorter than the way"),
    ],
)
def test_mistakes_in_scripts(given, expected):
    with pytest.raises(ValueError) as error:
        cast(kind="car", **given)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def varied(script, slots, **objects):
    """Variations of the last slot; the others are as the scene says."""
    variations = Variations(script.motion.actors, slots)
    variations.begin(slots - 1, {n: ObjectVariation(**given) for n, given in objects.items()})
    return variations


def two(**more):
    """A car along x and a walker across it."""
    return build_cast(
        [
            SceneObject(
                kind="car", name="car", waypoints=[[0, 2], [90, 2]], speed_mps=8, start_s=1, **more
            ),
            SceneObject(kind="pedestrian", name="walker", waypoints=[[5, 0], [5, 9]], speed_mps=1),
            SceneObject(kind="bus", waypoints=[[50, 9]], yaw_deg=90),
        ]
    )


def test_objects_of_one_slot_go_by_another_speed_start_and_place():
    cast_of_two = two()
    changed = varied(
        *(cast_of_two, 2),
        car={"speed_mps": 12.0, "start_s": -1.0, "offset_m": 0.5},
        walker={"offset_m": -2.0},
    )
    found = cast_of_two.motion.at(np.array([3.0, 3.0]), changed)
    np.testing.assert_allclose(found.position_m[0, :, :2], [[16, 2], [5, 3], [50, 9]], atol=1e-6)
    np.testing.assert_allclose(
        found.position_m[1, :, :2], [[48, 2.5], [7, 3], [50, 9]], atol=1e-6
    )  # the walker goes to +y, so right of it is +x
    np.testing.assert_allclose(found.velocity_mps[:, 0, 0], [8, 12])
    assert found.kind[1].tobytes() == cast_of_two.motion.at(np.array([3.0])).kind[0].tobytes()


def test_what_the_scene_says_anyway_changes_no_byte():
    world = build_world(load_scene("downtown"))
    times = np.arange(0.0, 60.0, 0.37)
    variations = Variations(world.motion.actors, len(times))
    usual = {"start_s": -50.0, "speed_mps": 1.3, "offset_m": 0.0}
    for slot in range(len(times)):
        variations.begin(slot, {"stroller": ObjectVariation(**usual)})
    plain, same = world.motion.at(times), world.motion.at(times, variations)
    for name in FIELDS:
        assert getattr(plain, name).tobytes() == getattr(same, name).tobytes(), name


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        ({"car": {"speed_mps": 3.0}}, "speed_mps 3: the way takes 30.0 s, longer than the scene's"),
        (
            {"cra": {"start_s": 1.0}},
            "no object of this name; did you mean 'car'? allowed: car, walker",
        ),
        ({"walker": {"start_s": 1.0}}, "the scene has several of this name"),
        ({"": {"start_s": 1.0}}, "the scene has no object of this name"),
    ],
)
def test_objects_that_cannot_be_varied_so_are_one_line(objects, expected):
    pair = two(repeat_s=20.0)
    pair.motion.actors += (pair.motion.actors[1],)
    with pytest.raises(ValueError) as error:
        varied(pair, 1, **objects)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "variation", "expected"),
    [
        ({"waypoints": [[0, 0]]}, {"start_s": 1.0}, "objects.one: start_s: it has one waypoint"),
        ({"waypoints": [[0, 0]]}, {"speed_mps": 1.0}, "objects.one: speed_mps: in the scene it"),
        (
            {"waypoints": LEG, "speeds_mps": [1, 2]},
            {"speed_mps": 1.0},
            "objects.one: speed_mps: in the scene it has no speed_mps of its own",
        ),
    ],
)
def test_a_variation_needs_what_it_varies(given, variation, expected):
    one = cast(kind="car", name="one", **given)
    with pytest.raises(ValueError) as error:
        varied(one, 1, one=variation)
    assert expected in str(error.value)


def test_times_between_uneven_knots_are_smoothed_by_the_harmonic_mean():
    """Fritsch and Carlson 1980: 3 s at 10 / 3 m/s after 1 s at 10 m/s."""
    law = law_of_times(np.array([0.0, 10.0, 20.0]), np.array([0.0, 1.0, 4.0]), loop=False)
    before, after, slow, fast = 1.0, 3.0, 10.0 / 3.0, 10.0
    near, far = 2 * after + before, after + 2 * before
    np.testing.assert_allclose(law.speed_mps[1], (near + far) / (near / fast + far / slow))
    assert law.speed_mps[[0, 2]].tolist() == [0.0, 0.0]


def test_turns_of_a_short_leg_leave_each_other_room():
    """Both want 20 m of a leg of 6 m."""
    waypoints = np.array([[0.0, 0, 0], [40, 0, 0], [40, 6, 0], [80, 6, 0]])
    path = build_path(waypoints, 20.0, loop=False)
    assert (np.diff(path.station_m) > 0.0).all()
    assert path.length_m > path.station_m[-1]
    assert path.length_m < 40 + 6 + 40
    # Pieces join: each one's end is the next one's beginning.
    for k, length in enumerate(np.diff(path.station_m)):
        x, y, heading = path.start[k]
        half = 0.5 * path.curvature[k] * length
        chord = length * np.sinc(half / np.pi)
        end = x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)
        np.testing.assert_allclose(end, path.start[k + 1, :2], atol=1e-9)


@pytest.mark.parametrize("side_m", [7.0, 7.2, 7.4, 7.6])
def test_a_walker_on_a_loop_does_not_change_step_where_the_loop_ends(side_m):
    waypoints = [[0, 0], [side_m, 0], [side_m, 5], [0, 5]]
    one = cast(kind="pedestrian", waypoints=waypoints, speed_mps=1.3, loop=True)
    found = at(one, np.arange(0.1, 60.0, 0.02)).kind[:, 0]
    phases = int(found.max())
    assert phases > 3
    steps = np.diff(found) % phases
    assert set(steps.tolist()) == {0, 1}


def test_vehicles_climb_with_their_path():
    """10 m up over 100 m, then level; who walks stands upright."""
    way = {"waypoints": [[0, 0, 0], [100, 0, 10], [200, 0, 10]], "speed_mps": 10.0}
    placement = at(
        build_cast([SceneObject(kind=kind, **way) for kind in ("car", "pedestrian")]), [5.0, 15.0]
    )
    np.testing.assert_allclose(placement.pitch_rad[:, 0], [-math.atan(0.1), 0.0], atol=1e-6)
    assert (placement.pitch_rad[:, 1] == 0.0).all()
    assert (placement.roll_rad == 0.0).all()
    np.testing.assert_allclose(placement.velocity_mps[:, 0, 2], [1.0, 0.0], atol=1e-6)
    assert (placement.velocity_mps[:, 1, 2] == 0.0).all()
    level = cast(kind="car", waypoints=[[0, 0], [9, 0]], speed_mps=1.0)
    assert at(level, 0.0).pitch_rad is None
