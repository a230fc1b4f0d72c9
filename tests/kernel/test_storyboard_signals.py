"""Controllers of traffic signals: which phase they are in at every step, by their durations."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from storyboard_programs import STEP_S, EventPlan, GroupPlan, car, from_time, program, trigger, when

from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.actions import SetVariableAction, SignalPhaseAction
from twin.scenario.storyboard.program.conditions import ConditionEdge, TrafficSignalCondition
from twin.scenario.storyboard.program.program import InitAction, ProgramVariable
from twin.scenario.storyboard.program.signals import SignalController, SignalPhase, SignalState

RED, GREEN, STOP, GO, DARK = (float(number) for number in range(1, 6))
PHASE, LIGHT, COUNT = 0, 1, 2
VARIABLES = (
    ProgramVariable("controller crossing", 0.0, True),
    ProgramVariable("signal light", 0.0, True),
    ProgramVariable("variable count", 0.0),
)


def crossing(*durations_s, delay_s=0.0):
    """Stop (red), then go (green)."""
    states = ((STOP, RED), (GO, GREEN))
    phases = [
        SignalPhase(name, duration_s, (SignalState(LIGHT, light),))
        for (name, light), duration_s in zip(states, durations_s, strict=True)
    ]
    return SignalController("crossing", PHASE, delay_s, tuple(phases))


def lights(controller, steps, events=(), init=(), slots=1):
    """The signal's state in every step from 0 on, and the player."""
    plan = program(
        [car()], list(init), [GroupPlan((0,), list(events))] if events else [], variables=VARIABLES
    )
    plan = replace(plan, controllers=(controller,))
    player = StoryboardPlayer([plan], None, slots, step_s=STEP_S)
    player.start(slots - 1, 0)
    shown = []
    for _ in range(steps):
        # What conditions of the step see: states are shown at its beginning.
        player.step()
        shown.append(player.variables(slots - 1)["signal light"])
    return shown, player


def test_phases_follow_one_another_and_begin_again():
    shown, player = lights(crossing(0.3, 0.2), 130)
    assert shown == [RED if step % 50 < 30 else GREEN for step in range(130)]
    assert player.variables(0)["controller crossing"] == STOP


def test_the_first_phase_shows_before_the_first_step():
    _, player = lights(crossing(0.3, 0.2), 0)
    assert player.variables(0)["signal light"] == RED


def test_a_delay_shifts_the_cycle_which_has_always_run():
    """With a delay of 0.1 s and a cycle of 0.5 s, time 0 is 0.4 s in the cycle before."""
    shown, _ = lights(crossing(0.3, 0.2, delay_s=0.1), 100)
    assert shown == [RED if (step - 10) % 50 < 30 else GREEN for step in range(100)]


def test_times_that_are_no_whole_steps_begin_with_the_next():
    shown, _ = lights(crossing(0.105, 0.1), 60)
    ends = [0.0, 0.105, 0.205, 0.31, 0.41, 0.515]
    begins = [math.ceil(end / STEP_S - 1e-6) for end in ends]
    changes = [0, *(step for step in range(1, 60) if shown[step] != shown[step - 1])]
    assert changes == begins


@pytest.mark.slow
def test_steps_do_not_add_up_errors():
    """After 1000 cycles of a tenth of a second a phase still begins where it must."""
    shown, _ = lights(crossing(0.1, 0.1), 20_000)
    assert shown[19_979:] == [GREEN] + [RED] * 10 + [GREEN] * 10


def test_an_endless_phase_stays():
    shown, _ = lights(crossing(0.2, math.inf), 100)
    assert shown == [RED] * 20 + [GREEN] * 80
    late, _ = lights(crossing(0.2, math.inf, delay_s=0.3), 100)
    assert late == [0.0] * 30 + [RED] * 20 + [GREEN] * 50


def test_an_action_puts_it_into_a_phase_from_which_it_goes_on():
    events = [EventPlan(from_time(0.05), [SignalPhaseAction(0, 1)])]
    shown, _ = lights(crossing(0.3, 0.2), 100, events)
    assert shown == [RED] * 5 + [GREEN] * 20 + [RED] * 30 + [GREEN] * 20 + [RED] * 25


def test_an_action_restarts_the_phase_that_is_on():
    events = [EventPlan(from_time(0.2), [SignalPhaseAction(0, 0)])]
    shown, _ = lights(crossing(0.3, 0.2), 60, events)
    assert shown == [RED] * 50 + [GREEN] * 10


def test_an_action_of_init_counts_from_time_0():
    shown, _ = lights(crossing(0.3, 0.2), 60, init=[InitAction(SignalPhaseAction(0, 1))])
    assert shown == [GREEN] * 20 + [RED] * 30 + [GREEN] * 10


def test_a_state_given_by_hand_stays_until_the_next_phase():
    events = [EventPlan(from_time(0.1), [SetVariableAction(LIGHT, DARK)])]
    shown, _ = lights(crossing(0.3, 0.2), 60, events)
    assert shown == [RED] * 10 + [DARK] * 20 + [GREEN] * 20 + [RED] * 10


def test_conditions_see_a_phase_in_the_step_in_which_it_begins():
    on = trigger(when(TrafficSignalCondition(PHASE, GO), edge=ConditionEdge.RISING))
    events = [EventPlan(on, [SetVariableAction(COUNT, 7.0)])]
    _, player = lights(crossing(0.3, 0.2), 60, events)
    names = [element.name for element in player.programs[0].elements]
    started = [row.step for row in player.transitions(0) if names[row.element] == "g0.e0"]
    assert started[0] == 30


def test_slots_do_not_share_phases():
    alone, _ = lights(crossing(0.3, 0.2), 70)
    among, player = lights(crossing(0.3, 0.2), 70, slots=3)
    assert among == alone
    assert player.variables(0)["signal light"] == 0.0
    player.start(0, 0)
    assert player.variables(0)["signal light"] == RED
    player.step()
    assert player.variables(2)["signal light"] == RED if (70 % 50) < 30 else GREEN
