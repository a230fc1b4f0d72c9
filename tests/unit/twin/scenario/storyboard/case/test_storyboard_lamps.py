"""Which lamps of bodies shine, from what a scenario has switched and how they move."""

from __future__ import annotations

import numpy as np
import pytest

from twin.actors.lamps import VehicleLamp
from twin.scenario.storyboard.case.lamps import LampsShown, SlotLamps
from twin.scenario.storyboard.case.signals import ProgramSignals
from twin.scenario.storyboard.program.actions import LIGHTS, LampMode, LightAction
from twin.scenario.storyboard.program.program import Program, ProgramVariable
from twin.scenario.storyboard.program.signal_states import AMBER, GREEN, RED, lamps_of_state

STEP_S = 0.01


def bits(*lamps: VehicleLamp) -> int:
    return sum(1 << lamp for lamp in lamps)


def mode_of(**modes: LampMode) -> int:
    return sum(mode << 2 * LIGHTS.index(name) for name, mode in modes.items())


def shown(
    modes: int,
    lamps: SlotLamps | None = None,
    step: int = 0,
    *,
    slows: bool = False,
    backwards: bool = False,
    lit: bool = True,
) -> LampsShown:
    """Of one body in one slot."""
    lamps = lamps or SlotLamps(1, 1, STEP_S)
    flags = (np.array([[flag]]) for flag in (lit, slows, backwards))
    return lamps.shown(np.array([[modes]]), *flags, np.array([step]))


def test_without_a_word_lamps_follow_the_motion():
    usual = shown(0)
    assert (usual.lamps[0, 0], usual.brake[0, 0], usual.lights[0, 0]) == (True, False, 0)
    assert shown(0, slows=True).brake[0, 0]
    assert shown(0, backwards=True).lights[0, 0] == bits(VehicleLamp.REVERSING)


@pytest.mark.parametrize(
    ("name", "lamps"),
    [
        ("daytimeRunningLights", (VehicleLamp.HEAD,)),
        ("lowBeam", (VehicleLamp.HEAD, VehicleLamp.TAIL)),
        ("highBeam", (VehicleLamp.HEAD, VehicleLamp.TAIL, VehicleLamp.HIGH_BEAM)),
        ("fogLights", (VehicleLamp.FOG_FRONT, VehicleLamp.FOG_REAR)),
        ("fogLightsFront", (VehicleLamp.FOG_FRONT,)),
        ("fogLightsRear", (VehicleLamp.FOG_REAR,)),
        ("warningLights", (VehicleLamp.INDICATOR_LEFT, VehicleLamp.INDICATOR_RIGHT)),
        ("indicatorLeft", (VehicleLamp.INDICATOR_LEFT,)),
        ("indicatorRight", (VehicleLamp.INDICATOR_RIGHT,)),
        ("reversingLights", (VehicleLamp.REVERSING,)),
        ("brakeLights", ()),
        ("licensePlateIllumination", ()),
        ("specialPurposeLights", ()),
    ],
)
def test_every_lamp_of_the_standard_that_is_on(name, lamps):
    assert shown(mode_of(**{name: LampMode.ON})).lights[0, 0] == bits(*lamps)


def test_a_lamp_that_is_off_is_off_whatever_the_body_does():
    off = mode_of(brakeLights=LampMode.OFF, reversingLights=LampMode.OFF, lowBeam=LampMode.OFF)
    dark = shown(off, slows=True, backwards=True)
    assert (dark.lamps[0, 0], dark.brake[0, 0], dark.lights[0, 0]) == (False, False, 0)
    assert shown(mode_of(brakeLights=LampMode.ON)).brake[0, 0]


def test_bodies_without_lamps_have_none():
    modes = mode_of(highBeam=LampMode.ON, brakeLights=LampMode.ON)
    none = shown(modes, lit=False, slows=True, backwards=True)
    assert (none.lamps[0, 0], none.brake[0, 0], none.lights[0, 0]) == (False, False, 0)


def test_a_lamp_flashes_from_its_action_on_by_its_own_times():
    lamps = SlotLamps(2, 1, STEP_S)
    left = LIGHTS.index("indicatorLeft")
    lamps.switch(1, 0, LightAction(left, LampMode.FLASHING, 0.3, 0.2), 7)
    modes = np.array([[0], [mode_of(indicatorLeft=LampMode.FLASHING)]])
    flags = np.ones((2, 1), np.bool_), np.zeros((2, 1), np.bool_), np.zeros((2, 1), np.bool_)
    on = [
        bool(lamps.shown(modes, *flags, np.array([0, step])).lights[1, 0])
        for step in range(7, 7 + 150)
    ]
    assert on == ([True] * 30 + [False] * 20) * 3
    lamps.begin(1)  # the next case starts with phases of its own
    lamps.switch(1, 0, LightAction(left, LampMode.FLASHING, 0.1, 0.0), 0)
    assert all(lamps.shown(modes, *flags, np.array([0, step])).lights[1, 0] for step in range(40))


def test_times_of_nothing_at_all_are_dark():
    lamps = SlotLamps(1, 1, STEP_S)
    left = LIGHTS.index("indicatorLeft")
    lamps.switch(0, 0, LightAction(left, LampMode.FLASHING, 0.0, 0.0), 0)
    modes = mode_of(indicatorLeft=LampMode.FLASHING)
    assert [shown(modes, lamps, step).lights[0, 0] for step in range(5)] == [0] * 5


@pytest.mark.parametrize(
    ("word", "lamps"),
    [
        ("red", RED),
        ("Green", GREEN),
        ("yellow", AMBER),
        ("amber", AMBER),
        ("red_amber", RED | AMBER),
        ("on;off;off", RED),
        ("off;off;on", GREEN),
        ("off;flashing;off", AMBER),
        ("on", RED),
        ("off", 0),
        ("", 0),
        ("on;on;on;on", None),
        ("walk", None),
        ("red walk", None),
    ],
)
def test_words_for_the_state_of_a_signal(word, lamps):
    assert lamps_of_state(word) == lamps


def test_signals_of_the_world_have_the_states_of_the_program():
    program = Program(
        "lights",
        (),
        (),
        (),
        variables=(
            ProgramVariable("variable b", 1.0, text=True),
            ProgramVariable("signal b", 2.0, text=True),
        ),
        words=("", "red", "green", "unknown"),
    )
    signals = ProgramSignals(program, ("a", "b", "c"))
    assert signals.columns.tolist() == [1]
    assert signals.lamps(np.array([1.0, 2.0, 99.0])).tolist() == [GREEN]
    assert signals.lamps(np.array([1.0, 3.0])).tolist() == [0]
    assert ProgramSignals(program, ()).columns.tolist() == []
