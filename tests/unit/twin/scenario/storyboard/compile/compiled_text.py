"""Small scenarios as text: two roads, two cars, one action or condition at a time."""

from __future__ import annotations

from pathlib import Path

from twin.scenario.storyboard.compile.compiler import CompiledScenario, compile_with_notes
from twin.scenario.storyboard.openscenario.scenario import read_scenario

LANES = "".join(
    f"<{side}>"
    + "".join(
        f'<lane id="{lane}" type="driving"><link>{{link{lane}}}</link>'
        '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        for lane in ids
    )
    + f"</{side}>"
    + ('<center><lane id="0" type="none"/></center>' if side == "left" else "")
    for side, ids in (("left", (2, 1)), ("right", (-1, -2)))
)


def _lanes(link: str) -> str:
    text = LANES
    for lane in (2, 1, -1, -2):
        text = text.replace(f"{{link{lane}}}", f'<{link} id="{lane}"/>')
    return f'<lanes><laneSection s="0">{text}</laneSection></lanes>'


ROADS = (
    '<OpenDRIVE><header revMajor="1" revMinor="6"/>'
    '<road id="a" length="200" junction="-1" rule="RHT"><link>'
    '<successor elementType="road" elementId="b" contactPoint="start"/></link><planView>'
    '<geometry s="0" x="0" y="0" hdg="0" length="200"><line/></geometry></planView>'
    f"{_lanes('successor')}"
    '<signals><signal s="50" t="-5" id="light" name="light" dynamic="yes" orientation="+" '
    'zOffset="2" type="1000001" subtype="-1" value="-1"/></signals></road>'
    '<road id="b" length="157" junction="-1" rule="RHT"><link>'
    '<predecessor elementType="road" elementId="a" contactPoint="end"/></link><planView>'
    '<geometry s="0" x="200" y="0" hdg="0" length="157"><arc curvature="0.01"/></geometry>'
    f"</planView>{_lanes('predecessor')}</road></OpenDRIVE>"
)
"""A straight road of 200 m along x, then an arc to the left of 100 m radius; two lanes a side."""

VEHICLE = (
    '<Vehicle name="car" vehicleCategory="{category}" mass="1500"><BoundingBox>'
    '<Center x="1.4" y="0" z="0.9"/><Dimensions width="2" length="5" height="1.8"/></BoundingBox>'
    '<Performance maxSpeed="70" maxDeceleration="8" maxAcceleration="5"/><Axles>'
    '<FrontAxle maxSteering="0.5" wheelDiameter="0.8" trackWidth="1.7" positionX="2.8" '
    'positionZ="0.4"/><RearAxle maxSteering="0" wheelDiameter="0.8" trackWidth="1.7" '
    'positionX="0" positionZ="0.4"/></Axles></Vehicle>'
)
PEDESTRIAN = (
    '<Pedestrian name="p" mass="30" pedestrianCategory="pedestrian"><BoundingBox>'
    '<Center x="0" y="0" z="0.6"/><Dimensions width="0.5" length="0.5" height="1.2"/>'
    "</BoundingBox></Pedestrian>"
)
HEADER = (
    '<FileHeader author="a" date="2026-01-31T12:00:00" description="" revMajor="1" revMinor="3"/>'
)
TELEPORT = "<TeleportAction><Position>{}</Position></TeleportAction>"
STEP = '<SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>'
SPEED = (
    f"<LongitudinalAction><SpeedAction>{STEP}<SpeedActionTarget>"
    '<AbsoluteTargetSpeed value="{}"/></SpeedActionTarget></SpeedAction></LongitudinalAction>'
)
BY_TIME = (
    '<ByValueCondition><SimulationTimeCondition rule="greaterThan" value="2"/></ByValueCondition>'
)


def by_entity(condition: str, rule: str = "any", *entities: str) -> str:
    """A condition of entities."""
    references = "".join(f'<EntityRef entityRef="{name}"/>' for name in entities or ("Ego",))
    return (
        f'<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="{rule}">{references}'
        f"</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"
    )


def scenario_text(
    *,
    init: str = "",
    action: str = f"<PrivateAction>{SPEED.format(10)}</PrivateAction>",
    condition: str = BY_TIME,
    before: str = "",
    entities: str = "",
    edge: str = "none",
    delay: str = "0",
) -> str:
    """A scenario with the actors Ego (car) and Other (van): ``init`` are the Ego's actions."""
    private = f'<Private entityRef="Ego">{init}</Private>' if init else ""
    return (
        f"<OpenSCENARIO>{HEADER}{before}<CatalogLocations/>\n"
        '<RoadNetwork><LogicFile filepath="roads.xodr"/></RoadNetwork>\n'
        f'<Entities><ScenarioObject name="Ego">{VEHICLE.format(category="car")}</ScenarioObject>'
        f'<ScenarioObject name="Other">{VEHICLE.format(category="van")}</ScenarioObject>{entities}'
        f"</Entities>\n<Storyboard><Init><Actions>{private}</Actions></Init>\n"
        '<Story name="story"><Act name="act"><ManeuverGroup name="group" '
        'maximumExecutionCount="2"><Actors selectTriggeringEntities="false">'
        '<EntityRef entityRef="Ego"/></Actors><Maneuver name="maneuver">\n'
        f'<Event name="event" priority="override"><Action name="action">{action}</Action>\n'
        f'<StartTrigger><ConditionGroup><Condition name="when" conditionEdge="{edge}" '
        f'delay="{delay}">{condition}</Condition></ConditionGroup></StartTrigger></Event>\n'
        "</Maneuver></ManeuverGroup></Act></Story></Storyboard></OpenSCENARIO>"
    )


def compiled(folder: Path, text: str, roads: str = ROADS) -> CompiledScenario:
    """A scenario as a program, with its roads."""
    (folder / "roads.xodr").write_text(roads)
    path = folder / "s.xosc"
    path.write_text(text)
    return compile_with_notes(read_scenario(path))
