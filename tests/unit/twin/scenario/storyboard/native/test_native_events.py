"""Events of scenario files: what they wait for, what actors do, what is refused."""

from __future__ import annotations

import bisect
import math

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import actions_of, event_elements, mistakes_of, program_of, scenario_text

from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.program import actions as act
from twin.scenario.storyboard.program import conditions as when
from twin.scenario.storyboard.program.actions import (
    LIGHTS,
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    FinalSpeedKind,
    SteadyStateKind,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    DistanceFrame,
    DistanceKind,
    ElementState,
    SpeedAxis,
)
from twin.scenario.storyboard.program.program import ElementKind, EventPriority
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.sky.weather import WEATHER

VAN = "van: {kind: van, lane: 3, ahead_m: 40, speed_mps: 25}"
ROAD = (True, DistanceFrame.ROAD, DistanceKind.LONGITUDINAL)
WALK_EGO = "{lane: 1, s_m: 20, speed_mps: 10}"
WALKER = "walker: {kind: pedestrian, footway: right, s_m: 60}"
CYCLIST = "bike: {kind: bicycle, road: south, lane: 1, s_m: 171, speed_mps: 4}"
WEST = "{road: west, lane: 1, s_m: 110, speed_mps: 11}"


def orders_of(tmp_path, orders: str, actor: str = VAN, **more):
    name = actor.split(":")[0]
    text = scenario_text(actor, f"event: {{do: {{{name}: {{{orders}}}}}}}", **more)
    return actions_of(program_of(tmp_path, text), f"{name} event")


def wrong_orders(tmp_path, orders: str, actor: str = VAN, **more) -> list[str]:
    name = actor.split(":")[0]
    text = scenario_text(actor, f"event: {{do: {{{name}: {{{orders}}}}}}}", **more)
    return mistakes_of(tmp_path, text)


def conditions(tmp_path, event: str, actors: str = VAN):
    """Groups of expressions that the event `event` waits for."""
    program = program_of(tmp_path, scenario_text(actors, event))
    trigger = event_elements(program)["van event"].start
    return [[one.expression for one in group] for group in trigger.groups], trigger


def dynamics(shape: str, dimension: str, value: float) -> TransitionDynamics:
    return TransitionDynamics(DynamicsShape[shape], DynamicsDimension[dimension], value)


@pytest.mark.parametrize(
    ("orders", "expected"),
    [
        ("speed_mps: 15, at_mps2: 4", dynamics("LINEAR", "RATE", 4.0)),
        ("speed_mps: 15, in_s: 4", dynamics("LINEAR", "TIME", 4.0)),
        ("speed_mps: 15, over_m: 40, shape: cubic", dynamics("CUBIC", "DISTANCE", 40.0)),
        ("speed_mps: 15", dynamics("LINEAR", "RATE", 3.0)),
        ("speed_mps: 15, shape: step", dynamics("STEP", "TIME", 0.0)),
    ],
)
def test_changes_of_speed(tmp_path, orders, expected):
    assert orders_of(tmp_path, orders) == [act.SpeedAction(expected, -1, 15.0)]


def test_stopping_is_a_speed_of_0(tmp_path):
    (action,) = orders_of(tmp_path, "stop: true, at_mps2: 6")
    assert action == act.SpeedAction(dynamics("LINEAR", "RATE", 6.0), -1, 0.0)


@pytest.mark.parametrize(
    ("orders", "entity", "lane", "expected"),
    [
        ("change_lane: 2, in_s: 3", -1, -3, dynamics("SINUSOIDAL", "TIME", 3.0)),
        ("change_lane: 1, over_m: 60, shape: cubic", -1, -4, dynamics("CUBIC", "DISTANCE", 60.0)),
        ("change_lane: right", 1, -1, dynamics("SINUSOIDAL", "TIME", 4.0)),
    ],
)
def test_lane_changes(tmp_path, orders, entity, lane, expected):
    assert orders_of(tmp_path, orders) == [act.LaneChangeAction(expected, entity, lane, 0.0)]


def test_offsets_are_those_that_the_actor_sees(tmp_path):
    (along,) = orders_of(tmp_path, "offset_m: 0.5, in_s: 2")
    assert along == act.LaneChangeAction(dynamics("SINUSOIDAL", "TIME", 2.0), 1, 0, 0.5)
    against = "van: {kind: van, lane: 3, oncoming: true, s_m: 400, speed_mps: 25}"
    (action,) = orders_of(tmp_path, "offset_m: 0.5", against)
    assert action.target_offset_m == -0.5


def test_lane_changes_count_from_where_the_last_one_led(tmp_path):
    events = (
        "one: {do: {van: {change_lane: right}}}\ntwo: {after: one, do: {van: {change_lane: right}}}"
    )
    program = program_of(tmp_path, scenario_text(VAN, events))
    assert len(event_elements(program)) == 2
    (line,) = mistakes_of(
        tmp_path,
        scenario_text(VAN, "one: {do: {van: {change_lane: left}}}"),
    )
    assert line == "events.one.do.van.change_lane: left of 'van' is a lane of type median"
    (line,) = mistakes_of(
        tmp_path,
        scenario_text(
            "van: {kind: van, lane: 1, s_m: 400}",
            "one: {do: {van: {change_lane: right}}}\n"
            "two: {after: one, do: {van: {change_lane: right}}}",
        ),
    )
    assert line == "events.two.do.van.change_lane: no lane is right of 'van' on road motorway"


def test_a_way_across_the_street(tmp_path):
    more = {"ego": WALK_EGO, "road": "street"}
    text = scenario_text(WALKER, "go: {at_s: 1, do: {walker: {cross_to: left}}}", **more)
    program = program_of(tmp_path, text)
    (line,) = program.trajectories
    piece = line.pieces[0]
    assert (piece.x[0], piece.y[0]) == pytest.approx((60.0, -6.5))
    assert sum(piece.length_m for piece in line.pieces) == pytest.approx(13.0)
    assert (piece.x[1], piece.y[1]) == pytest.approx((0.0, 1.0))
    assert piece.heading[0] == pytest.approx(0.5 * math.pi)
    # The body faces where it will go, and stops there.
    assert program.entities[1].start.heading_rad == pytest.approx(0.5 * math.pi)
    stop = event_elements(program)["walker go stops"]
    (condition,) = stop.start.groups[0]
    event = program.elements.index(event_elements(program)["walker go"])
    assert condition.expression == when.ElementStateCondition(event, ElementState.COMPLETE)
    assert actions_of(program, "walker go stops") == [
        act.SpeedAction(dynamics("STEP", "TIME", 0.0), -1, 0.0)
    ]


def heights_along(trajectory, steps_m: list[float]) -> list[float]:
    """Heights at distances from the beginning of a trajectory."""
    starts = [piece.start_s_m for piece in trajectory.pieces]
    pieces = [trajectory.pieces[bisect.bisect_right(starts, s) - 1] for s in steps_m]
    return [
        sum(factor * (s - piece.start_s_m) ** power for power, factor in enumerate(piece.z))
        for piece, s in zip(pieces, steps_m, strict=True)
    ]


@pytest.mark.parametrize("kind", ["pedestrian", "child", "bicycle", "animal"])
def test_who_leaves_a_footway_comes_down_from_its_kerb(tmp_path, kind):
    actor = f"walker: {{kind: {kind}, footway: right, s_m: 60}}"
    text = scenario_text(actor, "go: {do: {walker: {cross_to: left}}}", ego=WALK_EGO, road="street")
    (line,) = program_of(tmp_path, text).trajectories
    # Footways are 2 m wide, behind kerbs of 12 cm, and the way begins in the middle of one.
    heights = heights_along(line, [0.0, 0.5, 1.5, 4.0, 6.5, 9.0, 11.5, 12.5, 13.0])
    assert heights == pytest.approx([0.12, 0.12, 0, 0, 0, 0, 0, 0.12, 0.12], abs=0.006)
    rise = [abs(piece.z[1]) for piece in line.pieces]
    assert max(rise) < 0.3, "it steps down within half a metre, not at once"


def test_a_line_over_level_ground_is_one_piece(tmp_path):
    actor = "walker: {kind: pedestrian, lateral_m: -3, s_m: 60}"
    text = scenario_text(
        actor, "go: {do: {walker: {path: [[60, 3]]}}}", ego=WALK_EGO, road="street"
    )
    (line,) = program_of(tmp_path, text).trajectories
    (piece,) = line.pieces
    assert piece.z == (0.0, 0.0, 0.0, 0.0)


def test_a_path_follows_a_hill(tmp_path):
    """A straight line between two places of a road that rises and falls would cut through it."""
    actor = "walker: {kind: pedestrian, lateral_m: -3, s_m: 100}"
    go = "go: {do: {walker: {path: [[200, -3]], speed_mps: 1}}}"
    ego = "{lane: 1, s_m: 20, speed_mps: 5}"
    program = program_of(tmp_path, scenario_text(actor, go, ego=ego, road="rural"))
    (line,) = program.trajectories
    frame = next(iter(RoadMap(program.network).frames.values()))
    piece_ends = [(p.start_s_m, p.x[0], p.y[0], p.z[0]) for p in line.pieces]
    under = [frame.locate(x, y) for _, x, y, _ in piece_ends]
    ground = [float(frame.pose(float(u.s_m), float(u.t_m)).z_m) for u in under]
    assert [z for *_, z in piece_ends] == pytest.approx(ground, abs=0.02)


def test_a_given_heading_stays(tmp_path):
    walker = "walker: {kind: pedestrian, footway: right, s_m: 60, heading_deg: 0}"
    text = scenario_text(
        walker, "go: {do: {walker: {cross_to: left}}}", ego=WALK_EGO, road="street"
    )
    assert program_of(tmp_path, text).entities[1].start.heading_rad == pytest.approx(0.0)


def test_a_path_goes_on_where_the_one_before_ended(tmp_path):
    events = (
        "go: {do: {walker: {path: [[60, -2], [62, 0]], speed_mps: 1}}}\n"
        "on: {after: go, do: {walker: {path: [[62, 4]], at_end: go_on}}}"
    )
    program = program_of(tmp_path, scenario_text(WALKER, events, ego=WALK_EGO, road="street"))
    first, second = program.trajectories
    *across, last = (piece.length_m for piece in first.pieces)
    assert (sum(across), last) == pytest.approx((4.5, math.sqrt(8.0)))
    assert (second.pieces[0].x[0], second.pieces[0].y[0]) == pytest.approx((62.0, 0.0))
    assert "walker on stops" not in event_elements(program)


def test_without_a_footway_one_goes_beyond_the_road(tmp_path):
    actor = "deer: {kind: animal, lateral_m: -8, s_m: 100}"
    text = scenario_text(
        actor, "go: {do: {deer: {cross_to: left}}}", ego="{lane: 1, s_m: 20}", road="rural"
    )
    (line,) = program_of(tmp_path, text).trajectories
    assert line.pieces[0].length_m == pytest.approx(8.0 + 5.0 + 1.0)


def test_arriving_where_ways_cross(tmp_path):
    text = scenario_text(
        CYCLIST,
        "ride: {do: {bike: {arrive: {meet: ego, speed_mps: 4}}}}",
        ego=WEST,
        road="junction",
    )
    program = program_of(tmp_path, text)
    (action,) = actions_of(program, "bike ride")
    assert isinstance(action, act.SynchronizeAction)
    assert (action.position.x_m, action.position.y_m) == pytest.approx((3.25, -3.25))
    # The ego's middle is there when its rear axle is so far behind.
    assert action.master_position.x_m == pytest.approx(3.25 - 1.42)
    assert action.final_speed is FinalSpeedKind.ABSOLUTE
    assert action.final_speed_mps == 4.0
    roads = list(program.network.roads)
    assert roads[action.position.road] == "41"
    assert roads[action.master_position.road] == "11"


def test_arriving_on_a_path(tmp_path):
    text = scenario_text(
        WALKER,
        "go: {do: {walker: {cross_to: left, speed_mps: 1.4, arrive: {}}}}",
        ego=WALK_EGO,
        road="street",
    )
    program = program_of(tmp_path, text)
    (action,) = actions_of(program, "walker go arrives")
    assert (action.trajectory, action.master_trajectory) == (0, -1)
    assert action.trajectory_s_m == pytest.approx(6.5 - 1.625)
    assert action.master_position.x_m == pytest.approx(60.0 - 1.42)
    # It sets off at a speed, and adapts it a step later.
    speed = actions_of(program, "walker go")[1]
    assert speed == act.SpeedAction(dynamics("STEP", "TIME", 0.0), -1, 1.4)
    (condition,) = event_elements(program)["walker go arrives"].start.groups[0]
    assert program.elements[condition.expression.element].action == speed


def test_arriving_where_a_file_says(tmp_path):
    orders = "arrive: {meet: ego, at: {s_m: 160, lane: 1}, meet_at: {s_m: 190, lane: 1}}"
    (action,) = orders_of(tmp_path, orders, CYCLIST, ego=WEST, road="junction")
    # The middles of both boxes are there then: of a cyclist its origin, of the ego 1.42 m ahead.
    assert action.position.s_m == 160.0
    assert action.position.road == 3
    assert action.master_position.road == 0
    assert action.master_position.s_m == pytest.approx(190.0 - 1.42)
    assert action.final_speed is FinalSpeedKind.NONE
    assert action.steady_state is SteadyStateKind.NONE


def test_arriving_at_a_speed_that_is_kept(tmp_path):
    orders = "arrive: {at: {s_m: 160}, meet_at: {s_m: 190}, speed_mps: 4, steady_m: 6}"
    (action,) = orders_of(tmp_path, orders, CYCLIST, ego=WEST, road="junction")
    assert (action.final_speed, action.final_speed_mps) == (FinalSpeedKind.ABSOLUTE, 4.0)
    assert (action.steady_state, action.steady_state_value) == (SteadyStateKind.DISTANCE, 6.0)


def test_keeping_a_gap(tmp_path):
    (action,) = orders_of(tmp_path, "keep: {to: ego, gap_s: 1.5, side: ahead}")
    assert isinstance(action, act.LongitudinalDistanceAction)
    assert (action.entity, action.value, action.time_gap) == (0, 1.5, True)
    assert action.displacement is Displacement.AHEAD
    assert action.freespace
    assert action.continuous
    assert action.limits.deceleration_max_mps2 == 6.0


def test_lamps_and_visibility(tmp_path):
    actions = orders_of(tmp_path, "lamps: {brake: on, indicator_left: flash}, visible: false")
    assert [(LIGHTS[one.light], one.mode) for one in actions[:2]] == [
        ("brakeLights", 1),
        ("indicatorLeft", 2),
    ]
    assert actions[2] == act.VisibilityAction(False, False, False)


def test_driver_models(tmp_path):
    car = "car: {kind: car, lane: 1, s_m: 300, speed_mps: 20, behaviour: idm, idm: {time_gap_s: 1}}"
    program = program_of(tmp_path, scenario_text(car, "off: {do: {car: {behaviour: none}}}"))
    (model,) = program.models
    assert (model.desired_speed_mps, model.time_gap_s, model.politeness) == (20.0, 1.0, 0.3)
    assert act.ControllerAction(True, True, 0) in [row.action for row in program.init]
    assert actions_of(program, "car off") == [act.ControllerAction(False, False)]


def test_the_ego_may_have_a_driver_model(tmp_path):
    ego = "{lane: 1, s_m: 60, speed_mps: 20, behaviour: idm, idm: {desired_speed_mps: 25}}"
    car = "car: {kind: car, lane: 1, s_m: 300, speed_mps: 20, behaviour: idm}"
    program = program_of(tmp_path, scenario_text(car, ego=ego))
    assert [model.desired_speed_mps for model in program.models] == [25.0, 20.0]
    begun = [(row.action, row.actor) for row in program.init]
    assert (act.ControllerAction(True, True, 0), 0) in begun
    assert (act.ControllerAction(True, True, 1), 1) in begun


def test_turns_are_routes(tmp_path):
    text = scenario_text(
        "car: {kind: car, road: east, lane: 2, s_m: 150, speed_mps: 5, turns: [left]}",
        ego=WEST,
        road="junction",
    )
    program = program_of(tmp_path, text)
    (route,) = program.routes
    roads = list(program.network.roads)
    assert [roads[leg.road] for leg in route.legs] == ["2", "30", "3"]
    assert (route.legs[0].from_s_m, route.legs[2].to_s_m) == (150.0, 0.0)
    assert act.AssignRouteAction(0) in [row.action for row in program.init]


@pytest.mark.parametrize(
    ("watch", "expected"),
    [
        ("gap_m: {below: 25}", when.RelativeDistanceCondition(0, 25.0, ComparisonRule.LESS, *ROAD)),
        ("headway_s: {above: 2}", when.TimeHeadwayCondition(0, 2.0, ComparisonRule.GREATER, *ROAD)),
        (
            "ttc_s: {below: 2}",
            when.TimeToCollisionCondition(0, None, 2.0, ComparisonRule.LESS, *ROAD),
        ),
        (
            "distance_m: {below: 9}",
            when.RelativeDistanceCondition(
                0, 9.0, ComparisonRule.LESS, True, DistanceFrame.ENTITY, DistanceKind.EUCLIDEAN
            ),
        ),
        (
            "lateral_gap_m: {below: 1}",
            when.RelativeDistanceCondition(
                0, 1.0, ComparisonRule.LESS, True, DistanceFrame.ROAD, DistanceKind.LATERAL
            ),
        ),
        (
            "relative_speed_mps: {above: 3}",
            when.RelativeSpeedCondition(0, 3.0, ComparisonRule.GREATER, SpeedAxis.LONGITUDINAL),
        ),
        (
            "speed_mps: {below: 3}",
            when.SpeedCondition(3.0, ComparisonRule.LESS, SpeedAxis.LONGITUDINAL),
        ),
        (
            "acceleration_mps2: {below: -3}",
            when.AccelerationCondition(-3.0, ComparisonRule.LESS, SpeedAxis.LONGITUDINAL),
        ),
        ("travelled_m: 50", when.TraveledDistanceCondition(50.0)),
        ("stands_s: 2", when.StandStillCondition(2.0)),
        ("touches: any", when.CollisionCondition(-1, -1)),
        ("touches: ego", when.CollisionCondition(0, -1)),
    ],
)
def test_what_events_wait_for(tmp_path, watch, expected):
    event = f"event: {{when: {{van: {{{watch}}}}}, do: {{van: {{stop: true}}}}}}"
    groups, trigger = conditions(tmp_path, event)
    assert groups == [[expected]]
    assert trigger.groups[0][0].entities == (1,)
    assert trigger.groups[0][0].edge is when.ConditionEdge.NONE


def test_everything_that_an_event_waits_for_must_hold(tmp_path):
    event = (
        "event: {at_s: 2, delay_s: 0.5, "
        "when: {van: {gap_m: {above: 5, below: 25}}, ego: {speed_mps: {above: 1}}}, "
        "do: {van: {stop: true}}}"
    )
    groups, trigger = conditions(tmp_path, event)
    assert len(groups) == 1
    assert [type(one).__name__ for one in groups[0]] == [
        "SimulationTimeCondition",
        "RelativeDistanceCondition",
        "RelativeDistanceCondition",
        "SpeedCondition",
    ]
    # A delay of a time is a later time.
    assert groups[0][0].value_s == 2.5
    assert [one.delay_s for one in trigger.groups[0]] == [0.0, 0.5, 0.5, 0.5]


def test_reaching_a_place_means_the_middle_of_the_body(tmp_path):
    event = "event: {when: {ego: {reaches: {s_m: 200, lane: 2}}}, do: {van: {stop: true}}}"
    groups, _ = conditions(tmp_path, event)
    (reach,) = groups[0]
    assert reach.tolerance_m == 2.0
    assert (reach.position.s_m, reach.position.lane) == (pytest.approx(200.0 - 1.42), -3)


def test_after_an_event_of_several_actors_all_of_them_are_done(tmp_path):
    actors = VAN + "\ncar: {kind: car, lane: 1, s_m: 300}"
    events = (
        "both: {do: {van: {stop: true}, car: {speed_mps: 5}}}\n"
        "next: {after: both, delay_s: 1, do: {van: {speed_mps: 9}}}\n"
        "along: {after_start: both, do: {car: {lamps: {warning: flash}}}}"
    )
    program = program_of(tmp_path, scenario_text(actors, events))
    (group,) = event_elements(program)["van next"].start.groups
    maneuvers = [program.elements[one.expression.element] for one in group]
    assert [one.kind for one in maneuvers] == [ElementKind.MANEUVER] * 2
    assert [program.elements[one.parent].name for one in maneuvers] == ["van", "car"]
    assert {one.expression.state for one in group} == {ElementState.COMPLETE}
    assert [one.delay_s for one in group] == [1.0, 1.0]
    groups = event_elements(program)["car along"].start.groups
    assert len(groups) == 4  # each of both may run or have ended
    assert all(element.priority is EventPriority.PARALLEL for element in program.elements)


def test_events_begin_after_time_0(tmp_path):
    program = program_of(tmp_path, scenario_text(VAN, "event: {do: {van: {stop: true}}}"))
    assert event_elements(program)["van event"].start is None
    (act_element,) = [one for one in program.elements if one.kind is ElementKind.ACT]
    expression = act_element.start.groups[0][0].expression
    assert expression == when.SimulationTimeCondition(0.0, ComparisonRule.GREATER)


def test_ends(tmp_path):
    end = "{after_s: 9, ego_reaches: {s_m: 400}, ego_stands_s: 1, collision_s: 2, all_done_s: 3}"
    text = scenario_text(VAN, "event: {do: {van: {stop: true}}}", end=end)
    stop = program_of(tmp_path, text).elements[0].stop
    assert [type(group[0].expression).__name__ for group in stop.groups] == [
        "SimulationTimeCondition",
        "ReachPositionCondition",
        "StandStillCondition",
        "CollisionCondition",
        "ElementStateCondition",
    ]
    assert [group[0].delay_s for group in stop.groups] == [0.0, 0.0, 0.0, 2.0, 3.0]
    assert [group[0].entities for group in stop.groups] == [(), (0,), (0,), (0,), ()]
    (line,) = mistakes_of(tmp_path, scenario_text(VAN, end="{all_done_s: 1}"))
    assert line == "end.all_done_s: there are no events that could be done"


def test_a_scenario_without_events_is_one_element(tmp_path):
    program = program_of(tmp_path, scenario_text(VAN))
    assert [element.kind for element in program.elements] == [ElementKind.STORYBOARD]
    assert program.elements[0].stop.groups[0][0].expression.value_s == 60.0


@pytest.mark.parametrize(
    ("events", "line"),
    [
        ("a: {do: {bus: {stop: true}}}", "events.a.do.bus: no actor 'bus'; allowed: ego, van"),
        ("a: {do: {van: {}}}", "events.a.do.van: 'van' is told to do nothing"),
        ("a: {after: b, do: {van: {stop: true}}}", "events.a.after: no event 'b'; allowed: "),
        ("a: {after: a, do: {van: {stop: true}}}", "events.a.after: events wait for each other: a"),
        (
            "a: {do: {van: {speed_mps: 51}}}",
            "events.a.do.van.speed_mps: given 51, 'van' goes at mo",
        ),
        ("a: {do: {van: {change_lane: 4}}}", "events.a.do.van.change_lane: lane 4 is not on road"),
        ("a: {do: {van: {path: [[300, -5]]}}}", "events.a.do.van.path: 'van' is on its way before"),
        ("a: {do: {van: {keep: {to: van, gap_m: 5}}}}", "events.a.do.van.keep.to: no other actor "),
        (
            "a: {do: {van: {arrive: {}}}}",
            "events.a.do.van.arrive: the ways of 'van' and 'ego' do n",
        ),
        ("a: {do: {van: {arrive: {meet: x}}}}", "events.a.do.van.arrive.meet: no other actor 'x';"),
        ("a: {do: {ego: {behaviour: idm}}}", "events.a.do.ego.behaviour: an event leaves the ego"),
        (
            "a: {when: {bus: {stands_s: 1}}, do: {van: {stop: true}}}",
            "events.a.when.bus: no actor 'bus'; allowed: ego, van",
        ),
        (
            "a: {when: {ego: {gap_m: {below: 1}}}, do: {van: {stop: true}}}",
            "events.a.when.ego.to: missing; gap_m of the ego is to an actor: van",
        ),
        (
            "a: {when: {van: {to: van, gap_m: {below: 1}}}, do: {van: {stop: true}}}",
            "events.a.when.van.to: 'van' is itself; allowed: ego",
        ),
        (
            "a: {when: {van: {to: ego, stands_s: 1}}, do: {van: {stop: true}}}",
            "events.a.when.van.to: nothing is to 'ego'; give gap_m,",
        ),
        (
            "a: {when: {van: {touches: bus}}, do: {van: {stop: true}}}",
            "events.a.when.van.touches: no actor 'bus' to touch; allowed: any, ego",
        ),
        (
            "a: {when: {van: {reaches: {s_m: 9999}}}, do: {van: {stop: true}}}",
            "events.a.when.van.reaches.s_m: 9999 m along the road, allowed: 0 to 1500",
        ),
        (
            "a: {do: {van: {keep: {gap_m: 5}}}}\nb: {after: a, do: {van: {stop: true}}}",
            "events.b.after: 'a' never ends: it keeps a gap for ever; use after_start",
        ),
    ],
)
def test_events_that_cannot_be(tmp_path, events, line):
    lines = mistakes_of(tmp_path, scenario_text(VAN, events))
    assert len(lines) == 1
    assert lines[0].startswith(line)


def test_a_circle_of_events_is_shown(tmp_path):
    events = "\n".join(
        f"{name}: {{after: {before}, do: {{van: {{stop: true}}}}}}"
        for name, before in (("a", "c"), ("b", "a"), ("c", "b"))
    )
    (line,) = mistakes_of(tmp_path, scenario_text(VAN, events))
    assert line == "events.a.after: events wait for each other: a -> c -> b -> a"


def test_walkers_have_no_lamps(tmp_path):
    (line,) = wrong_orders(tmp_path, "lamps: {brake: on}", WALKER, ego=WALK_EGO, road="street")
    assert line == "events.event.do.walker.lamps: an actor of kind pedestrian has no lamps"


def test_a_lane_that_does_not_lead_there(tmp_path):
    car = "car: {kind: car, road: east, lane: 1, s_m: 150, speed_mps: 5, turns: [left]}"
    (line,) = mistakes_of(tmp_path, scenario_text(car, ego=WEST, road="junction"))
    assert line == (
        "actors.car.turns: 'left': its lane on road east does not lead there; "
        "it leads straight, right"
    )
    car = "car: {kind: car, road: east, lane: 1, s_m: 150, speed_mps: 5}"
    (line,) = wrong_orders(tmp_path, "change_lane: 2", car, ego=WEST, road="junction")
    assert line.startswith("events.event.do.car.change_lane: 'car' goes through a junction; the la")


def test_mistakes_of_all_sections_come_at_once(tmp_path):
    lines = mistakes_of(
        tmp_path,
        scenario_text(
            "van: {kind: van, lane: 9, ahead_m: 40}\ncar: {kind: car, lane: 1, s_m: 9999}",
            "a: {after: b, do: {bus: {stop: true}}}",
            end="{ego_reaches: {s_m: 9999}}",
        ),
    )
    assert [line.split(": ")[0] for line in lines] == [
        "actors.van.lane",
        "actors.car.s_m",
        "events.a.after",
        "events.a.do.bus",
        "end.ego_reaches.s_m",
    ]


FOG = "{at_s: 5, weather: light_rain, time_of_day: '22:30', friction_factor: 0.5}"


def test_weather_hour_and_road_change_with_an_event(tmp_path):
    program = program_of(tmp_path, scenario_text("", f"fog: {FOG}"))
    (change,) = program.environments
    assert actions_of(program, "ego fog") == [act.EnvironmentAction(0)]
    assert change.minute_of_day == 22 * 60 + 30
    assert change.friction_factor == 0.5
    said = ScriptedEnvironment(
        cloud_fraction=change.cloud_fraction,
        fog_visual_range_m=change.fog_visual_range_m,
        rain_mm_per_h=change.rain_mm_per_h,
        snow_mm_per_h=change.snow_mm_per_h,
        wind_speed_mps=change.wind_speed_mps,
    )
    weather, preset = said.weather(WEATHER["heavy_snow"], "physical"), WEATHER["light_rain"]
    for field in preset.__slots__:
        assert getattr(weather, field) == pytest.approx(getattr(preset, field), rel=1e-4), field


def test_others_act_in_the_same_event(tmp_path):
    event = "both: {at_s: 1, time_of_day: '06:00', do: {van: {stop: true}}}"
    program = program_of(tmp_path, scenario_text(VAN, event))
    assert actions_of(program, "ego both") == [act.EnvironmentAction(0)]
    assert isinstance(actions_of(program, "van both")[0], act.SpeedAction)
    assert program.environments[0].cloud_fraction is None
    assert event_elements(program)["ego both"].start == event_elements(program)["van both"].start


@pytest.mark.parametrize(
    ("event", "words"),
    [
        ("none: {at_s: 1}", "nothing happens: give do, weather, time_of_day, friction_factor or"),
        ("light: {signals: {'0': blue}}", "signals"),
        ("light: {signals: {zero: red}}", "no signal 'zero'; "),
        ("none: {at_s: 1, do: {}}", "nothing happens"),
        ("hail: {weather: hail}", "weather"),
        ("late: {time_of_day: '25:00'}", "time_of_day"),
        ("ice: {friction_factor: -1}", "friction_factor"),
    ],
)
def test_a_change_of_the_sky_that_cannot_be(tmp_path, event, words):
    assert any(words in line for line in mistakes_of(tmp_path, scenario_text("", event)))


def test_traffic_lights_have_states(tmp_path):
    events = (
        "stop: {at_s: 1, signals: {'0': red, '10': green}}\n"
        "go: {at_s: 5, weather: cloudy, signals: {'0': green}}"
    )
    program = program_of(tmp_path, scenario_text("", events, ego=WEST, road="junction"))
    assert [variable.name for variable in program.variables] == ["signal 0", "signal 10"]
    words = [program.words[int(row.value)] for row in actions_of(program, "ego stop")]
    assert words == ["red", "green"]
    weather, light = actions_of(program, "ego go")
    assert weather == act.EnvironmentAction(0)
    assert (light.variable, program.words[int(light.value)]) == (0, "green")
    assert program.words[int(program.variables[0].value)] == ""
