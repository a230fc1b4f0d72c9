"""Played scenarios for tests: a small one made by hand, and a scenario file to be played."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from road_files import LINE, geometry, lane, road, section, xodr

from schemas.files.played_scenario import (
    PLAY_VERSION,
    PlayElement,
    PlayEntity,
    PlayFile,
    PlayLane,
    PlayMark,
    PlayPath,
    PlayTransition,
)
from twin.records.play_file import packed_rows

STEP_S, PERIOD_S, END_S = 0.01, 0.05, 2.0
WIDTH_M = 3.5


def straight(
    speed_mps: float, x_m: float = 0.0, y_m: float = 0.0, begin_s: float = 0.0, end_s: float = END_S
) -> np.ndarray:
    """Poses of somebody who drives along x."""
    times = np.arange(round(begin_s / PERIOD_S), round(end_s / PERIOD_S) + 1) * PERIOD_S
    rows = np.zeros((len(times), 6))
    rows[:, 0], rows[:, 1] = times, x_m + speed_mps * times
    rows[:, 2], rows[:, 5] = y_m, speed_mps
    return rows


def entity(name: str, poses: np.ndarray, **changes: Any) -> PlayEntity:
    """A car, if nothing else is said."""
    values: dict[str, Any] = {
        "category": "car",
        "ego": False,
        "length_m": 4.5,
        "width_m": 1.8,
        "height_m": 1.5,
        "centre_m": (1.4, 0.0, 0.75),
    }
    return PlayEntity(name=name, poses=packed_rows(poses), **{**values, **changes})


def line(*points: tuple[float, float]) -> bytes:
    """Points on the ground."""
    return packed_rows(np.array([(x, y, 0.0) for x, y in points]))


def played(**changes: Any) -> PlayFile:
    """Ego and van in lanes, a pedestrian who comes and goes, one event."""
    lanes = [
        PlayLane(
            type="driving", left=line((0, y), (100, y)), right=line((0, y - 3.5), (100, y - 3.5))
        )
        for y in (5.25, 1.75)
    ]
    mark = {"color": "white", "width_m": 0.12, "from_m": 0.0}
    walk = np.concatenate([straight(0.0, 30.0, -2.0, 0.5, 0.8), straight(0.0, 30.0, 1.0, 1.2, 1.5)])
    values: dict[str, Any] = {
        "version": PLAY_VERSION,
        "name": "by hand",
        "step_s": STEP_S,
        "period_s": PERIOD_S,
        "end_s": END_S,
        "finished": True,
        "entities": [
            entity("Ego", straight(10.0), ego=True),
            entity("van", straight(8.0, 20.0, WIDTH_M), category="van"),
            entity("walker", walk, category="pedestrian", length_m=0.5, width_m=0.6),
        ],
        "lanes": lanes,
        "marks": [
            PlayMark(stroke_m=3.0, gap_m=6.0, points=line((0, 1.75), (100, 1.75)), **mark),
            PlayMark(stroke_m=0.0, gap_m=0.0, points=line((0, -1.75), (100, -1.75)), **mark),
        ],
        "paths": [PlayPath(kind="trajectory", name="walk", points=line((30, -2), (30, 6)))],
        "elements": [
            PlayElement(level="storyboard", name="storyboard", path="storyboard"),
            PlayElement(level="story", name="s", path="s"),
            PlayElement(
                level="event", name="cut in", path="s::a::g::m::cut in", line=12,
                trigger="near and slow", actors=[1],
            ),
            PlayElement(
                level="action", name="change", path="s::a::g::m::cut in::change",
                action="lane change", actors=[1],
            ),
        ],
        "transitions": [
            PlayTransition(time_s=0.0, element=0, transition="start"),
            PlayTransition(time_s=0.0, element=1, transition="start"),
            PlayTransition(time_s=0.5, element=2, transition="start"),
            PlayTransition(time_s=0.5, element=3, transition="start"),
            PlayTransition(time_s=1.5, element=3, transition="end"),
            PlayTransition(time_s=1.5, element=2, transition="end"),
            PlayTransition(time_s=2.0, element=0, transition="stop"),
        ],
        "notes": ["model3d has no effect"],
    }  # fmt: skip
    return PlayFile(**{**values, **changes})


def write_cut_in(folder: Path) -> Path:
    """A van that cuts in on a road that bends, and somebody who walks across; the file."""
    marks = {
        0: '<roadMark sOffset="0" type="solid solid" color="yellow" width="0.12"/>',
        -1: '<roadMark sOffset="0" type="broken" color="white" width="0.12"/>',
        -2: '<roadMark sOffset="0" type="solid" color="white" width="0.15"/>',
    }
    wide = f'<width sOffset="0" a="{WIDTH_M}" b="0" c="0" d="0"/>'
    right = lane(-1, wide + marks[-1]) + lane(-2, wide + marks[-2])
    right += lane(-3, '<width sOffset="0" a="2" b="0" c="0" d="0"/>', "sidewalk")
    lanes = section(left=lane(1, wide + marks[-2]), right=right).replace(
        '<lane id="0" type="none" level="false"/>',
        f'<lane id="0" type="none" level="false">{marks[0]}</lane>',
    )
    radius_m = 400.0
    plan = geometry(LINE, 200.0)
    plan += geometry(f'<arc curvature="{1 / radius_m}"/>', 400.0, 200.0, (200.0, 0.0, 0.0))
    (folder / "bend.xodr").write_bytes(xodr(road(600.0, plan, lanes)))
    path = folder / "cut-in.xosc"
    path.write_text(_SCENARIO)
    return path


def bend_place(s_m: float, t_m: float) -> tuple[float, float]:
    """A place of the road of :func:`write_cut_in`."""
    if s_m <= 200.0:
        return s_m, t_m
    angle = (s_m - 200.0) / 400.0
    return 200.0 + (400.0 - t_m) * math.sin(angle), 400.0 - (400.0 - t_m) * math.cos(angle)


def _vehicle(name: str, category: str, size: tuple[float, float, float]) -> str:
    axle = 'maxSteering="0.5" wheelDiameter="0.6" trackWidth="1.6"'
    length, width, height = size
    return (
        f'<ScenarioObject name="{name}"><Vehicle name="{name}" vehicleCategory="{category}">'
        f'<BoundingBox><Center x="{0.3 * length}" y="0" z="{0.5 * height}"/><Dimensions '
        f'width="{width}" length="{length}" height="{height}"/></BoundingBox>'
        '<Performance maxSpeed="70" maxAcceleration="10" maxDeceleration="10"/><Axles>'
        f'<FrontAxle {axle} positionX="{0.6 * length}" positionZ="0.3"/>'
        f'<RearAxle {axle} positionX="0" positionZ="0.3"/></Axles><Properties/>'
        "</Vehicle></ScenarioObject>"
    )


_WALKER = (
    '<ScenarioObject name="walker"><Pedestrian name="walker" mass="80" model="m" '
    'pedestrianCategory="pedestrian"><BoundingBox><Center x="0" y="0" z="0.9"/>'
    '<Dimensions width="0.6" length="0.5" height="1.8"/></BoundingBox><Properties/>'
    "</Pedestrian></ScenarioObject>"
)


def _on_lane(lane_id: int, s_m: float, offset_m: float = 0.0) -> str:
    return (
        f'<Position><LanePosition roadId="0" laneId="{lane_id}" s="{s_m}" offset="{offset_m}"/>'
        "</Position>"
    )


def _init(name: str, position: str, speed_mps: float) -> str:
    return (
        f'<Private entityRef="{name}"><PrivateAction><TeleportAction>{position}</TeleportAction>'
        "</PrivateAction><PrivateAction><LongitudinalAction><SpeedAction><SpeedActionDynamics "
        'dynamicsShape="step" dynamicsDimension="time" value="0"/><SpeedActionTarget>'
        f'<AbsoluteTargetSpeed value="{speed_mps}"/></SpeedActionTarget></SpeedAction>'
        "</LongitudinalAction></PrivateAction></Private>"
    )


def _group(name: str, actor: str, event: str, action: str, condition: str) -> str:
    return (
        f'<ManeuverGroup name="{name}" maximumExecutionCount="1">'
        f'<Actors selectTriggeringEntities="false"><EntityRef entityRef="{actor}"/></Actors>'
        f'<Maneuver name="{name} maneuver"><Event name="{event}" priority="parallel">'
        f'<Action name="{event} action"><PrivateAction>{action}</PrivateAction></Action>'
        f"<StartTrigger><ConditionGroup>{condition}</ConditionGroup></StartTrigger>"
        "</Event></Maneuver></ManeuverGroup>"
    )


def _time(name: str, time_s: float) -> str:
    return (
        f'<Condition name="{name}" conditionEdge="none" delay="0"><ByValueCondition>'
        f'<SimulationTimeCondition rule="greaterOrEqual" value="{time_s}"/></ByValueCondition>'
        "</Condition>"
    )


_NEAR = (
    '<Condition name="van is near" conditionEdge="none" delay="0"><ByEntityCondition>'
    '<TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="Ego"/>'
    '</TriggeringEntities><EntityCondition><RelativeDistanceCondition entityRef="van" value="25" '
    'relativeDistanceType="longitudinal" freespace="false" rule="lessThan" '
    'coordinateSystem="road"/></EntityCondition></ByEntityCondition></Condition>'
)
_CHANGE = (
    "<LateralAction><LaneChangeAction><LaneChangeActionDynamics "
    'dynamicsShape="sinusoidal" dynamicsDimension="time" value="3"/><LaneChangeTarget>'
    '<AbsoluteTargetLane value="-2"/></LaneChangeTarget></LaneChangeAction></LateralAction>'
)
_VERTICES = "".join(
    f'<Vertex time="{time}">{_on_lane(lane_id, 236.0, offset)}</Vertex>'
    for time, lane_id, offset in ((0.0, -3, 0.0), (9.0, 1, 0.0))
)
_WALK = (
    "<RoutingAction><FollowTrajectoryAction><TrajectoryRef>"
    '<Trajectory name="across" closed="false"><ParameterDeclarations/>'
    f"<Shape><Polyline>{_VERTICES}</Polyline></Shape></Trajectory></TrajectoryRef>"
    '<TimeReference><Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'
    '</TimeReference><TrajectoryFollowingMode followingMode="position"/>'
    "</FollowTrajectoryAction></RoutingAction>"
)
_SCENARIO = f"""<?xml version="1.0"?>
<OpenSCENARIO>
<FileHeader author="a" date="2026-01-31T12:00:00" description="d" revMajor="1" revMinor="2"/>
<CatalogLocations/>
<RoadNetwork><LogicFile filepath="bend.xodr"/></RoadNetwork>
<Entities>
{_vehicle("Ego", "car", (4.5, 1.8, 1.5))}
{_vehicle("van", "van", (5.5, 2.0, 2.3))}
{_vehicle("parked bus", "bus", (12.0, 2.5, 3.2))}
{_WALKER}
</Entities>
<Storyboard>
<Init><Actions>
{_init("Ego", _on_lane(-2, 60.0), 20.0)}
{_init("van", _on_lane(-1, 90.0), 18.0)}
{_init("parked bus", _on_lane(-3, 215.0), 0.0)}
{_init("walker", _on_lane(-3, 236.0), 0.0)}
</Actions></Init>
<Story name="story"><Act name="act">
{_group("cutting in", "van", "cut in", _CHANGE, _NEAR)}
{_group("walking", "walker", "walk across", _WALK, _time("4 s", 4.0))}
<StartTrigger><ConditionGroup>{_time("at once", 0.0)}</ConditionGroup></StartTrigger>
</Act></Story>
<StopTrigger><ConditionGroup>{_time("end", 9.0)}</ConditionGroup></StopTrigger>
</Storyboard>
</OpenSCENARIO>
"""
