"""twin.scenario.storyboard.check_program: what the types of a program cannot say."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from lying_parsers import EGO, ROADS
from msgspec.structs import replace

from twin.scenario.storyboard import check_program
from twin.scenario.storyboard.check_program import (
    MISTAKES_MAX,
    NAME_CHARS_MAX,
    REFERENCES,
    VARIABLES_MAX,
    program_mistakes,
)
from twin.scenario.storyboard.compile.compiler import RoadCache, compile_scenario
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native, shipped_scenarios
from twin.scenario.storyboard.openscenario.scenario import read_scenario
from twin.scenario.storyboard.player.columns import CONDITIONS_MAX, ELEMENTS_MAX, ENTITIES_MAX
from twin.scenario.storyboard.player.tables import pack_programs
from twin.scenario.storyboard.program.actions import (
    AcquirePositionAction,
    ControllerAction,
    DeleteEntityAction,
    DynamicsDimension,
    DynamicsShape,
    EnvironmentAction,
    FollowTrajectoryAction,
    LightAction,
    SetVariableAction,
    SpeedAction,
    TeleportAction,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import (
    CollisionCondition,
    ComparisonRule,
    Condition,
    ConditionEdge,
    ElementState,
    ElementStateCondition,
    SimulationTimeCondition,
    StandStillCondition,
    Trigger,
)
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RelativeFrame,
    RelativePosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
    TrajectoryPiece,
)
from twin.scenario.storyboard.program.program import (
    DriverModel,
    ElementKind,
    InitAction,
    Program,
    ProgramVariable,
    StoryboardEnvironment,
    StoryElement,
)

DATA = Path(__file__).parents[6] / "shared" / "data" / "openscenario"
SHIPPED_NAMES = tuple(shipped_scenarios())
DYNAMICS = TransitionDynamics(DynamicsShape.LINEAR, DynamicsDimension.TIME, 2.0)
SPEED = SpeedAction(DYNAMICS, -1, 10.0)
LATER = Condition(
    "later", SimulationTimeCondition(1.0, ComparisonRule.GREATER), ConditionEdge.NONE, 0.0
)
STANDS = Condition("stands", StandStillCondition(1.0), ConditionEdge.RISING, 0.0, (0,))
WHEN = Trigger(((LATER, STANDS),))
ELEMENTS = (
    StoryElement(ElementKind.STORYBOARD, "", -1, stop=WHEN),
    StoryElement(ElementKind.STORY, "s", 0),
    StoryElement(ElementKind.ACT, "a", 1, start=WHEN),
    StoryElement(ElementKind.GROUP, "g", 2, actors=(0,)),
    StoryElement(ElementKind.MANEUVER, "m", 3),
    StoryElement(ElementKind.EVENT, "e", 4, start=WHEN),
    StoryElement(ElementKind.ACTION, "x", 5, action=SPEED),
    StoryElement(ElementKind.EVENT, "f", 4),
    StoryElement(ElementKind.ACTION, "y", 7, action=SPEED),
)
CUBIC = (0.0, 1.0, 0.0, 0.0)
PIECE = TrajectoryPiece(0.0, 10.0, CUBIC, CUBIC, CUBIC, CUBIC)
HERE = FixedPosition(0.0, 0.0, 0.0, 0.0, road=0, lane=-1)
GOOD = Program(
    "good",
    (EGO, replace(EGO, name="Other", ego=False)),
    ELEMENTS,
    (InitAction(TeleportAction(HERE), 0),),
    (Trajectory("t", False, False, (PIECE,)),),
    (RoadRoute("r", False, (RouteLeg(0, 0.0, 50.0, -1),)),),
    (ProgramVariable("parameter x", math.nan), ProgramVariable("parameter y", 0.0, True)),
    ("word",),
    (StoryboardEnvironment("e"),),
    (DriverModel(30.0),),
    ROADS,
)


def with_action(action: Any) -> Program:
    """The program with this action of its event."""
    elements = (*ELEMENTS[:6], replace(ELEMENTS[6], action=action), *ELEMENTS[7:])
    return replace(GOOD, elements=elements)


def with_condition(expression: Any, *entities: int, **changes: Any) -> Program:
    """The program with this condition of its act."""
    condition = replace(LATER, expression=expression, entities=entities, **changes)
    return with_element(2, start=Trigger(((condition,),)))


def with_element(number: int, **changes: Any) -> Program:
    """The program with an element changed."""
    elements = list(ELEMENTS)
    elements[number] = replace(elements[number], **changes)
    return replace(GOOD, elements=tuple(elements))


def with_init(action: Any, actor: int = 0) -> Program:
    """The program with this action of Init."""
    return replace(GOOD, init=(InitAction(action, actor),))


def with_entity(**changes: Any) -> Program:
    """The program with its ego changed."""
    return replace(GOOD, entities=(replace(EGO, **changes), GOOD.entities[1]))


def with_piece(**changes: Any) -> Program:
    """The program with a piece of its trajectory changed."""
    return replace(
        GOOD, trajectories=(Trajectory("t", False, False, (replace(PIECE, **changes),)),)
    )


def at(road: int, lane: int = 0) -> Program:
    """The program with an entity put onto a lane."""
    return with_init(TeleportAction(replace(HERE, road=road, lane=lane)))


def follow(trajectory: int) -> FollowTrajectoryAction:
    """Follow a trajectory."""
    return FollowTrajectoryAction(trajectory, False, False, 1.0, 0.0, True, 0.0)


def behind(entity: int) -> TeleportAction:
    """Be behind another entity."""
    return TeleportAction(RelativePosition(RelativeFrame.OBJECT, entity, -10.0))


COLLIDED, STATE = CollisionCondition, ElementStateCondition
MANY = tuple(replace(EGO, name=str(number)) for number in range(ENTITIES_MAX + 1))
WRONG: dict[str, tuple[Callable[[], Program], str]] = {
    "entities": (lambda: replace(GOOD, entities=MANY), "65 entities; 0 to 64 are played"),
    "twins": (lambda: replace(GOOD, entities=(EGO, EGO)), "two entities have one name"),
    "no elements": (lambda: replace(GOOD, elements=()), "0 elements; 1 to 4096"),
    "elements": (
        lambda: replace(GOOD, elements=(*ELEMENTS, *[ELEMENTS[-1]] * ELEMENTS_MAX)),
        "4105 elements; 1 to 4096",
    ),
    "variables": (
        lambda: replace(GOOD, variables=(ProgramVariable("v", 0.0),) * (VARIABLES_MAX + 1)),
        "4097 variables",
    ),
    "name": (lambda: replace(GOOD, name="x" * (NAME_CHARS_MAX + 1)), "more than 10000 characters"),
    "box": (
        lambda: with_entity(box=replace(EGO.box, width_m=-1.0)),
        "entity 0: its box has a negative size",
    ),
    "box nan": (
        lambda: with_entity(box=replace(EGO.box, width_m=math.nan)),
        "entity 0: width_m is nan",
    ),
    "mass nan": (lambda: with_entity(mass_kg=math.nan), "entity 0: mass_kg is nan"),
    "start": (
        lambda: with_entity(start=replace(HERE, road=1)),
        "entity 0: road 1 does not exist",
    ),
    "root": (lambda: replace(GOOD, elements=ELEMENTS[1:]), "element 0: it is not the storyboard"),
    "second root": (
        lambda: with_element(1, kind=ElementKind.STORYBOARD),
        "element 1: a second storyboard",
    ),
    "parent after": (lambda: with_element(1, parent=3), "element 1: it does not stand behind"),
    "parent itself": (lambda: with_element(3, parent=3), "element 3: it does not stand behind"),
    "parent negative": (lambda: with_element(3, parent=-2), "element 3: it does not stand behind"),
    "parent closed": (lambda: with_element(8, parent=5), "element 8: it does not stand behind"),
    "kind": (lambda: with_element(2, kind=ElementKind.GROUP), "element 2: its parent 1 is of the"),
    "executions": (lambda: with_element(5, executions_max=-1), "element 5: it has -1 executions"),
    "actor": (lambda: with_element(3, actors=(2,)), "element 3: entity 2 does not exist"),
    "actor negative": (lambda: with_element(3, actors=(-1,)), "element 3: entity -1 does not"),
    "actor twice": (lambda: with_element(3, actors=(0, 0)), "an actor is named twice"),
    "no action": (lambda: with_element(6, action=None), "element 6: it has no action"),
    "own action": (
        lambda: with_element(4, action=SPEED),
        "element 4: it has an action and is none",
    ),
    "speed of": (lambda: with_action(replace(SPEED, entity=2)), "element 6: entity 2 does not"),
    "speed nan": (lambda: with_action(replace(SPEED, value=math.nan)), "element 6: value is nan"),
    "dynamics nan": (
        lambda: with_action(replace(SPEED, dynamics=replace(DYNAMICS, value=math.nan))),
        "element 6: value is nan",
    ),
    "trajectory": (lambda: with_action(follow(1)), "trajectory 1 does not exist"),
    "no trajectory": (lambda: with_action(follow(-1)), "trajectory -1 does not exist"),
    "model": (lambda: with_action(ControllerAction(None, None, 1)), "model 1 does not exist"),
    "variable": (lambda: with_action(SetVariableAction(2, 0.0)), "variable 2 does not exist"),
    "environment": (lambda: with_action(EnvironmentAction(1)), "environment 1 does not exist"),
    "delete": (lambda: with_action(DeleteEntityAction(-1)), "entity -1 does not exist"),
    "light": (lambda: with_action(LightAction(13, 1, 1.0, 1.0)), "light 13 does not exist"),
    "light mode": (lambda: with_action(LightAction(0, 4, 1.0, 1.0)), "mode is 4"),
    "light unsaid": (lambda: with_action(LightAction(0, 0, 1.0, 1.0)), "mode is 0"),
    "relative": (lambda: with_action(behind(7)), "entity 7 does not exist"),
    "routes": (
        lambda: with_action(AcquirePositionAction(HERE, (-1, 1))),
        "element 6: route 1 does not exist",
    ),
    "routes of roads": (
        lambda: with_action(AcquirePositionAction(HERE, (-1, 0, -1))),
        "3 routes of 1 roads",
    ),
    "road": (lambda: at(1), "init 0: road 1 does not exist"),
    "road negative": (lambda: at(-2), "init 0: road -2 does not exist"),
    "lane": (lambda: at(0, -2), "init 0: road 0 has no lane -2"),
    "far": (
        lambda: with_init(TeleportAction(replace(HERE, x_m=math.inf))),
        "init 0: x_m is inf",
    ),
    "init actor": (lambda: with_init(TeleportAction(HERE), 2), "init 0: entity 2 does not exist"),
    "no init actor": (lambda: with_init(TeleportAction(HERE), -1), "init 0: entity -1 does not"),
    "global actor": (lambda: with_init(EnvironmentAction(0), 0), "a global action has an actor"),
    "triggering": (lambda: with_condition(StandStillCondition(1.0), 2), "entity 2 does not exist"),
    "no triggering": (lambda: with_condition(StandStillCondition(1.0)), "has none and needs some"),
    "needless": (lambda: with_condition(LATER.expression, 0), "has triggering entities"),
    "delay": (lambda: with_condition(LATER.expression, delay_s=-1.0), "a delay of -1 s"),
    "delay nan": (lambda: with_condition(LATER.expression, delay_s=math.nan), "a delay of nan s"),
    "collided": (lambda: with_condition(COLLIDED(2, -1), 0), "entity 2 does not exist"),
    "category": (lambda: with_condition(COLLIDED(-1, 15), 0), "category is 15"),
    "state": (
        lambda: with_condition(STATE(9, ElementState.COMPLETE)),
        "element 2: element 9 does not exist",
    ),
    "conditions": (
        lambda: with_element(2, start=Trigger(((LATER,) * (CONDITIONS_MAX + 1),))),
        "more than 4096 conditions",
    ),
    "piece nan": (lambda: with_piece(x=(0.0, math.nan, 0.0, 0.0)), "trajectory 0: x has nan"),
    "piece": (lambda: with_piece(length_m=-1.0), "a negative length or duration"),
    "pieces": (
        lambda: replace(GOOD, trajectories=(Trajectory("t", False, False, ()),)),
        "trajectory 0: it has no pieces",
    ),
    "order": (
        lambda: replace(
            GOOD,
            trajectories=(Trajectory("t", False, False, (replace(PIECE, start_s_m=1.0), PIECE)),),
        ),
        "its pieces do not ascend",
    ),
    "leg": (
        lambda: replace(GOOD, routes=(RoadRoute("r", False, (RouteLeg(-1, 0.0, 1.0, 0),)),)),
        "route 0: a leg lies on no road",
    ),
    "legs": (lambda: replace(GOOD, routes=(RoadRoute("r", False, ()),)), "route 0: it has no legs"),
    "exponent": (
        lambda: replace(GOOD, models=(DriverModel(30.0, exponent=-4),)),
        "model 0: an exponent of -4",
    ),
    "rain": (
        lambda: replace(GOOD, environments=(StoryboardEnvironment("e", rain_mm_per_h=math.inf),)),
        "environment 0: rain_mm_per_h is inf",
    ),
    "clock": (
        lambda: replace(GOOD, environments=(StoryboardEnvironment("e", clock_s=1e300),)),
        "environment 0: clock_s is 1e+300",
    ),
    "snow": (
        lambda: replace(GOOD, environments=(StoryboardEnvironment("e", snow_mm_per_h=-1.0),)),
        "environment 0: snow_mm_per_h is -1",
    ),
    "word": (
        lambda: replace(GOOD, variables=(GOOD.variables[0], ProgramVariable("y", 1.0, True))),
        "variable 1: its value names no word",
    ),
    "no roads": (lambda: replace(GOOD, network=None), "init 0: road 0 does not exist"),
}


def test_a_good_program_has_no_mistakes() -> None:
    assert program_mistakes(GOOD) == []
    pack_programs([GOOD])


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_found(name: str) -> None:
    make, words = WRONG[name]
    lines = program_mistakes(make())
    assert any(words in line for line in lines), lines
    assert all(line.isprintable() for line in lines)


def test_mistakes_have_a_limit() -> None:
    wrong = with_init(TeleportAction(replace(HERE, road=7)))
    assert len(program_mistakes(replace(wrong, init=wrong.init * 500))) == MISTAKES_MAX


def test_every_reference_is_checked() -> None:
    """Each whole number of a record is an index that is checked, or is listed here as none."""
    plain = {
        *("RelativePosition.lanes", "FixedPosition.lane", "RouteLeg.lane", "LaneChangeAction.lane"),
        *("CollisionCondition.category", "DriverModel.exponent", "StoryElement.line"),
        *("StoryElement.executions_max", "StoryElement.parent", "InitAction.actor"),
        *("FixedPosition.road", "RouteLeg.road", "LightAction.mode"),
        *("LaneRange.first", "LaneRange.last", "SignalPhaseAction.phase"),
    }
    from twin.scenario.storyboard.program.record import ProgramRecord

    unknown = [
        f"{record.__name__}.{field.name}"
        for record in ProgramRecord.__subclasses__()
        for field in msgspec.structs.fields(record)
        if field.type is int and field.name not in REFERENCES
    ]
    assert set(unknown) <= plain


@pytest.mark.skipif(not DATA.is_dir(), reason="no OpenSCENARIO files of others beside the project")
def test_programs_of_others_have_no_mistakes() -> None:
    roads: RoadCache = {}
    checked = 0
    for path in sorted(DATA.rglob("*.xosc")):
        scenario = read_scenario(path)
        if scenario.kind == "ScenarioFile":
            program = compile_scenario(scenario, roads)
            assert program_mistakes(program) == [], path
            data = msgspec.msgpack.encode(program)
            assert msgspec.msgpack.decode(data, type=Program) == program
            checked += 1
    assert checked > 30


def test_shipped_scenarios_have_no_mistakes() -> None:
    assert [program_mistakes(compile_native(load_native(name))) for name in SHIPPED_NAMES] == [
        [] for _ in SHIPPED_NAMES
    ]
    assert len(SHIPPED_NAMES) >= 8


def test_a_native_scenario_is_looked_through(monkeypatch) -> None:
    monkeypatch.setattr(check_program, "ENTITIES_MAX", 1)
    with pytest.raises(ValueError, match=r"cut-in\.yaml: 2 entities; 0 to 1 are played$"):
        compile_native(load_native("cut-in"))
