"""Shipped scenarios, played with nobody at the ego's wheel: what each is for does happen."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native, shipped_scenarios, with_values
from twin.validate.scenario_play import ScenarioPlay, play_scenario

pytestmark = pytest.mark.slow


def played(name: str, **values: float) -> ScenarioPlay:
    """``values``: numbers by path, with two underscores for each dot."""
    changes = {path.replace("__", "."): value for path, value in values.items()}
    program = compile_native(with_values(load_native(name), changes))
    play = play_scenario(program, every=1)
    assert play.limits == ()
    return play


def apart(play: ScenarioPlay, one: str, other: str) -> np.ndarray:
    """Distances between the middles of two bodies [T]."""
    return np.hypot(*(play.middle(one) - play.middle(other)).T)


def closest(play: ScenarioPlay, one: str, other: str) -> float:
    return float(np.nanmin(apart(play, one, other)))


def moment_after(play: ScenarioPlay, event: str, time_s: float, *, started: bool = True) -> int:
    began = play.time_of(event, started=started)
    assert began is not None
    return play.at(began + time_s)


def ends_with_a_collision(play: ScenarioPlay) -> bool:
    """The end came by the collision of an ego that nobody drove, not by the time."""
    return bool(play.time_s[-1] < play.program.elements[0].stop.groups[0][0].expression.value_s)


def test_there_are_at_least_eight():
    assert len(shipped_scenarios()) >= 8


def test_the_van_cuts_in_and_brakes():
    play = played("cut-in")
    ego, van = play.middle("ego"), play.middle("van")
    begin = moment_after(play, "cut_in", 0.0)
    gap = van[begin, 0] - ego[begin, 0] - 0.5 * (4.5 + 5.2)
    assert gap == pytest.approx(25.0, abs=0.06)  # 5 m/s for a step
    assert van[begin, 1] - ego[begin, 1] == pytest.approx(3.75)
    done = moment_after(play, "cut_in", 3.0)
    assert van[done, 1] == pytest.approx(ego[done, 1], abs=1e-3)
    assert van[done, 0] > ego[done, 0] + 4.85
    assert play.time_of("cut_in", started=False) == pytest.approx(play.time_of("cut_in") + 2.99)
    index = play.entity("van")
    second = moment_after(play, "brake", 1.0)
    assert play.speed_mps[second, index] == pytest.approx(25.0 - 4.0, abs=0.1)
    assert ends_with_a_collision(play)


def test_the_gap_of_the_cut_in_is_an_axis():
    near = played("cut-in", events__cut_in__when__van__gap_m__below=12.0)
    begin = moment_after(near, "cut_in", 0.0)
    gap = near.middle("van")[begin, 0] - near.middle("ego")[begin, 0] - 4.85
    assert gap == pytest.approx(12.0, abs=0.06)


def test_the_car_ahead_cuts_out_and_bares_a_standing_one():
    play = played("cut-out")
    lead, standing, ego = (play.middle(name) for name in ("lead", "standing", "ego"))
    begin = moment_after(play, "cut_out", 0.0)
    left = standing[begin, 0] - lead[begin, 0] - 4.5
    assert left / 22.2 == pytest.approx(3.0, abs=0.02)
    done = moment_after(play, "cut_out", 2.8)
    assert lead[done, 1] - ego[done, 1] == pytest.approx(3.75, abs=1e-3)
    # It gets past: where it is beside the standing car it has left the lane.
    beside = np.abs(lead[:, 0] - standing[:, 0]) < 4.5
    assert (lead[beside, 1] - standing[beside, 1] > 1.8).all()
    assert closest(play, "ego", "standing") < 1.0
    assert ends_with_a_collision(play)


def test_the_car_ahead_brakes_to_a_standstill():
    play = played("braking-lead")
    index = play.entity("lead")
    assert play.time_of("brake") == pytest.approx(2.0)
    stopped = moment_after(play, "brake", 13.9 / 6.0 + 0.02)
    assert play.speed_mps[stopped, index] == 0.0
    way = play.middle("lead")[stopped, 0] - play.middle("lead")[play.at(2.0), 0]
    assert way == pytest.approx(13.9**2 / 12.0, abs=0.1)
    assert ends_with_a_collision(play)


@pytest.mark.parametrize("speed_mps", [8.0, 11.1, 14.0])
def test_the_pedestrian_is_in_the_way_when_the_ego_would_be_there(speed_mps):
    play = played("pedestrian-between-parked-cars", ego__speed_mps=speed_mps)
    ego, walker = play.middle("ego"), play.middle("walker")
    there = int(np.argmin(np.abs(ego[:, 0] - 107.3)))
    assert walker[there, 0] == pytest.approx(107.3)
    assert walker[there, 1] == pytest.approx(ego[there, 1], abs=0.05)
    assert ends_with_a_collision(play)


def test_the_pedestrian_walks_between_the_parked_cars():
    play = played("pedestrian-between-parked-cars")
    walker = play.middle("walker")
    for name in ("parked_one", "parked_two", "parked_three"):
        assert np.abs(play.middle(name)[:, 0] - walker[:, 0]).min() > 2.25
    # Hidden until it steps past the van's side, that soon before both meet.
    visible = int(np.argmax(walker[:, 1] > -3.3))
    there = int(np.argmin(np.abs(play.middle("ego")[:, 0] - 107.3)))
    assert 0.8 < play.time_s[there] - play.time_s[visible] < 1.8
    index = play.entity("walker")
    assert np.nanmax(play.speed_mps[:, index]) == pytest.approx(1.39, abs=0.05)


@pytest.mark.parametrize("speed_mps", [9.0, 11.1, 13.0])
def test_the_cyclist_crosses_where_the_ego_is(speed_mps):
    play = played("crossing-cyclist", ego__speed_mps=speed_mps)
    assert closest(play, "ego", "cyclist") < 0.35
    meeting = int(np.nanargmin(apart(play, "ego", "cyclist")))
    assert play.middle("cyclist")[meeting] == pytest.approx((4.25, -3.25), abs=0.3)
    assert play.heading_rad[meeting, 1] == pytest.approx(0.5 * np.pi)
    assert ends_with_a_collision(play)


def test_the_cyclist_keeps_to_its_speed_if_the_ego_does():
    play = played("crossing-cyclist")
    assert np.abs(play.speed_mps[:, play.entity("cyclist")] - 4.2).max() < 0.1


def test_the_oncoming_car_turns_into_the_way_of_the_ego():
    play = played("oncoming-turner")
    assert closest(play, "ego", "turner") < 1.0
    meeting = int(np.nanargmin(apart(play, "ego", "turner")))
    # It has turned by more than an eighth, and comes from the other side.
    turned = play.heading_rad[meeting, play.entity("turner")]
    assert np.cos(turned) < -0.5
    assert np.sin(turned) < -0.4
    assert play.middle("turner")[0, 1] == pytest.approx(0.0, abs=0.01)
    assert ends_with_a_collision(play)


def test_the_deer_stops_in_the_lane_and_runs_on():
    play = played("animal-on-rural-road", end__collision_s=60.0)
    deer, index = play.middle("deer"), play.entity("deer")
    stood = moment_after(play, "run", 0.5, started=False)
    assert play.speed_mps[stood, index] == 0.0
    ego_way = play.middle("ego")
    assert np.hypot(*(ego_way - deer[stood]).T).min() < 0.5  # in the middle of the ego's lane
    assert play.time_of("run_on") == pytest.approx(
        play.time_of("run", started=False) + 1.5, abs=0.03
    )
    # On the other side of the road at the end: 9 m to the left of its middle.
    assert np.hypot(*(deer[-1] - deer[stood])) == pytest.approx(np.hypot(4.0, 10.75), abs=0.1)
    assert play.speed_mps[-1, index] == 0.0


def test_the_deer_ends_the_drive_of_an_ego_that_nobody_drives():
    assert ends_with_a_collision(played("animal-on-rural-road"))


@pytest.mark.parametrize("speed_mps", [9.0, 11.1, 13.0])
def test_the_child_is_in_the_way_when_the_ego_would_be_there(speed_mps):
    play = played("child-behind-bus", ego__speed_mps=speed_mps)
    ego, child = play.middle("ego"), play.middle("child")
    there = int(np.argmin(np.abs(ego[:, 0] - 128.0)))
    assert child[there, 1] == pytest.approx(ego[there, 1], abs=0.1)
    assert closest(play, "child", "bus") > 5.9  # behind it, not through it
    assert ends_with_a_collision(play)


@pytest.mark.parametrize("speed_kmh", [20.0, 40.0, 60.0])
@pytest.mark.parametrize("name", ["r152-pedestrian-crossing", "r152-bicycle-crossing"])
def test_who_crosses_is_in_the_middle_of_the_front_at_any_speed(name, speed_kmh):
    play = played(name, ego__speed_mps=speed_kmh / 3.6)
    ego, target = play.middle("ego"), play.middle("target")
    box = play.program.entities[play.entity("ego")].box
    there = int(np.argmin(np.abs(ego[:, 0] + box.length_m / 2 - target[:, 0])))
    assert target[there, 1] == pytest.approx(ego[there, 1], abs=0.1)
    begun = play.time_of("cross")
    meets_s = float(play.time_s[there])
    assert meets_s - begun > 4.4, "it moves steadily when the time to collision is 4 s"
    assert ends_with_a_collision(play)


@pytest.mark.parametrize("name", shipped_scenarios())
def test_nobody_touches_anybody_before_the_first_event(name):
    """Neither at the start nor on the way to where the story begins."""
    play = played(name)
    first = min((event.time_s for event in play.events if event.started), default=1.0)
    moment = play.at(first)
    names = [entity.name for entity in play.program.entities]
    for number, one in enumerate(names):
        for other in names[:number]:
            assert apart(play, one, other)[: moment + 1].min() > 1.0, (one, other)


def touching(play: ScenarioPlay, one: str, other: str) -> np.ndarray:
    """Where boxes overlap that stand along x [T]."""
    boxes = [play.program.entities[play.entity(name)].box for name in (one, other)]
    gap = np.abs(play.middle(one) - play.middle(other))
    length, width = (0.5 * sum(getattr(b, k) for b in boxes) for k in ("length_m", "width_m"))
    return (gap[:, 0] < length) & (gap[:, 1] < width)


@pytest.mark.parametrize("ego_mps", [18.0, 30.0])
def test_traffic_flows_and_nobody_touches_anybody(ego_mps):
    play = played("free-traffic", ego__speed_mps=ego_mps)
    names = [entity.name for entity in play.program.entities]
    assert len(names) == 17
    for number, one in enumerate(names):
        for other in names[:number]:
            assert not touching(play, one, other).any(), (one, other)
    assert play.time_s[-1] == pytest.approx(30.0)
    # All drive on, about as fast as they like or as those ahead of them do.
    assert play.speed_mps[:, 1:].min() > 16.0
    aside = {name: np.ptp(play.middle(name)[:, 1]) for name in names}
    assert sum(way > 3.5 for way in aside.values()) >= 2
    assert aside["truck_one"] < 0.01
    assert aside["truck_two"] < 0.01


def test_traffic_makes_way_for_a_slow_ego():
    """Behind an ego at 18 m/s somebody who would like 36 m/s changes lanes."""
    play = played("free-traffic", ego__speed_mps=18.0)
    assert play.middle("car_five")[-1, 1] - play.middle("ego")[-1, 1] > 3.5
    assert play.middle("car_five")[0, 1] == play.middle("ego")[0, 1]


@pytest.mark.parametrize(
    ("name", "speed_mps"),
    [
        ("ncap-pedestrian-nearside", 1.3889),
        ("ncap-pedestrian-nearside", 2.0),
        ("ncap-pedestrian-farside", 2.2222),
        ("ncap-bicycle-farside", 20 / 3.6),
        ("ncap-bicycle-obstructed", 10 / 3.6),
    ],
)
def test_who_arrives_steadily_never_stands_still_on_the_way(name, speed_mps):
    """Also where the steady part takes a whole number of steps, up to rounding."""
    play = played(name, events__cross__do__target__arrive__speed_mps=speed_mps)
    x, y = play.middle("target").T
    speeds = np.hypot(np.diff(x), np.diff(y)) / np.diff(play.time_s)
    fast = np.flatnonzero(speeds > 0.9 * speed_mps)
    met = play.at(6.0)
    assert fast[0] < met
    assert speeds[fast[0] : met].min() > 0.9 * speed_mps
