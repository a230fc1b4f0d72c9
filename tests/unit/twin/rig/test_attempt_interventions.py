"""A hand on a case, at its exact limits."""

import math

import pytest

from schemas.messages import Command, Lights, SensorErrors
from schemas.wire.interventions import (
    GiveBack,
    Pause,
    Query,
    RecordedAction,
    Resume,
    SetEnvironment,
    SetLights,
    SetPace,
    SetSensors,
    Step,
    Takeover,
)
from twin.rig.interventions.case import (
    ANSWERS_MAX,
    DRIVE_SILENCE_S,
    LATE_S,
    PAUSE_SILENCE_S,
    AttemptInterventions,
    told,
)

PERIOD_S = 0.05
COMMAND = Command(0, 1, 7, 0.5, 0.25, 0.1, aeb=True, handbrake=1.0)


def test_a_step_is_exact():
    hand = AttemptInterventions(None)
    hand.take(Pause(), 10, 0.0)
    assert hand.wait_s(10, PERIOD_S, 0.0) == math.inf
    hand.take(Step(3), 10, 0.0)
    assert [hand.wait_s(tick, PERIOD_S, 0.0) for tick in (12, 13)] == [0.0, math.inf]
    hand.take(Resume(), 13, 0.0)
    assert hand.wait_s(13, PERIOD_S, 0.0) == 0.0
    assert (hand.changes, hand.timed) == (0, False)


def test_a_pace_is_kept_and_not_caught_up():
    hand = AttemptInterventions(None)
    hand.take(SetPace(2.0), 10, 100.0)
    assert hand.wait_s(10, PERIOD_S, 100.0) == 0.0
    assert hand.wait_s(14, PERIOD_S, 100.0) == pytest.approx(0.1)
    assert hand.wait_s(14, PERIOD_S, 100.1 + LATE_S) == pytest.approx(-LATE_S)
    late_s = 100.2 + LATE_S
    assert hand.wait_s(14, PERIOD_S, late_s) < 0.0
    assert hand.wait_s(18, PERIOD_S, late_s) == pytest.approx(0.1), "from then on, not from 100 s"
    hand.take(SetPace(None), 18, late_s)
    assert not hand.timed


def test_a_takeover_runs_in_real_time_and_ends_in_silence():
    hand = AttemptInterventions(None)
    hand.take(Takeover(throttle=0.3), 0, 50.0)
    hand.wait_s(0, PERIOD_S, 50.0)
    assert hand.wait_s(2, PERIOD_S, 50.0) == pytest.approx(0.1)
    assert hand.overdue(50.0 + DRIVE_SILENCE_S - 0.001) is None
    assert hand.overdue(50.0 + DRIVE_SILENCE_S) == GiveBack()
    hand.take(Pause(), 5, 51.0)
    assert hand.overdue(51.0 + DRIVE_SILENCE_S) is None, "while it stands, hands may rest"
    hand.take(Resume(), 5, 90.0)
    assert hand.overdue(90.0 + DRIVE_SILENCE_S - 0.001) is None
    hand.take(GiveBack(), 6, 91.0)
    assert (hand.drive, hand.changes, hand.label()) == (None, 2, "steered")


def test_a_pause_that_everybody_forgot_ends():
    hand = AttemptInterventions(None)
    hand.take(Pause(), 1, 10.0)
    assert hand.label() == "paused"
    assert hand.overdue(10.0 + PAUSE_SILENCE_S - 0.001) is None
    assert hand.overdue(10.0 + PAUSE_SILENCE_S) == Resume()
    hand.take(Query(), 1, 10.0 + PAUSE_SILENCE_S - 0.001)
    assert hand.overdue(10.0 + PAUSE_SILENCE_S) == Resume(), "who only looks holds nothing"


def test_what_a_journal_says_needs_nobody_and_no_clock():
    hand = AttemptInterventions(None, replay=[RecordedAction(3, 0, Takeover(0.1))], replayed=True)
    assert hand.timed
    hand.take(hand.replay.pop().action, 3, 0.0)
    assert hand.wait_s(1000, PERIOD_S, 0.0) == 0.0
    assert hand.overdue(1e9) is None


def test_commands_are_those_of_the_hand_and_all_else_of_the_stack():
    hand = AttemptInterventions(None)
    assert not hand.commands
    hand.take(Takeover(0.0, 1.0, -0.2), 7, 0.0)
    hand.take(SetLights(Lights(fog=True)), 7, 0.0)
    hand.take(SetSensors(SensorErrors(imu_noise=2.0)), 7, 0.0)
    expected = Command(
        *(0, 1, 7, 0.0, 1.0, -0.2),
        lights=Lights(fog=True),
        sensors=SensorErrors(imu_noise=2.0),
    )
    assert hand.changed(COMMAND) == expected
    assert hand.changed(COMMAND).sensors is None, "told once, as by a stack"
    hand.take(GiveBack(), 8, 0.0)
    hand.take(SetLights(None), 8, 0.0)
    assert not hand.commands
    assert hand.changed(COMMAND) == COMMAND


def test_answers_are_kept_but_not_for_ever():
    hand = AttemptInterventions(None)
    for number in range(ANSWERS_MAX + 1):
        hand.remember(str(number), b"")
    assert list(hand.answers) == [str(n) for n in range(1, ANSWERS_MAX + 1)]


def test_actions_in_words():
    assert told(SetEnvironment("heavy_fog", time_of_day_min=1350.0)) == (
        "environment weather=heavy_fog time_of_day_min=1350"
    )
    assert (
        told(SetLights(Lights(low=True, indicators=2))) == "lights lights=(low=True indicators=2)"
    )
    assert told(Takeover(0.3)) == "takeover"
    assert told(SetPace(None)) == "pace"


def test_a_takeover_paces_nothing_where_the_clock_does():
    paced, clocked = AttemptInterventions(None), AttemptInterventions(None, clocked=True)
    for hand in (paced, clocked):
        hand.take(Takeover(0.5), 10, 100.0)
        hand.wait_s(10, PERIOD_S, 100.0)
    assert paced.wait_s(11, PERIOD_S, 100.0) == pytest.approx(PERIOD_S)
    assert clocked.wait_s(11, PERIOD_S, 100.0) == 0.0
