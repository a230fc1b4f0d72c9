"""The state machine of storyboards: triggers, priorities, executions, edges and delays."""

from __future__ import annotations

import pytest
from storyboard_programs import (
    EventPlan,
    GroupPlan,
    at,
    car,
    from_time,
    played,
    program,
    speed_at_once,
    speed_over,
    start_at,
    steps_of,
    trigger,
    when,
)

from twin.scenario.storyboard.player.columns import HISTORY_MAX, TRANSITIONS_MAX
from twin.scenario.storyboard.program.actions import (
    DeleteEntityAction,
    LaneOffsetAction,
    ModifyVariableAction,
    SetVariableAction,
    TeleportAction,
)
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    ConditionEdge,
    ElementState,
    ElementStateCondition,
    SimulationTimeCondition,
    SpeedAxis,
    SpeedCondition,
    TraveledDistanceCondition,
    VariableCondition,
)
from twin.scenario.storyboard.program.program import EventPriority, InitAction, ProgramVariable

PARALLEL, OVERRIDE, SKIP = EventPriority.PARALLEL, EventPriority.OVERRIDE, EventPriority.SKIP
ACTION = 6
"""First action of the first event of the first group in a program of tests."""


def run(events, steps=500, cars=1, speed_mps=10.0, **options):
    entities = [car(f"car{k}") for k in range(cars)]
    init = [action for k in range(cars) for action in start_at(k, at(0.0, 5.0 * k), speed_mps)]
    groups = events if isinstance(events[0], GroupPlan) else [GroupPlan((0,), events)]
    return played(program(entities, init, groups, **options), steps)


def time_is(seconds, rule=ComparisonRule.GREATER_OR_EQUAL):
    return SimulationTimeCondition(seconds, rule)


def test_parents_end_with_their_children():
    done = run([EventPlan(from_time(1.0), [speed_over(2.0, 20.0)])])
    for name in ("g0.e0.a0", "g0.e0", "g0.m", "g0", "act", "story"):
        assert steps_of(done.events, name, "end") == [299]
    assert steps_of(done.events, "g0.e0.a0", "start") == [100]
    assert steps_of(done.events, "storyboard", "end") == []
    assert done.player.running(0)


def test_event_without_trigger_starts_at_once():
    done = run([EventPlan(None, [speed_over(1.0, 20.0)])])
    assert steps_of(done.events, "g0.e0", "start") == [0]
    assert done.speed_mps[1, 0] == pytest.approx(10.1)


def test_what_ends_when_a_slot_begins_triggers_at_the_first_step():
    """The storyboard runs without time at the beginning, then at time 0 again, with time."""
    ended = ElementStateCondition(ACTION, ElementState.END_TRANSITION)
    done = run(
        [
            EventPlan(None, [speed_at_once(12.0)]),
            EventPlan(trigger(when(ended)), [speed_at_once(14.0)]),
            EventPlan(
                trigger(when(ElementStateCondition(ACTION + 2, ElementState.END_TRANSITION))),
                [speed_at_once(16.0)],
            ),
        ]
    )
    assert done.speed_mps[:3, 0].tolist() == [12.0, 14.0, 16.0]
    assert steps_of(done.events, "g0.e1", "start") == [0]
    assert steps_of(done.events, "g0.e2", "start") == [1]


def test_event_without_actions_is_over_at_once():
    done = run([EventPlan(from_time(1.0), [])])
    assert steps_of(done.events, "g0.e0", "end") == [100]


@pytest.mark.parametrize(
    ("priority", "ends", "starts"),
    [(PARALLEL, "end", [200]), (OVERRIDE, "stop", [200]), (SKIP, "end", [400])],
)
def test_priorities(priority, ends, starts):
    """The second event's speed conflicts with the first one's; skipping waits for its end."""
    first = EventPlan(from_time(1.0), [speed_over(3.0, 20.0)])
    second = EventPlan(from_time(2.0), [speed_over(1.0, 5.0)], priority)
    done = run([first, second])
    assert steps_of(done.events, "g0.e1", "start") == starts
    assert steps_of(done.events, "g0.e0", ends) == [399 if priority == SKIP else 200]
    skips = steps_of(done.events, "g0.e1", "skip")
    assert skips == ([200] if priority == SKIP else [])


def test_parallel_events_of_other_domains_go_on():
    done = run(
        [
            EventPlan(from_time(1.0), [speed_over(3.0, 20.0)]),
            EventPlan(from_time(2.0), [SetVariableAction(0, 5.0)]),
        ],
        variables=[ProgramVariable("v", 1.0)],
    )
    assert steps_of(done.events, "g0.e0", "end") == [399]
    assert done.player.variables(0) == {"v": 5.0}


def test_event_runs_again():
    done = run([EventPlan(from_time(3.0), [speed_at_once(20.0)], PARALLEL, 3)])
    assert steps_of(done.events, "g0.e0", "start") == [300, 301, 302]
    assert steps_of(done.events, "g0.e0", "end") == [300, 301, 302]
    assert steps_of(done.events, "g0", "end") == [302]


def test_group_runs_again_and_counts_its_events_anew():
    events = [EventPlan(from_time(1.0), [speed_over(0.5, 20.0)], PARALLEL, 2)]
    done = run([GroupPlan((0,), events, runs=2)])
    assert len(steps_of(done.events, "g0.e0", "start")) == 4
    assert steps_of(done.events, "g0", "start") == [0, steps_of(done.events, "g0", "end")[0] + 1]
    assert len(steps_of(done.events, "act", "end")) == 1


def test_storyboard_stops_everything():
    done = run([EventPlan(from_time(1.0), [speed_over(3.0, 20.0)])], stop=from_time(2.0))
    for name in ("g0.e0.a0", "g0.e0", "g0.m", "g0", "act", "story", "storyboard"):
        assert steps_of(done.events, name, "stop") == [200]
    assert not done.player.running(0)
    assert done.player.steps(0) == 200
    assert len(done.x_m) == 201


def test_act_stops():
    done = run([EventPlan(from_time(1.0), [speed_over(3.0, 20.0)])], act_stop=from_time(2.0))
    assert steps_of(done.events, "act", "stop") == [200]
    assert steps_of(done.events, "story", "end") == [200]
    assert done.speed_mps[-1, 0] == done.speed_mps[200, 0]


@pytest.mark.parametrize(
    ("expression", "edge", "delay", "starts"),
    [
        (time_is(3.0), ConditionEdge.RISING, 0.0, [300]),
        (time_is(3.0), ConditionEdge.RISING, 0.5, [350]),
        (time_is(3.0), ConditionEdge.FALLING, 0.0, []),
        (time_is(3.0, ComparisonRule.LESS), ConditionEdge.FALLING, 0.0, [300]),
        (time_is(3.0, ComparisonRule.LESS), ConditionEdge.EITHER, 0.25, [325]),
        (time_is(3.0, ComparisonRule.EQUAL), ConditionEdge.NONE, 1.0, [400]),
        (time_is(0.0), ConditionEdge.RISING, 0.0, []),
        (time_is(0.0), ConditionEdge.NONE, 0.0, [0]),
        (time_is(3.0, ComparisonRule.GREATER), ConditionEdge.NONE, 0.0, [301]),
        (time_is(3.0, ComparisonRule.NOT_EQUAL), ConditionEdge.NONE, 0.0, [0]),
        (time_is(3.0, ComparisonRule.LESS_OR_EQUAL), ConditionEdge.FALLING, 0.0, [301]),
    ],
)
def test_edges_and_delays(expression, edge, delay, starts):
    done = run(
        [EventPlan(trigger(when(expression, edge=edge, delay_s=delay)), [speed_at_once(1.0)])]
    )
    assert steps_of(done.events, "g0.e0", "start") == starts


def test_all_of_a_group_and_any_group():
    both = (when(time_is(1.0)), when(time_is(2.0, ComparisonRule.LESS)))
    never = (when(time_is(1.0)), when(time_is(1.0, ComparisonRule.LESS)))
    from twin.scenario.storyboard.program.conditions import Trigger

    done = run([EventPlan(Trigger((never, both)), [speed_at_once(1.0)])])
    assert steps_of(done.events, "g0.e0", "start") == [100]
    done = run([EventPlan(Trigger((never, never)), [speed_at_once(1.0)])])
    assert steps_of(done.events, "g0.e0", "start") == []


def test_states_of_elements():
    """A start is seen in the same step by later elements, an end in the next one."""
    state = ElementStateCondition
    done = run(
        [
            EventPlan(from_time(1.0), [speed_over(0.5, 20.0)]),
            EventPlan(
                trigger(when(state(ACTION, ElementState.START_TRANSITION))),
                [SetVariableAction(0, 1.0)],
            ),
            EventPlan(
                trigger(when(state(ACTION, ElementState.END_TRANSITION))), [speed_at_once(1.0)]
            ),
            EventPlan(
                trigger(when(state(ACTION, ElementState.COMPLETE), delay_s=0.2)),
                [speed_at_once(2.0)],
            ),
            EventPlan(
                trigger(when(state(ACTION, ElementState.STOP_TRANSITION))), [speed_at_once(3.0)]
            ),
        ],
        variables=[ProgramVariable("v", 0.0)],
    )
    assert steps_of(done.events, "g0.e1", "start") == [100]
    assert steps_of(done.events, "g0.e2", "start") == [150]
    assert steps_of(done.events, "g0.e3", "start") == [170]
    assert steps_of(done.events, "g0.e4", "start") == []


@pytest.mark.parametrize(("every", "start"), [(False, 100), (True, 200)])
def test_any_and_all_entities(every, start):
    """Cars of 10 and 5 m/s reach 10 m after 1 s and 2 s."""
    condition = when(TraveledDistanceCondition(9.99), 0, 1, every=every)
    groups = [
        GroupPlan((1,), [EventPlan(None, [speed_at_once(5.0)])]),
        GroupPlan((0,), [EventPlan(trigger(condition), [speed_at_once(0.0)])]),
    ]
    done = run(groups, cars=2)
    assert steps_of(done.events, "g1.e0", "start") == [start]


def test_triggering_entities_act():
    condition = when(SpeedCondition(15.0, ComparisonRule.GREATER, SpeedAxis.TOTAL), 0, 1, 2)
    groups = [
        GroupPlan((1, 2), [EventPlan(from_time(1.0), [speed_at_once(20.0)])]),
        GroupPlan((), [EventPlan(trigger(condition), [speed_at_once(3.0)])], triggering=True),
    ]
    done = run(groups, cars=3)
    assert steps_of(done.events, "g1.e0", "start") == [101]
    assert done.speed_mps[-1].tolist() == [10.0, 3.0, 3.0]


def test_variables_trigger():
    trigger_on = trigger(when(VariableCondition(0, 6.0, ComparisonRule.EQUAL)))
    done = run(
        [
            EventPlan(from_time(1.0), [ModifyVariableAction(0, 2.0, 1.0)], PARALLEL, 2),
            EventPlan(trigger_on, [speed_at_once(1.0)]),
        ],
        variables=[ProgramVariable("v", 0.75)],
    )
    assert done.player.variables(0) == {"v": 6.0}
    assert steps_of(done.events, "g0.e1", "start") == [101]


def test_deleted_entities_stay_and_trigger_nothing():
    condition = when(TraveledDistanceCondition(20.0), 0)
    done = run(
        [
            EventPlan(from_time(1.0), [DeleteEntityAction(0)]),
            EventPlan(trigger(condition), [speed_at_once(1.0)]),
        ]
    )
    assert done.x_m[-1, 0] == pytest.approx(10.0)
    assert done.player.states().visible[0, 0] == 0
    assert steps_of(done.events, "g0.e1", "start") == []


def test_conflicts_end_earlier_actions_of_init():
    init = InitAction(speed_over(4.0, 30.0), 0)
    plan = program(
        [car()],
        [*start_at(0, at(0.0), 10.0), init],
        [GroupPlan((0,), [EventPlan(from_time(1.0), [TeleportAction(at(500.0))])])],
    )
    done = played(plan, 200)
    assert done.speed_mps[100, 0] == pytest.approx(15.0)
    assert done.speed_mps[-1, 0] == done.speed_mps[100, 0]
    assert done.x_m[101, 0] == pytest.approx(500.0 + 0.15)


def test_transitions_that_do_not_fit_are_counted():
    runs = TRANSITIONS_MAX // 4 + 10
    done = run([EventPlan(from_time(0.0), [speed_at_once(1.0)], PARALLEL, runs)], steps=runs + 5)
    assert len(done.player.transitions(0)) == TRANSITIONS_MAX
    assert "TRANSITIONS_MAX" in done.player.overflows(0)[0]


def test_changes_that_do_not_fit_a_delay_are_told():
    """A variable that changes each step for longer than the history of a delay."""
    waits = trigger(when(VariableCondition(0, 1.0, ComparisonRule.EQUAL), delay_s=10.0))
    toggles = EventPlan(from_time(0.0), [ModifyVariableAction(0, -1.0, 1.0)], PARALLEL, 100)
    plan = [GroupPlan((0,), [toggles]), GroupPlan((0,), [EventPlan(waits, [speed_at_once(1.0)])])]
    few = run(plan, steps=HISTORY_MAX - 1, variables=[ProgramVariable("v", 0.0)])
    assert few.player.overflows(0) == ()
    many = run(plan, steps=HISTORY_MAX + 3, variables=[ProgramVariable("v", 0.0)])
    assert "HISTORY_MAX" in many.player.overflows(0)[0]


def test_offset_off_roads_does_nothing_to_the_way():
    from twin.scenario.storyboard.program.actions import DynamicsShape

    offset = LaneOffsetAction(DynamicsShape.LINEAR, 1.0, -1, 1.0, False)
    done = run([EventPlan(from_time(1.0), [offset])])
    assert done.y_m[-1, 0] == 0.0
    assert done.x_m[-1, 0] == pytest.approx(50.0)
