"""Controllers of traffic signals, trailers and free lanes from files, and what is wrong there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import ROADS, VEHICLE, by_entity, compiled, scenario_text

from twin.scenario.storyboard.check_program import program_mistakes
from twin.scenario.storyboard.openscenario.outline import outline
from twin.scenario.storyboard.openscenario.scenario import read_scenario
from twin.scenario.storyboard.program.actions import (
    ConnectTrailerAction,
    DisconnectTrailerAction,
    SignalPhaseAction,
)
from twin.scenario.storyboard.program.conditions import (
    LaneRange,
    RelativeClearanceCondition,
    TrafficSignalCondition,
)

PHASES = (
    '<Phase name="stop" duration="3"><TrafficSignalState trafficSignalId="light" state="red"/>'
    '</Phase><Phase name="go" duration="2"><TrafficSignalState trafficSignalId="light" '
    'state="green"/></Phase>'
)
ROAD = '<LogicFile filepath="roads.xodr"/>'


def with_controllers(inner: str, **changes: str) -> str:
    """A scenario whose road network has controllers of signals, on line 3."""
    text = scenario_text(**changes)
    return text.replace(ROAD, f"{ROAD}\n<TrafficSignals>{inner}</TrafficSignals>")


def controller(name: str, attributes: str = "", phases: str = PHASES) -> str:
    return f'<TrafficSignalController name="{name}" {attributes}>{phases}</TrafficSignalController>'


PUT = (
    "<GlobalAction><InfrastructureAction><TrafficSignalAction><TrafficSignalControllerAction "
    'trafficSignalControllerRef="{}" phase="{}"/></TrafficSignalAction></InfrastructureAction>'
    "</GlobalAction>"
)
IN_PHASE = (
    '<ByValueCondition><TrafficSignalControllerCondition trafficSignalControllerRef="{}" '
    'phase="{}"/></ByValueCondition>'
)


def test_controllers(tmp_path: Path) -> None:
    chain = (
        controller("third", 'delay="0.5" reference="second"')
        + controller("first")
        + controller("second", 'delay="1.5" reference="first"')
    )
    result = compiled(
        tmp_path,
        with_controllers(
            chain, action=PUT.format("first", "go"), condition=IN_PHASE.format("second", "stop")
        ),
    )
    program = result.program
    assert result.notes == ()
    assert [item.name for item in program.controllers] == ["third", "first", "second"]
    assert [item.delay_s for item in program.controllers] == [2.0, 0.0, 1.5]
    first = program.controllers[1]
    words = {program.words[int(phase.name)]: phase for phase in first.phases}
    assert [(name, phase.duration_s) for name, phase in words.items()] == [("stop", 3), ("go", 2)]
    (state,) = words["go"].states
    assert program.variables[state.variable].name == "signal light"
    assert program.words[int(state.value)] == "green"
    (event,) = [item for item in program.elements if item.start is not None]
    ((condition,),) = event.start.groups
    assert condition.expression == TrafficSignalCondition(
        program.controllers[2].variable, words["stop"].name
    )
    assert program.elements[-1].action == SignalPhaseAction(1, 1)
    assert program_mistakes(program) == []


def test_a_controller_without_phases_is_noted(tmp_path: Path) -> None:
    result = compiled(tmp_path, with_controllers(controller("idle", phases="")))
    assert result.program.controllers == ()
    assert "it has no phases" in result.notes[0]


GROUP = '<Phase name="p" duration="1"><TrafficSignalGroupState state="off;on"/></Phase>'


def test_states_of_groups(tmp_path: Path) -> None:
    """The controller of the same id in the road file says which signals they are."""
    signals = '<controller id="a"><control signalId="light" type="0"/></controller></OpenDRIVE>'
    roads = ROADS.replace("</OpenDRIVE>", signals)
    program = compiled(tmp_path, with_controllers(controller("a", phases=GROUP)), roads).program
    (phase,) = program.controllers[0].phases
    (state,) = phase.states
    assert program.variables[state.variable].name == "signal light"
    assert program.words[int(state.value)] == "off;on"
    stray = roads.replace('"light" type="0"', '"lamp" type="0"')
    with pytest.raises(ValueError, match="the road network has no signal 'lamp'"):
        compiled(tmp_path, with_controllers(controller("a", phases=GROUP)), stray)


BROKEN_SIGNALS = {
    "no such signal": (
        controller("a", phases=PHASES.replace("light", "lamp", 1)),
        "the road network has no signal 'lamp'",
    ),
    "no time": (controller("a", phases=PHASES.replace('"3"', '"0"').replace('"2"', '"0"')), "time"),
    "negative": (controller("a", phases=PHASES.replace('"3"', '"-1"')), "duration is -1 s"),
    "delay alone": (controller("a", 'delay="2"'), "a delay needs a reference"),
    "negative delay": (controller("a", 'delay="-2"'), "delay is -2 s"),
    "no such reference": (controller("a", 'delay="2" reference="b"'), "no controller is named 'b'"),
    "circle": (
        controller("a", 'delay="2" reference="b"') + controller("b", 'delay="2" reference="a"'),
        "controllers a, b refer to one another",
    ),
    "group": (
        controller("a", phases=GROUP),
        "the road network has no controller 'a' with signals",
    ),
}


@pytest.mark.parametrize("name", BROKEN_SIGNALS)
def test_broken_controllers(tmp_path: Path, name: str) -> None:
    inner, words = BROKEN_SIGNALS[name]
    with pytest.raises(ValueError, match=re.escape(words)) as failure:
        compiled(tmp_path, with_controllers(inner))
    assert str(failure.value).startswith(f"{tmp_path}/s.xosc:3: ")


def test_a_phase_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no phase is named 'gone'"):
        compiled(tmp_path, with_controllers(controller("a"), action=PUT.format("a", "gone")))
    with pytest.raises(ValueError, match="no traffic signal controller is named 'b'"):
        compiled(tmp_path, with_controllers(controller("a"), action=PUT.format("b", "go")))


def towing(hitch: str = '<TrailerHitch dx="-1.2"/>', held: str = "") -> str:
    """A truck with a trailer in it."""
    coupler = '<TrailerCoupler dx="4.5"/>'
    if not held:
        trailer = VEHICLE.format(category="trailer").replace("</Vehicle>", f"{coupler}</Vehicle>")
        held = f'<Trailer><Trailer name="Box">{trailer}</Trailer></Trailer>'
    truck = VEHICLE.format(category="truck").replace("</Vehicle>", f"{hitch}{held}</Vehicle>")
    return f'<ScenarioObject name="Truck">{truck}</ScenarioObject>'


def test_a_trailer_written_into_its_tractor(tmp_path: Path) -> None:
    result = compiled(tmp_path, scenario_text(entities=towing()))
    entities = result.program.entities
    assert [entity.name for entity in entities] == ["Ego", "Other", "Truck", "Box"]
    assert entities[2].hitch_x_m == -1.2
    assert (entities[3].coupler_x_m, entities[3].tractor) == (4.5, 2)
    assert [entity.tractor for entity in entities[:3]] == [-1, -1, -1]
    assert program_mistakes(result.program) == []


def loose(name: str = "Box", coupler: str = '<TrailerCoupler dx="4.5"/>') -> str:
    trailer = VEHICLE.format(category="trailer").replace("</Vehicle>", f"{coupler}</Vehicle>")
    return f'<ScenarioObject name="{name}">{trailer}</ScenarioObject>'


def test_a_trailer_that_is_referred_to(tmp_path: Path) -> None:
    reference = '<Trailer><TrailerRef entityRef="Box"/></Trailer>'
    result = compiled(tmp_path, scenario_text(entities=loose() + towing(held=reference)))
    assert [entity.tractor for entity in result.program.entities] == [-1, -1, 3, -1]


COUPLE = "<PrivateAction><TrailerAction>{}</TrailerAction></PrivateAction>"


def test_couplings(tmp_path: Path) -> None:
    connect = COUPLE.format('<ConnectTrailerAction trailerRef="Box"/>')
    text = scenario_text(entities=loose() + towing(held=" "), action=connect)
    text = text.replace(
        '<EntityRef entityRef="Ego"/></Actors>', '<EntityRef entityRef="Truck"/></Actors>'
    )
    assert compiled(tmp_path, text).program.elements[-1].action == ConnectTrailerAction(2)
    let_go = text.replace('<ConnectTrailerAction trailerRef="Box"/>', "<DisconnectTrailerAction/>")
    assert compiled(tmp_path, let_go).program.elements[-1].action == DisconnectTrailerAction()


REFERENCE = '<Trailer><TrailerRef entityRef="{}"/></Trailer>'
BROKEN_TRAILERS = {
    "no hitch": (towing(hitch=""), "Truck has no TrailerHitch"),
    "no coupler": (
        loose(coupler="") + towing(held=REFERENCE.format("Box")),
        "Box has no TrailerCoupler",
    ),
    "behind its axle": (loose(coupler='<TrailerCoupler dx="0"/>'), "dx is 0 m"),
    "itself": (
        towing('<TrailerHitch dx="-1"/><TrailerCoupler dx="2"/>', REFERENCE.format("Truck")),
        "Truck would tow itself",
    ),
    "two hitches": (
        loose()
        + towing(held=REFERENCE.format("Box"))
        + towing(held=REFERENCE.format("Box")).replace('"Truck"', '"Truck2"'),
        "Box hangs on two hitches",
    ),
    "name twice": (towing() + loose(), "the name 'Box' is given to a second entity"),
    "nobody": (towing(held=REFERENCE.format("Nobody")), "no entity is named 'Nobody'"),
}


@pytest.mark.parametrize("name", BROKEN_TRAILERS)
def test_broken_trailers(tmp_path: Path, name: str) -> None:
    entities, words = BROKEN_TRAILERS[name]
    with pytest.raises(ValueError, match=re.escape(words)) as failure:
        compiled(tmp_path, scenario_text(entities=entities))
    assert str(failure.value).startswith(f"{tmp_path}/s.xosc:")


def test_an_actor_without_a_hitch_couples_nothing(tmp_path: Path) -> None:
    connect = COUPLE.format('<ConnectTrailerAction trailerRef="Box"/>')
    with pytest.raises(ValueError, match="Ego has no TrailerHitch"):
        compiled(tmp_path, scenario_text(entities=loose(), action=connect))


CLEAR = (
    '<RelativeClearanceCondition oppositeLanes="false" freeSpace="true" distanceForward="30" {}>{}'
    "</RelativeClearanceCondition>"
)


def test_free_lanes(tmp_path: Path) -> None:
    inner = (
        '<RelativeLaneRange from="1" to="2"/><RelativeLaneRange to="-1"/>'
        '<EntityRef entityRef="Other"/>'
    )
    condition = by_entity(CLEAR.format('distanceBackward="20"', inner))
    program = compiled(tmp_path, scenario_text(condition=condition)).program
    (event,) = [item for item in program.elements if item.start is not None]
    ((when,),) = event.start.groups
    assert when.expression == RelativeClearanceCondition(
        30.0, 20.0, True, False, (1,), (LaneRange(1, 2), LaneRange(-1000, -1))
    )
    assert program_mistakes(program) == []


@pytest.mark.parametrize(
    ("attributes", "inner", "words"),
    [
        ('distanceBackward="-1"', "", "distances must be 0 or more"),
        ("", '<RelativeLaneRange from="2" to="1"/>', "from 2 is above to 1"),
        ("", '<EntityRef entityRef="Nobody"/>', "no entity is named 'Nobody'"),
    ],
)
def test_broken_free_lanes(tmp_path: Path, attributes: str, inner: str, words: str) -> None:
    condition = by_entity(CLEAR.format(attributes, inner))
    with pytest.raises(ValueError, match=words):
        compiled(tmp_path, scenario_text(condition=condition))


def test_free_lanes_need_roads(tmp_path: Path) -> None:
    text = scenario_text(condition=by_entity(CLEAR.format("", ""))).replace(ROAD, "")
    with pytest.raises(ValueError, match="no road network"):
        compiled(tmp_path, text)


def test_the_outline_tells_of_trains_and_phases(tmp_path: Path) -> None:
    reference = '<Trailer><TrailerRef entityRef="Box"/></Trailer>'
    for entities, words in (
        (towing(), ["entity Truck: Vehicle car", "entity Box: Vehicle car, towed by Truck"]),
        (loose() + towing(held=reference), ["entity Truck: Vehicle car", "entity Truck tows Box"]),
    ):
        path = tmp_path / "s.xosc"
        text = with_controllers(controller("a"), entities=entities)
        (tmp_path / "roads.xodr").write_text(ROADS)
        path.write_text(text)
        lines = outline(read_scenario(path), [])
        assert [line for line in lines if line in words] == words
        assert "traffic signal controller a: stop 3 s, go 2 s" in lines
