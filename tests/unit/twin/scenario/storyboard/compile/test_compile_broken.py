"""Scenarios that can be read and not be played: one line each, with file and line, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import ROADS, SPEED, TELEPORT, by_entity, compiled, scenario_text
from test_compile_trajectories import follow, nurbs, vertex

from twin.scenario.storyboard.compile.compiler import compile_scenario
from twin.scenario.storyboard.openscenario.scenario import read_scenario


def private(inner: str) -> str:
    """An action of an entity."""
    return f"<PrivateAction>{inner}</PrivateAction>"


def teleport(position: str) -> str:
    """An action that puts an entity somewhere."""
    return private(TELEPORT.format(position))


def globally(inner: str) -> str:
    """An action of the whole scenario."""
    return f"<GlobalAction>{inner}</GlobalAction>"


def lateral(inner: str) -> str:
    """An action that moves an entity aside."""
    return private(f"<LateralAction>{inner}</LateralAction>")


def longitudinal(inner: str) -> str:
    """An action that changes the speed of an entity."""
    return private(f"<LongitudinalAction>{inner}</LongitudinalAction>")


LANE_CHANGE = (
    '<LaneChangeAction><LaneChangeActionDynamics dynamicsShape="{}" dynamicsDimension="time" '
    'value="{}"/><LaneChangeTarget><AbsoluteTargetLane value="{}"/></LaneChangeTarget>'
    "</LaneChangeAction>"
)
ROUTE = (
    '<RoutingAction><AssignRouteAction><Route name="r" closed="false">'
    '<Waypoint routeStrategy="{}"><Position>{}</Position></Waypoint>'
    '<Waypoint routeStrategy="{}"><Position>{}</Position></Waypoint></Route></AssignRouteAction>'
    "</RoutingAction>"
)
LANE = '<LanePosition roadId="{}" laneId="{}" s="{}"/>'
TIMES = '<Timing domainAbsoluteRelative="relative" scale="{}" offset="0"/>'
LINE = f"<Polyline>{vertex(0, 0)}{vertex(10, 0)}</Polyline>"
RELATIVE_VERTEX = (
    '<Vertex><Position><RelativeWorldPosition entityRef="Other" dx="1" dy="1"/></Position></Vertex>'
)

ACTIONS = [
    (teleport(LANE.format("z", "-1", 5)), "LanePosition: .* has no road z"),
    (teleport(LANE.format("a", "-9", 5)), "LanePosition: road a has no lane -9 at s=5 m"),
    (teleport(LANE.format("a", "left", 5)), "laneId='left' is no lane of OpenDRIVE"),
    (teleport(LANE.format("a", "-1", 500)), "s=500 m on road a, which is 200 m long"),
    (teleport('<RoadPosition roadId="b" s="-3" t="0"/>'), "RoadPosition: s=-3 m on road b"),
    (teleport('<GeoPosition latitudeDeg="48" longitudeDeg="11"/>'), "has no geoReference"),
    (
        teleport('<RelativeLanePosition entityRef="Other" dLane="1" ds="1" dsLane="1"/>'),
        "either ds or dsLane",
    ),
    (lateral(LANE_CHANGE.format("sinusoidal", -1, -2)), "value is -1, it must be 0 or more"),
    (lateral(LANE_CHANGE.format("linear", 3, "left")), "'left' is no lane of OpenDRIVE"),
    (lateral(LANE_CHANGE.format("linear", 3, 0)), "lane 0 is the centre line"),
    (
        lateral(
            '<LaneOffsetAction continuous="false"><LaneOffsetActionDynamics '
            'dynamicsShape="linear" maxLateralAcc="0"/><LaneOffsetTarget>'
            '<AbsoluteTargetLaneOffset value="1"/></LaneOffsetTarget></LaneOffsetAction>'
        ),
        "maxLateralAcc is 0 m/s2, it must be above 0",
    ),
    (
        lateral('<LateralDistanceAction entityRef="Other" continuous="true" freespace="false"/>'),
        "LateralDistanceAction: give a distance",
    ),
    (
        longitudinal(
            '<LongitudinalDistanceAction entityRef="Other" continuous="true" freespace="false" '
            'distance="1" timeGap="1"/>'
        ),
        "either distance or timeGap",
    ),
    (
        longitudinal(
            '<LongitudinalDistanceAction entityRef="Other" continuous="true" freespace="false" '
            'distance="1"><DynamicConstraints maxSpeed="-1"/></LongitudinalDistanceAction>'
        ),
        "DynamicConstraints: limits must not be negative",
    ),
    (
        private(
            ROUTE.format("fastest", LANE.format("a", -1, 5), "shortest", LANE.format("b", -1, 5))
        ),
        "Waypoint: routeStrategy fastest is not played",
    ),
    (
        private(
            ROUTE.format("shortest", LANE.format("b", -1, 5), "shortest", LANE.format("a", -1, 5))
        ),
        "Waypoint: no lanes lead there",
    ),
    (
        private(
            ROUTE.format(
                "shortest", '<WorldPosition x="0" y="99"/>', "shortest", LANE.format("a", -1, 5)
            )
        ),
        "Waypoint: a waypoint must lie on a lane",
    ),
    (follow(LINE, TIMES.format(1)), "Timing: trajectory 't' has no times"),
    (follow(f"<Polyline>{vertex(0, 0)}{vertex(0, 0)}</Polyline>"), "Polyline: it has no length"),
    (
        follow(f"<Polyline>{vertex(0, 0, time=2)}{vertex(9, 0, time=1)}</Polyline>"),
        "Vertex: its time 1 s is before",
    ),
    (
        follow(f"<Polyline>{vertex(0, 0, time=2)}{vertex(9, 0)}</Polyline>"),
        "either every vertex has a time or none has",
    ),
    (
        follow(f"<Polyline>{vertex(0, 0)}{RELATIVE_VERTEX}</Polyline>"),
        "RelativeWorldPosition: a position relative to an entity cannot stand here",
    ),
    (
        follow(
            f"<Polyline>{vertex(0, 0, time=0)}{vertex(9, 0, time=1)}</Polyline>", TIMES.format(0)
        ),
        "scale is 0, it must be above 0",
    ),
    (
        follow(
            '<Clothoid curvature="0" length="-4"><Position><WorldPosition x="0" y="0"/>'
            "</Position></Clothoid>"
        ),
        "Clothoid: length is -4 m",
    ),
    (follow(nurbs([(0, 0, 1.0), (1, 0, 1.0)], [0, 0, 1], 2)), "Nurbs: 3 knots, 4 are needed"),
    (follow(nurbs([(0, 0, 1.0), (1, 0, 1.0)], [0, 1, 0, 1], 2)), "Nurbs: knots must not fall"),
    (follow(nurbs([(0, 0, 0.0), (1, 0, 1.0)], [0, 0, 1, 1], 2)), "weights must be above 0"),
    (follow(nurbs([(0, 0, 1.0), (1, 0, 1.0)], [0, 0, 1, 1], 9)), "order is 9, .* from 2 to 2"),
    (follow(nurbs([(3, 3, 1.0), (3, 3, 1.0)], [0, 0, 1, 1], 2)), "stands still"),
    (private("<RoutingAction><RandomRouteAction/></RoutingAction>"), "drawn at random"),
    (
        private(
            "<ControllerAction><OverrideControllerValueAction><Throttle active='true' value='1'/>"
            "</OverrideControllerValueAction></ControllerAction>"
        ),
        "OverrideControllerValueAction is refused",
    ),
    (globally("<TrafficAction><TrafficStopAction/></TrafficAction>"), "TrafficAction is refused"),
    (
        globally(
            "<InfrastructureAction><TrafficSignalAction><TrafficSignalStateAction name='x' "
            "state='go'/></TrafficSignalAction></InfrastructureAction>"
        ),
        "the road network has no signal 'x'",
    ),
]

CONDITIONS = [
    ('<StandStillCondition duration="-1"/>', "duration is -1 s"),
    ('<EndOfRoadCondition duration="INF"/>', "duration is inf s"),
    ('<CollisionCondition><ByType type="external"/></CollisionCondition>', "collide with nothing"),
    (
        '<ReachPositionCondition tolerance="1"><Position><RoadPosition roadId="c" s="0" t="0"/>'
        "</Position></ReachPositionCondition>",
        "has no road c",
    ),
]


@pytest.mark.parametrize(("action", "words"), ACTIONS)
def test_actions_that_are_not_played(tmp_path: Path, action: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as refusal:
        compiled(tmp_path, scenario_text(action=action))
    lines = str(refusal.value).splitlines()
    assert len(lines) == 1
    assert f"{tmp_path / 's.xosc'}:6: " in lines[0]


@pytest.mark.parametrize(("condition", "words"), CONDITIONS)
def test_conditions_that_are_not_played(tmp_path: Path, condition: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as refusal:
        compiled(tmp_path, scenario_text(condition=by_entity(condition)))
    lines = str(refusal.value).splitlines()
    assert len(lines) == 1
    assert f"{tmp_path / 's.xosc'}:7: " in lines[0]


def test_words_have_no_order(tmp_path: Path) -> None:
    variables = (
        '<VariableDeclarations><VariableDeclaration name="mode" variableType="string" '
        'value="slow"/></VariableDeclarations>'
    )
    condition = '<VariableCondition variableRef="mode" rule="lessThan" value="fast"/>'
    text = scenario_text(
        before=variables, condition=f"<ByValueCondition>{condition}</ByValueCondition>"
    )
    with pytest.raises(ValueError, match="words have no order"):
        compiled(tmp_path, text)


def test_a_selection_where_one_entity_must_stand(tmp_path: Path) -> None:
    both = (
        '<EntitySelection name="Both"><Members><EntityRef entityRef="Ego"/>'
        '<EntityRef entityRef="Other"/></Members></EntitySelection>'
    )
    condition = by_entity('<RelativeSpeedCondition entityRef="Both" value="1" rule="lessThan"/>')
    with pytest.raises(ValueError, match="must name one entity, not a selection"):
        compiled(tmp_path, scenario_text(entities=both, condition=condition))


def test_broken_roads_are_told_with_their_own_file(tmp_path: Path) -> None:
    compiled(tmp_path, scenario_text())
    broken = ROADS.replace('<arc curvature="0.01"/>', '<arc curvature="tight"/>')
    (tmp_path / "roads.xodr").write_text(broken)
    with pytest.raises(ValueError, match=r"roads\.xodr:\d+: .*tight"):
        compile_scenario(read_scenario(tmp_path / "s.xosc"))


def test_too_many_entities(tmp_path: Path) -> None:
    box = (
        '<BoundingBox><Center x="0" y="0" z="0"/><Dimensions width="1" length="1" height="1"/>'
        "</BoundingBox>"
    )
    many = "".join(
        f'<ScenarioObject name="cone{number}"><MiscObject name="c" mass="1" '
        f'miscObjectCategory="obstacle">{box}</MiscObject></ScenarioObject>'
        for number in range(63)
    )
    with pytest.raises(ValueError, match="65 entities, at most 64 are played"):
        compiled(tmp_path, scenario_text(entities=many))


def test_everything_at_once(tmp_path: Path) -> None:
    text = scenario_text(
        init=teleport(LANE.format("a", "-7", 5)) + private(SPEED.format(3)),
        action=lateral(LANE_CHANGE.format("linear", 3, 0)),
        condition=by_entity('<StandStillCondition duration="-1"/>'),
    )
    with pytest.raises(ValueError, match="duration is -1") as refusal:
        compiled(tmp_path, text)
    assert len(str(refusal.value).splitlines()) == 3
