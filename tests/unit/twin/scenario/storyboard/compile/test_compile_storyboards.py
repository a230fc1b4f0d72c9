"""Storyboards, conditions, variables, entities: records as the file says."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import BY_TIME, PEDESTRIAN, SPEED, by_entity, compiled, scenario_text

from twin.scenario.storyboard.program import actions, conditions
from twin.scenario.storyboard.program.entities import EntityCategory
from twin.scenario.storyboard.program.program import ElementKind, EventPriority, Program

POSITION = '<Position><LanePosition roadId="a" laneId="-1" s="50"/></Position>'


def _program(folder: Path, **parts: str) -> Program:
    return compiled(folder, scenario_text(**parts)).program


def test_elements_stand_in_depth_first_order(tmp_path: Path) -> None:
    program = _program(tmp_path, edge="rising", delay="0.5")
    kinds = [element.kind for element in program.elements]
    assert kinds == list(ElementKind)
    assert [element.parent for element in program.elements] == [-1, 0, 1, 2, 3, 4, 5]
    group, event, action = program.elements[3], program.elements[5], program.elements[6]
    assert (group.executions_max, group.actors, group.triggering_actors) == (2, (0,), False)
    assert event.priority is EventPriority.OVERRIDE
    assert event.start is not None
    ((condition,),) = event.start.groups
    assert condition == conditions.Condition(
        "when",
        conditions.SimulationTimeCondition(2.0, conditions.ComparisonRule.GREATER),
        conditions.ConditionEdge.RISING,
        0.5,
    )
    step = actions.TransitionDynamics(
        actions.DynamicsShape.STEP, actions.DynamicsDimension.TIME, 0.0
    )
    assert action.action == actions.SpeedAction(step, -1, 10.0)


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        ('<EndOfRoadCondition duration="1"/>', "EndOfRoadCondition", {"duration_s": 1.0}),
        ('<OffroadCondition duration="1"/>', "OffroadCondition", {"duration_s": 1.0}),
        ('<StandStillCondition duration="2"/>', "StandStillCondition", {"duration_s": 2.0}),
        ('<TraveledDistanceCondition value="7"/>', "TraveledDistanceCondition", {"value_m": 7.0}),
        (
            '<SpeedCondition value="3" rule="lessThan" direction="lateral"/>',
            *("SpeedCondition", {"value_mps": 3.0, "axis": conditions.SpeedAxis.LATERAL}),
        ),
        (
            '<AccelerationCondition value="3" rule="lessOrEqual"/>',
            *("AccelerationCondition", {"value_mps2": 3.0, "axis": conditions.SpeedAxis.TOTAL}),
        ),
        (
            '<RelativeSpeedCondition entityRef="Other" value="3" rule="notEqualTo"/>',
            "RelativeSpeedCondition",
            {"entity": 1, "rule": conditions.ComparisonRule.NOT_EQUAL},
        ),
        (
            '<CollisionCondition><EntityRef entityRef="Other"/></CollisionCondition>',
            *("CollisionCondition", {"entity": 1, "category": -1}),
        ),
        (
            '<CollisionCondition><ByType type="pedestrian"/></CollisionCondition>',
            *("CollisionCondition", {"entity": -1, "category": -3}),
        ),
        (
            '<TimeHeadwayCondition entityRef="Other" value="2" freespace="true" rule="lessThan" '
            'coordinateSystem="lane" relativeDistanceType="longitudinal"/>',
            "TimeHeadwayCondition",
            {
                "entity": 1,
                "freespace": True,
                "frame": conditions.DistanceFrame.LANE,
                "kind": conditions.DistanceKind.LONGITUDINAL,
            },
        ),
        (
            '<TimeToCollisionCondition value="2" freespace="false" rule="lessThan">'
            f"<TimeToCollisionConditionTarget>{POSITION}</TimeToCollisionConditionTarget>"
            "</TimeToCollisionCondition>",
            *("TimeToCollisionCondition", {"entity": -1, "value_s": 2.0}),
        ),
        (
            f'<ReachPositionCondition tolerance="1.5">{POSITION}</ReachPositionCondition>',
            *("ReachPositionCondition", {"tolerance_m": 1.5}),
        ),
        (
            '<DistanceCondition value="4" freespace="false" rule="lessThan" alongRoute="true">'
            f"{POSITION}</DistanceCondition>",
            "DistanceCondition",
            {
                "frame": conditions.DistanceFrame.ROAD,
                "kind": conditions.DistanceKind.LONGITUDINAL,
            },
        ),
        (
            '<RelativeDistanceCondition entityRef="Other" relativeDistanceType="lateral" value="4" '
            'freespace="true" rule="greaterThan"/>',
            *("RelativeDistanceCondition", {"kind": conditions.DistanceKind.LATERAL}),
        ),
        (
            '<AngleCondition angleType="pitch" angle="1" angleTolerance="0.1"/>',
            "AngleCondition",
            {"kind": conditions.AngleKind.PITCH, "frame": conditions.DistanceFrame.WORLD},
        ),
        (
            '<RelativeAngleCondition entityRef="Other" angleType="heading" angle="1" '
            'angleTolerance="0.1"/>',
            *("RelativeAngleCondition", {"entity": 1, "tolerance_rad": 0.1}),
        ),
        (
            '<AccelerationCondition value="3" rule="lessThan" direction="longitudinal"/>',
            *("AccelerationCondition", {"axis": conditions.SpeedAxis.LONGITUDINAL}),
        ),
        (
            '<RelativeSpeedCondition entityRef="Other" value="3" rule="lessThan" '
            'direction="vertical"/>',
            *("RelativeSpeedCondition", {"axis": conditions.SpeedAxis.VERTICAL}),
        ),
        (
            '<AngleCondition angleType="roll" angle="1" angleTolerance="0.1" '
            'coordinateSystem="lane"/>',
            "AngleCondition",
            {"kind": conditions.AngleKind.ROLL, "frame": conditions.DistanceFrame.LANE},
        ),
        (
            '<DistanceCondition value="4" freespace="true" rule="lessThan" coordinateSystem="lane" '
            f'relativeDistanceType="lateral">{POSITION}</DistanceCondition>',
            "DistanceCondition",
            {
                "freespace": True,
                "frame": conditions.DistanceFrame.LANE,
                "kind": conditions.DistanceKind.LATERAL,
            },
        ),
        (
            '<TimeHeadwayCondition entityRef="Other" value="2" freespace="false" rule="lessThan" '
            'alongRoute="true"/>',
            "TimeHeadwayCondition",
            {
                "frame": conditions.DistanceFrame.ROAD,
                "kind": conditions.DistanceKind.LONGITUDINAL,
            },
        ),
        (
            '<TimeToCollisionCondition value="2" freespace="true" rule="lessThan" '
            'coordinateSystem="road" relativeDistanceType="longitudinal">'
            '<TimeToCollisionConditionTarget><EntityRef entityRef="Other"/>'
            "</TimeToCollisionConditionTarget></TimeToCollisionCondition>",
            "TimeToCollisionCondition",
            {
                "entity": 1,
                "freespace": True,
                "frame": conditions.DistanceFrame.ROAD,
                "kind": conditions.DistanceKind.LONGITUDINAL,
            },
        ),
    ],
)
def test_conditions_of_entities(
    tmp_path: Path, text: str, name: str, values: dict[str, object]
) -> None:
    program = _program(tmp_path, condition=by_entity(text, "all", "Ego", "Other"))
    start = program.elements[5].start
    assert start is not None
    condition = start.groups[0][0]
    assert (condition.entities, condition.all_entities) == ((0, 1), True)
    expression = condition.expression
    assert type(expression).__name__ == name
    for key, value in values.items():
        assert getattr(expression, key) == value, key


VARIABLES = (
    '<ParameterDeclarations><ParameterDeclaration name="limit" parameterType="double" value="5"/>'
    "</ParameterDeclarations><VariableDeclarations>"
    '<VariableDeclaration name="mode" variableType="string" value="slow"/>'
    '<VariableDeclaration name="hit" variableType="boolean" value="false"/>'
    "</VariableDeclarations>"
)


def _value(text: str) -> str:
    return f"<ByValueCondition>{text}</ByValueCondition>"


def test_variables_hold_numbers_and_numbers_of_words(tmp_path: Path) -> None:
    fast = '<VariableAction variableRef="mode"><SetAction value="fast"/></VariableAction>'
    program = _program(
        tmp_path,
        before=VARIABLES,
        condition=_value('<VariableCondition variableRef="hit" rule="equalTo" value="true"/>'),
        action=f"<GlobalAction>{fast}</GlobalAction>",
    )
    names = [(variable.name, variable.value, variable.text) for variable in program.variables]
    assert names == [
        ("parameter limit", 5.0, False),
        ("variable mode", 0.0, True),
        ("variable hit", 0.0, False),
    ]
    assert program.words == ("slow", "fast")
    assert program.elements[6].action == actions.SetVariableAction(1, 1.0)
    start = program.elements[5].start
    assert start is not None
    rule = conditions.ComparisonRule.EQUAL
    assert start.groups[0][0].expression == conditions.VariableCondition(2, 1.0, rule)


def test_a_time_of_day_counts_in_seconds_from_1970(tmp_path: Path) -> None:
    text = '<TimeOfDayCondition dateTime="1970-01-02T00:00:01" rule="greaterOrEqual"/>'
    program = _program(tmp_path, condition=_value(text))
    start = program.elements[5].start
    assert start is not None
    rule = conditions.ComparisonRule.GREATER_OR_EQUAL
    assert start.groups[0][0].expression == conditions.TimeOfDayCondition(86401.0, rule)


def test_an_object_is_an_entity(tmp_path: Path) -> None:
    cone = (
        '<ScenarioObject name="cone"><MiscObject name="c" mass="5" miscObjectCategory="obstacle">'
        '<BoundingBox><Center x="0" y="0" z="0.5"/><Dimensions width="0.4" length="0.3" '
        'height="1"/></BoundingBox></MiscObject></ScenarioObject>'
    )
    entity = _program(tmp_path, entities=cone).entities[2]
    assert (entity.name, entity.category) == ("cone", EntityCategory.OBSTACLE)
    assert entity.mass_kg == 5.0


def test_variables_change(tmp_path: Path) -> None:
    modify = (
        '<ParameterAction parameterRef="limit"><ModifyAction><Rule><{} value="3"/></Rule>'
        "</ModifyAction></ParameterAction>"
    )
    for name, factor, addend in (("AddValue", 1.0, 3.0), ("MultiplyByValue", 3.0, 0.0)):
        action = f"<GlobalAction>{modify.format(name)}</GlobalAction>"
        program = _program(tmp_path, before=VARIABLES, action=action)
        assert program.elements[6].action == actions.ModifyVariableAction(0, factor, addend)


def test_values_of_the_user_have_none_at_first(tmp_path: Path) -> None:
    number = '<UserDefinedValueCondition name="n" rule="greaterThan" value="3"/>'
    (variable,) = _program(tmp_path, condition=_value(number)).variables
    assert math.isnan(variable.value)
    word = '<UserDefinedValueCondition name="n" rule="equalTo" value="go"/>'
    program = _program(tmp_path, condition=_value(word))
    assert program.variables[0].text
    assert program.words == ("", "go")


def test_states_of_elements_and_signals(tmp_path: Path) -> None:
    state = (
        '<StoryboardElementStateCondition storyboardElementType="maneuver" '
        'storyboardElementRef="group::maneuver" state="endTransition"/>'
    )
    program = _program(tmp_path, condition=_value(state))
    start = program.elements[5].start
    assert start is not None
    end = conditions.ElementState.END_TRANSITION
    assert start.groups[0][0].expression == conditions.ElementStateCondition(4, end)
    signal = (
        "<GlobalAction><InfrastructureAction><TrafficSignalAction>"
        '<TrafficSignalStateAction name="light" state="on;off"/></TrafficSignalAction>'
        "</InfrastructureAction></GlobalAction>"
    )
    program = _program(
        tmp_path,
        condition=_value('<TrafficSignalCondition name="light" state="on;off"/>'),
        action=signal,
    )
    assert program.variables[0].name == "signal light"
    start = program.elements[5].start
    assert start is not None
    number = program.words.index("on;off")
    assert start.groups[0][0].expression == conditions.TrafficSignalCondition(0, number)
    assert program.elements[6].action == actions.SetVariableAction(0, number)


def test_entities_and_selections(tmp_path: Path) -> None:
    more = (
        f'<ScenarioObject name="Child">{PEDESTRIAN}</ScenarioObject>'
        '<EntitySelection name="Cars"><Members><ByType objectType="vehicle"/></Members>'
        "</EntitySelection>"
    )
    speed = '<SpeedCondition value="3" rule="lessThan"/>'
    program = _program(tmp_path, entities=more, condition=by_entity(speed, "any", "Cars"))
    ego, other, child = program.entities
    assert (ego.ego, other.ego, child.ego) == (True, False, False)
    assert [entity.category for entity in program.entities] == [
        *(EntityCategory.CAR, EntityCategory.VAN, EntityCategory.CHILD)
    ]
    assert (ego.wheelbase_m, ego.mass_kg, ego.speed_max_mps) == (2.8, 1500.0, 70.0)
    assert (ego.box.length_m, ego.box.centre_x_m) == (5.0, 1.4)
    start = program.elements[5].start
    assert start is not None
    assert start.groups[0][0].entities == (0, 1)


def test_what_has_no_effect_is_noted(tmp_path: Path) -> None:
    animation = (
        "<PrivateAction><AppearanceAction><AnimationAction><AnimationType><PedestrianAnimation/>"
        "</AnimationType></AnimationAction></AppearanceAction></PrivateAction>"
    )
    result = compiled(tmp_path, scenario_text(action=animation, condition=BY_TIME))
    assert [note.split(": ", 1)[1] for note in result.notes] == [
        "AnimationAction: no effect: bodies move by their speed"
    ]
    assert result.program.elements[6].action == actions.CommandAction("PedestrianAnimation")


def test_init_keeps_its_order_and_selections_become_members(tmp_path: Path) -> None:
    init = "".join(f"<PrivateAction>{SPEED.format(v)}</PrivateAction>" for v in (3, 4))
    program = _program(tmp_path, init=init)
    speeds = []
    for item in program.init:
        assert isinstance(item.action, actions.SpeedAction)
        speeds.append((item.actor, item.action.value))
    assert speeds == [(0, 3.0), (0, 4.0)]
