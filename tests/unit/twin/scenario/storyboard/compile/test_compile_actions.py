"""Actions: the record of each, with every attribute that has an effect, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import compiled, scenario_text

from twin.scenario.storyboard.program.actions import (
    Action,
    AddEntityAction,
    CommandAction,
    ControllerAction,
    DeleteEntityAction,
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    FinalSpeedKind,
    LaneChangeAction,
    LaneOffsetAction,
    LateralDistanceAction,
    LongitudinalDistanceAction,
    ModifyVariableAction,
    MotionLimits,
    SetVariableAction,
    SpeedAction,
    SpeedProfileAction,
    SpeedProfileEntry,
    SteadyStateKind,
    SynchronizeAction,
    TransitionDynamics,
    VisibilityAction,
)
from twin.scenario.storyboard.program.conditions import DistanceFrame
from twin.scenario.storyboard.program.places import FixedPosition

BEFORE = (
    '<ParameterDeclarations><ParameterDeclaration name="p" parameterType="double" value="1"/>'
    '<ParameterDeclaration name="word" parameterType="string" value="a"/></ParameterDeclarations>'
    '<VariableDeclarations><VariableDeclaration name="v" variableType="double" value="2"/>'
    "</VariableDeclarations>"
    '<MonitorDeclarations><MonitorDeclaration name="m" value="false"/></MonitorDeclarations>'
)
PLACE = '<Position><WorldPosition x="5" y="-1.75"/></Position>'
LIMITS = (
    '<DynamicConstraints maxAcceleration="1" maxDeceleration="2" maxSpeed="3" '
    'maxAccelerationRate="4" maxDecelerationRate="5"/>'
)
ALL_LIMITS = MotionLimits(1.0, 2.0, 3.0, 4.0, 5.0)
CUBIC = TransitionDynamics(DynamicsShape.CUBIC, DynamicsDimension.DISTANCE, 30.0)
_CUBIC = 'dynamicsShape="cubic" dynamicsDimension="distance" value="30"'


def _longitudinal(inner: str) -> str:
    return f"<PrivateAction><LongitudinalAction>{inner}</LongitudinalAction></PrivateAction>"


def _lateral(inner: str) -> str:
    return f"<PrivateAction><LateralAction>{inner}</LateralAction></PrivateAction>"


def _controller(inner: str) -> str:
    return f"<PrivateAction><ControllerAction>{inner}</ControllerAction></PrivateAction>"


def _globally(inner: str) -> str:
    return f"<GlobalAction>{inner}</GlobalAction>"


def _synchronized(final: str) -> str:
    places = f"<TargetPositionMaster>{PLACE[10:-11]}</TargetPositionMaster>"
    places += f"<TargetPosition>{PLACE[10:-11]}</TargetPosition>"
    return (
        '<PrivateAction><SynchronizeAction masterEntityRef="Other" targetToleranceMaster="0.5" '
        f'targetTolerance="0.25">{places}<FinalSpeed>{final}</FinalSpeed></SynchronizeAction>'
        "</PrivateAction>"
    )


def _modify(rule: str) -> str:
    return f'<ModifyAction><Rule><{rule} value="3"/></Rule></ModifyAction>'


def _variable(kind: str, name: str, inner: str) -> str:
    action = f'<{kind}Action {kind.lower()}Ref="{name}">{inner}</{kind}Action>'
    return _globally(action)


ACTIONS: list[tuple[str, Action]] = [
    (
        _longitudinal(
            f"<SpeedAction><SpeedActionDynamics {_CUBIC}/><SpeedActionTarget>"
            '<RelativeTargetSpeed entityRef="Other" value="1.5" speedTargetValueType="factor" '
            'continuous="false"/></SpeedActionTarget></SpeedAction>'
        ),
        SpeedAction(CUBIC, 1, 1.5, factor=True, continuous=False),
    ),
    (
        _longitudinal(
            f'<SpeedProfileAction entityRef="Other" followingMode="follow">{LIMITS}'
            '<SpeedProfileEntry speed="7" time="2"/><SpeedProfileEntry speed="9"/>'
            "</SpeedProfileAction>"
        ),
        SpeedProfileAction(
            1, (SpeedProfileEntry(7.0, 2.0), SpeedProfileEntry(9.0, -1.0)), True, ALL_LIMITS
        ),
    ),
    (
        _longitudinal(
            '<LongitudinalDistanceAction entityRef="Other" timeGap="1.5" freespace="true" '
            'continuous="true" coordinateSystem="road" displacement="leadingReferencedEntity">'
            f"{LIMITS}</LongitudinalDistanceAction>"
        ),
        LongitudinalDistanceAction(
            *(1, 1.5, True, True, True, DistanceFrame.ROAD, Displacement.AHEAD, ALL_LIMITS)
        ),
    ),
    (
        _lateral(
            f'<LaneChangeAction targetLaneOffset="0.3"><LaneChangeActionDynamics {_CUBIC}/>'
            '<LaneChangeTarget><AbsoluteTargetLane value="-2"/></LaneChangeTarget>'
            "</LaneChangeAction>"
        ),
        LaneChangeAction(CUBIC, -1, -2, 0.3),
    ),
    (
        _lateral(
            f"<LaneChangeAction><LaneChangeActionDynamics {_CUBIC}/><LaneChangeTarget>"
            '<RelativeTargetLane entityRef="Other" value="1"/></LaneChangeTarget>'
            "</LaneChangeAction>"
        ),
        LaneChangeAction(CUBIC, 1, 1, 0.0),
    ),
    (
        _lateral(
            '<LaneOffsetAction continuous="true"><LaneOffsetActionDynamics '
            'dynamicsShape="sinusoidal" maxLateralAcc="2.5"/><LaneOffsetTarget>'
            '<RelativeTargetLaneOffset entityRef="Other" value="-0.5"/></LaneOffsetTarget>'
            "</LaneOffsetAction>"
        ),
        LaneOffsetAction(DynamicsShape.SINUSOIDAL, 2.5, 1, -0.5, True),
    ),
    (
        _lateral(
            '<LateralDistanceAction entityRef="Other" distance="2" freespace="true" '
            'continuous="false" coordinateSystem="lane" displacement="rightToReferencedEntity">'
            f"{LIMITS}</LateralDistanceAction>"
        ),
        LateralDistanceAction(
            *(1, 2.0, True, False, DistanceFrame.LANE, Displacement.BEHIND, ALL_LIMITS)
        ),
    ),
    (
        "<PrivateAction><VisibilityAction graphics='false' sensors='true' traffic='false'/>"
        "</PrivateAction>",
        VisibilityAction(graphics=False, sensors=True, traffic=False),
    ),
    (
        _controller('<ActivateControllerAction lateral="false" longitudinal="true"/>'),
        ControllerAction(lateral=False, longitudinal=True),
    ),
    (
        _controller(
            '<AssignControllerAction activateLateral="true" activateLongitudinal="false">'
            '<Controller name="c"><Properties/></Controller></AssignControllerAction>'
        ),
        ControllerAction(lateral=True, longitudinal=False),
    ),
    (
        _globally(
            '<EntityAction entityRef="Other"><AddEntityAction><Position><LanePosition roadId="a" '
            'laneId="-1" s="50"/></Position></AddEntityAction></EntityAction>'
        ),
        AddEntityAction(
            1, FixedPosition(50.0, -1.75, 0.0, 0.0, road=0, s_m=50.0, t_m=-1.75, lane=-1)
        ),
    ),
    (
        _globally('<EntityAction entityRef="Other"><DeleteEntityAction/></EntityAction>'),
        DeleteEntityAction(1),
    ),
    (_variable("Parameter", "p", '<SetAction value="7"/>'), SetVariableAction(0, 7.0)),
    (
        _variable("Parameter", "p", _modify("AddValue")),
        ModifyVariableAction(0, 1.0, 3.0),
    ),
    (
        _variable("Parameter", "p", _modify("MultiplyByValue")),
        ModifyVariableAction(0, 3.0, 0.0),
    ),
    (_variable("Variable", "v", '<SetAction value="7"/>'), SetVariableAction(2, 7.0)),
    (
        _variable("Variable", "v", _modify("AddValue")),
        ModifyVariableAction(2, 1.0, 3.0),
    ),
    (
        _variable("Variable", "v", _modify("MultiplyByValue")),
        ModifyVariableAction(2, 3.0, 0.0),
    ),
    (_globally('<SetMonitorAction monitorRef="m" value="true"/>'), SetVariableAction(3, 1.0)),
    (
        "<UserDefinedAction><CustomCommandAction type='horn'>loud</CustomCommandAction>"
        "</UserDefinedAction>",
        CommandAction("horn loud"),
    ),
]


@pytest.mark.parametrize(("text", "expected"), ACTIONS)
def test_the_record_of_an_action(tmp_path: Path, text: str, expected: Action) -> None:
    program = compiled(tmp_path, scenario_text(action=text, before=BEFORE)).program
    assert program.elements[-1].action == expected


@pytest.mark.parametrize(
    ("final", "expected"),
    [
        (
            '<AbsoluteSpeed value="9"><TargetDistanceSteadyState distance="12"/></AbsoluteSpeed>',
            (FinalSpeedKind.ABSOLUTE, 9.0, SteadyStateKind.DISTANCE, 12.0),
        ),
        (
            '<RelativeSpeedToMaster value="-2" speedTargetValueType="delta">'
            '<TargetTimeSteadyState time="3"/></RelativeSpeedToMaster>',
            (FinalSpeedKind.RELATIVE_TO_MASTER, -2.0, SteadyStateKind.TIME, 3.0),
        ),
    ],
)
def test_an_arrival_with_its_final_speed(tmp_path: Path, final: str, expected: tuple) -> None:
    program = compiled(tmp_path, scenario_text(action=_synchronized(final))).program
    action = program.elements[-1].action
    assert isinstance(action, SynchronizeAction)
    got = action.final_speed, action.final_speed_mps, action.steady_state, action.steady_state_value
    assert got == expected
    assert (action.master, action.tolerance_master_m, action.tolerance_m) == (1, 0.5, 0.25)


LIGHT = (
    "<PrivateAction><AppearanceAction><LightStateAction>{}</LightStateAction></AppearanceAction>"
    "</PrivateAction>"
)
NOTED = [
    (
        _controller('<ActivateControllerAction controllerRef="c" lateral="true"/>'),
        "ActivateControllerAction: controllerRef has no effect",
    ),
    (
        _controller('<ActivateControllerAction objectControllerRef="c" lateral="true"/>'),
        "ActivateControllerAction: objectControllerRef has no effect",
    ),
    (
        _controller('<ActivateControllerAction lighting="true"/>'),
        "ActivateControllerAction: lighting has no effect: it is not controlled by controllers",
    ),
    (
        _controller(
            '<AssignControllerAction activateLighting="true" activateAnimation="true">'
            '<Controller name="c"><Properties/></Controller></AssignControllerAction>'
        ),
        "AssignControllerAction: activateLighting has no effect",
    ),
    (
        LIGHT.format(
            '<LightType><VehicleLight vehicleLightType="fogLights"/></LightType><LightState '
            'mode="on" luminousIntensity="9"><Color colorType="other"><ColorRgb red="1" green="0" '
            'blue="0"/></Color></LightState>'
        ),
        "Color: no effect: lamps have the colour of their kind",
    ),
    (
        "<UserDefinedAction><CustomCommandAction type='horn'/></UserDefinedAction>",
        "CustomCommandAction: the command is noted as an event and does nothing else",
    ),
]


@pytest.mark.parametrize(("text", "words"), NOTED)
def test_what_has_no_effect_is_noted(tmp_path: Path, text: str, words: str) -> None:
    notes = compiled(tmp_path, scenario_text(action=text)).notes
    assert any(f"s.xosc:6: {words}" in note for note in notes), notes


ON_ROUTE = (
    "<PrivateAction><TeleportAction><Position><RoutePosition><RouteRef>"
    '<Route name="r" closed="false">{0}{0}</Route></RouteRef><InRoutePosition>'
    '<FromCurrentEntity entityRef="Other"/></InRoutePosition></RoutePosition></Position>'
    "</TeleportAction></PrivateAction>"
).format(f'<Waypoint routeStrategy="shortest">{PLACE}</Waypoint>')
REFUSED = [
    (
        _globally('<TrafficAction trafficName="t"><TrafficStopAction/></TrafficAction>'),
        "TrafficAction is refused: traffic is not generated",
    ),
    (
        _synchronized('<RelativeSpeedToMaster value="2" speedTargetValueType="factor"/>'),
        "RelativeSpeedToMaster: speedTargetValueType factor is not played; use delta",
    ),
    (
        _variable("Parameter", "word", _modify("AddValue")),
        "ParameterAction: only numbers can be modified",
    ),
    (
        "<PrivateAction><VisibilityAction graphics='true' sensors='true' traffic='true'>"
        "<SensorReferenceSet><SensorReference name='s'/></SensorReferenceSet></VisibilityAction>"
        "</PrivateAction>",
        "SensorReferenceSet is refused: visibility for single sensors is not played",
    ),
    (
        LIGHT.format(
            '<LightType><UserDefinedLight userDefinedLightType="disco"/></LightType>'
            '<LightState mode="on"/>'
        ),
        "UserDefinedLight is refused: only lamps of the standard are known",
    ),
    (ON_ROUTE, "FromCurrentEntity is refused: a place on a route that moves with an entity"),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_what_is_refused_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as refusal:
        compiled(tmp_path, scenario_text(action=text, before=BEFORE))
    (line,) = str(refusal.value).splitlines()
    assert line.startswith(f"{tmp_path / 's.xosc'}:6: ")


def test_objects_of_other_files_are_refused(tmp_path: Path) -> None:
    entity = '\n<ScenarioObject name="Far"><ExternalObjectReference name="x"/></ScenarioObject>'
    with pytest.raises(ValueError, match="ExternalObjectReference is refused: objects of other"):
        compiled(tmp_path, scenario_text(entities=entity))


def test_the_used_area_and_pitch_of_a_place_have_no_effect(tmp_path: Path) -> None:
    corner = '<Position><WorldPosition x="5" y="0"/></Position>'
    area = f"<UsedArea>{corner}{corner}</UsedArea></RoadNetwork>"
    tilted = PLACE.replace("<WorldPosition", '<WorldPosition p="0.2" r="0"')
    action = f"<PrivateAction><TeleportAction>{tilted}</TeleportAction></PrivateAction>"
    text = scenario_text(action=action).replace("</RoadNetwork>", area)
    notes = [note.partition("xosc:")[2] for note in compiled(tmp_path, text).notes]
    assert notes == [
        "2: UsedArea: no effect: the whole road network is used",
        "6: WorldPosition: p has no effect: bodies stand as the road does",
    ]
