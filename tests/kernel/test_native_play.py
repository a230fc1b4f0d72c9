"""Orders of scenario files, played: what actors do is what the file says, seen by them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import program_of, scenario_text

from twin.validate.scenario_play import ScenarioPlay, play_scenario

pytestmark = pytest.mark.slow

STREET = {"ego": "{lane: 1, s_m: 20}", "road": "street"}
WEST = "{road: west, lane: 1, s_m: 20}"


def play_of(folder, actors: str, events: str = "", *, after_s: float = 8.0, **more) -> ScenarioPlay:
    text = scenario_text(actors, events, end=f"{{after_s: {after_s}}}", **more)
    play = play_scenario(program_of(folder, text), every=1)
    assert play.limits == ()
    return play


@pytest.mark.parametrize("oncoming", [False, True])
@pytest.mark.parametrize(("side", "way"), [("left", 1.0), ("right", -1.0)])
def test_left_and_right_are_those_of_the_driver(tmp_path, oncoming, side, way):
    play = play_of(
        tmp_path,
        f"car: {{kind: car, lane: 2, s_m: 700, speed_mps: 25, oncoming: {str(oncoming).lower()}}}",
        f"go: {{at_s: 1, do: {{car: {{change_lane: {side}, in_s: 3}}}}}}",
    )
    car = play.middle("car")
    left = -1.0 if oncoming else 1.0
    assert car[-1, 1] - car[0, 1] == pytest.approx(way * left * 3.75)
    assert (car[-1, 0] - car[0, 0]) * left > 190.0


@pytest.mark.parametrize("oncoming", [False, True])
def test_an_offset_is_to_the_left_of_the_driver_and_takes_its_time(tmp_path, oncoming):
    play = play_of(
        tmp_path,
        f"car: {{kind: car, lane: 2, s_m: 700, speed_mps: 25, oncoming: {str(oncoming).lower()}}}",
        "go: {at_s: 1, do: {car: {offset_m: 0.8, in_s: 2}}}",
    )
    y = play.y_m[:, play.entity("car")]
    left = -1.0 if oncoming else 1.0
    assert (y[-1] - y[0]) * left == pytest.approx(0.8)
    assert (y[play.at(2.0)] - y[0]) * left == pytest.approx(0.4, abs=0.01)
    assert y[play.at(3.01)] == pytest.approx(y[-1], abs=1e-3)


def test_a_path_leads_through_its_points_and_ends_there(tmp_path):
    play = play_of(
        tmp_path,
        "walker: {kind: pedestrian, footway: right, s_m: 60}",
        "go: {at_s: 1, do: {walker: {path: [[60, -2], [63, 2]], speed_mps: 2, shape: step}}}",
        **STREET,
    )
    walker, index = play.middle("walker"), play.entity("walker")
    assert walker[play.at(1.0)] == pytest.approx((60.0, -6.5))
    assert walker[play.at(1.0 + 4.5 / 2.0)] == pytest.approx((60.0, -2.0), abs=0.05)
    assert walker[-1] == pytest.approx((63.0, 2.0), abs=0.05)
    assert play.speed_mps[-1, index] == 0.0
    assert play.time_of("go", started=False) == pytest.approx(1.0 + 9.5 / 2.0, abs=0.05)


def test_after_a_path_one_may_go_on_along_the_road(tmp_path):
    play = play_of(
        tmp_path,
        "bike: {kind: bicycle, footway: right, s_m: 60}",
        "go: {do: {bike: {path: [[64, -4.5], [70, -1.5]], speed_mps: 4, at_end: go_on}}}",
        **STREET,
    )
    bike = play.middle("bike")
    assert play.speed_mps[-1, play.entity("bike")] == pytest.approx(4.0)
    assert bike[-1, 0] > 80.0
    assert bike[-1, 1] == pytest.approx(-1.5, abs=0.1)


@pytest.mark.parametrize(
    ("lane", "turn", "end"),
    [(2, "left", (3.25, 1.0)), (1, "straight", (1.0, -3.25)), (1, "right", (-3.25, -1.0))],
)
def test_turns_lead_into_the_right_arm(tmp_path, lane, turn, end):
    play = play_of(
        tmp_path,
        f"car: {{kind: car, road: west, lane: {lane}, s_m: 160, speed_mps: 10, turns: [{turn}]}}",
        ego=WEST,
        road="junction",
        after_s=9.0,
    )
    x, y = play.middle("car")[-1]
    if turn == "straight":
        assert y == pytest.approx(end[1], abs=0.01)
        assert x > 20.0
    else:
        assert x == pytest.approx(end[0], abs=0.01)
        assert y * end[1] > 20.0
    assert (play.speed_mps[:, 1] == 10.0).all()


def test_a_turn_may_be_told_on_the_way(tmp_path):
    play = play_of(
        tmp_path,
        "car: {kind: car, road: west, lane: 1, s_m: 160, speed_mps: 10}",
        "go: {at_s: 2, do: {car: {turns: [right]}}}",
        ego=WEST,
        road="junction",
    )
    assert play.middle("car")[-1, 0] == pytest.approx(-3.25, abs=0.01)


@pytest.mark.parametrize(("side", "way"), [("ahead", 1.0), ("behind", -1.0)])
def test_a_gap_is_kept_between_bumpers(tmp_path, side, way):
    play = play_of(
        tmp_path,
        f"truck: {{kind: truck, lane: 2, {side}_m: 30, speed_mps: 20}}",
        f"go: {{do: {{truck: {{keep: {{gap_m: 15, side: {side}}}}}}}}}",
        after_s=20.0,
    )
    gap = play.middle("truck")[:, 0] - play.middle("ego")[:, 0]
    assert gap[0] * way == pytest.approx(30.0 + 0.5 * (7.2 + 4.5))
    assert gap[-1] * way == pytest.approx(15.0 + 0.5 * (7.2 + 4.5), abs=0.2)


def test_delays_and_starts_of_other_events(tmp_path):
    play = play_of(
        tmp_path,
        "car: {kind: car, lane: 1, s_m: 300, speed_mps: 20}",
        "one: {at_s: 1, do: {car: {speed_mps: 15, in_s: 2}}}\n"
        "two: {after_start: one, delay_s: 0.5, do: {car: {lamps: {brake: on}}}}\n"
        "three: {after: one, delay_s: 0.5, do: {car: {speed_mps: 20, in_s: 1}}}",
    )
    assert play.time_of("one") == pytest.approx(1.0)
    assert play.time_of("two") == pytest.approx(1.5, abs=0.011)
    ended = play.time_of("one", started=False)
    assert ended == pytest.approx(3.0, abs=0.011)
    assert play.time_of("three") == pytest.approx(ended + 0.5, abs=0.021)


def test_who_is_invisible_appears_when_told(tmp_path):
    play = play_of(
        tmp_path,
        "car: {kind: car, lane: 1, s_m: 300, visible: false}",
        "show: {at_s: 2, do: {car: {visible: true}}}",
        after_s=3.0,
    )
    assert play.time_of("show") == pytest.approx(2.0)


def test_conditions_are_about_the_middle_of_a_body(tmp_path):
    play = play_of(
        tmp_path,
        "car: {kind: car, lane: 1, s_m: 300}",
        "go: {when: {ego: {reaches: {s_m: 150, lane: 2, within_m: 0.2}}}, "
        "do: {car: {lamps: {warning: flash}}}}",
    )
    place = play.middle("ego")[play.at(play.time_of("go")), 0]
    assert place == pytest.approx(150.0, abs=0.4)


def test_a_collision_ends_the_scenario_a_second_later(tmp_path):
    text = scenario_text(
        "car: {kind: car, lane: 2, ahead_m: 20}", end="{after_s: 30, collision_s: 1}"
    )
    play = play_scenario(program_of(tmp_path, text), every=1)
    assert play.time_s[-1] == pytest.approx(20.0 / 20.0 + 1.0, abs=0.03)


def test_all_done_ends_the_scenario(tmp_path):
    text = scenario_text(
        "car: {kind: car, lane: 1, s_m: 300, speed_mps: 10}",
        "stop: {at_s: 1, do: {car: {stop: true, in_s: 2}}}",
        end="{after_s: 30, all_done_s: 1.5}",
    )
    play = play_scenario(program_of(tmp_path, text), every=1)
    assert play.time_s[-1] == pytest.approx(4.5, abs=0.05)
    assert np.isfinite(play.x_m).all()


def test_a_trailer_follows_its_truck_through_a_change_of_lanes(tmp_path):
    play = play_of(
        tmp_path,
        "truck: {kind: truck, lane: 1, s_m: 700, speed_mps: 20}\n"
        "trailer: {kind: trailer, towed_by: truck}",
        "go: {at_s: 1, do: {truck: {change_lane: 2, in_s: 4}}}",
        after_s=12.0,
    )
    truck, trailer = play.entity("truck"), play.entity("trailer")
    assert play.y_m[-1, trailer] == pytest.approx(play.y_m[-1, truck], abs=0.01)
    assert play.y_m[-1, trailer] - play.y_m[0, trailer] == pytest.approx(3.75, abs=0.01)
    behind = play.x_m[:, truck] - play.x_m[:, trailer]
    # 1.35 m and 0.15 m to the hitch, 6.24 m from coupler to axle; a little less in a turn.
    assert behind.max() == pytest.approx(7.74)
    assert 7.7 < behind.min() < 7.739
