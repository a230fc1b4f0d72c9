"""Broken scenario and road files: what is changed in a good one, and what is said of it."""

from __future__ import annotations

from road_files import LINE, WIDTH, end, geometry, lane, road, section, xodr

HEADER = (
    '<FileHeader author="a" date="2026-01-31T12:00:00" description="d" revMajor="1" revMinor="3"/>'
)
CAR = (
    '<Vehicle name="car" vehicleCategory="car" mass="1500"><BoundingBox><Center x="1" y="0" z="1"/>'
    '<Dimensions width="2" length="5" height="2"/></BoundingBox><Performance maxSpeed="70" '
    'maxDeceleration="8" maxAcceleration="5"/><Axles><RearAxle maxSteering="0" wheelDiameter="1" '
    'trackWidth="2" positionX="0" positionZ="0"/></Axles></Vehicle>'
)
GOOD = f"""<OpenSCENARIO>
{HEADER}
<ParameterDeclarations>
<ParameterDeclaration name="speed" parameterType="double" value="10"/>
</ParameterDeclarations>
<CatalogLocations><RouteCatalog><Directory path="routes"/></RouteCatalog></CatalogLocations>
<RoadNetwork/>
<Entities>
<ScenarioObject name="Ego">{CAR}</ScenarioObject>
</Entities>
<Storyboard>
<Init><Actions/></Init>
<Story name="story"><Act name="act">
<ManeuverGroup name="group" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="Ego"/></Actors>
<Maneuver name="cut in"><Event name="event" priority="overwrite">
<Action name="faster"><PrivateAction><LongitudinalAction><SpeedAction>
<SpeedActionDynamics dynamicsDimension="time" dynamicsShape="step" value="0"/>
<SpeedActionTarget><AbsoluteTargetSpeed value="${{$speed / 3.6}}"/></SpeedActionTarget>
</SpeedAction></LongitudinalAction></PrivateAction></Action>
<StartTrigger><ConditionGroup><Condition name="c" conditionEdge="rising" delay="1">
<ByValueCondition><SimulationTimeCondition rule="greaterThan" value="2"/></ByValueCondition>
</Condition></ConditionGroup></StartTrigger>
</Event></Maneuver></ManeuverGroup></Act></Story>
</Storyboard>
</OpenSCENARIO>
"""
BY_TIME = '<SimulationTimeCondition rule="greaterThan" value="2"/>'
EGO_REF = '<EntityRef entityRef="Ego"/>'
ROUTE = f"""<OpenSCENARIO>
{HEADER}
<Catalog name="Routes"><Route name="A" closed="false">
<Waypoint routeStrategy="fastest"><Position><RoutePosition><RouteRef>
<CatalogReference catalogName="Routes" entryName="A"/>
</RouteRef><InRoutePosition><FromCurrentEntity entityRef="Ego"/></InRoutePosition></RoutePosition>
</Position></Waypoint>
<Waypoint routeStrategy="fastest"><Position><WorldPosition x="1" y="2"/></Position></Waypoint>
</Route></Catalog>
</OpenSCENARIO>
"""
TELEPORT = (
    '<Init><Actions><Private entityRef="Ego"><PrivateAction><RoutingAction><AssignRouteAction>'
    '<CatalogReference catalogName="Routes" entryName="{}"/>'
    "</AssignRouteAction></RoutingAction></PrivateAction></Private></Actions></Init>"
)


def state_of(name: str) -> str:
    return (
        '<StoryboardElementStateCondition storyboardElementType="maneuver" '
        f'storyboardElementRef="{name}" state="completeState"/>'
    )


MISTAKES = [
    ('revMinor="3"', 'revMinor="4"', 2, "version 1.4"),
    ('revMajor="1"', 'revMajor="2"', 2, "version 2.3"),
    ('revMinor="3"', 'revMinor="0"', 9, "since version 1.1"),
    ("<RoadNetwork/>", "<RoadNetwork/><Rood/>", 7, "no element Rood"),
    ('<Story name="story">', '<Story nam="story" name="s">', 13, "no attribute nam"),
    ('<Act name="act">', "<Act>", 13, "lacks its attribute name"),
    ("<RoadNetwork/>", "", 1, "lacks RoadNetwork"),
    ("/ 3.6", "/ 0", 19, "divides by zero"),
    ("$speed", "$spead", 19, r"\$spead in .* is not declared"),
    ('value="${$speed / 3.6}"', 'value="NaN"', 19, "NaN"),
    ('value="10"', 'value="fast"', 4, "'fast' is no number"),
    ('value="10"', 'value="$speed"', 4, "not declared"),
    ('priority="overwrite"', 'priority="first"', 16, "'first' is none of"),
    (EGO_REF, '<EntityRef entityRef="Ega"/>', 15, "no entity is named 'Ega'"),
    (BY_TIME, state_of("cut out"), 22, "no maneuver is named 'cut out'"),
    (
        BY_TIME,
        '<VariableCondition variableRef="v" rule="equalTo" value="1"/>',
        22,
        "no variable is named 'v'",
    ),
    (
        "</ScenarioObject>\n",
        "</ScenarioObject>\n"
        '<ScenarioObject name="Ego"><ExternalObjectReference name="b"/></ScenarioObject>\n',
        10,
        "'Ego' is given to a second",
    ),
    ('path="routes"', 'path="nowhere"', 6, "catalog folder 'nowhere' is missing"),
    ("<Init><Actions/></Init>", TELEPORT.format("B"), 12, "has no entry 'B'"),
    (
        "<RoadNetwork/>",
        '<RoadNetwork><LogicFile filepath="r.xodr"/></RoadNetwork>',
        7,
        "r.xodr",
    ),
    ("<OpenSCENARIO>", "<!DOCTYPE x>\n<OpenSCENARIO>", 2, "document type"),
    ("</Storyboard>", "", 26, "mismatch"),
]
"""What of :data:`GOOD` is replaced, by what, the line that is named, and words of the message."""
_ENTITIES = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
LAUGHS = f'<!DOCTYPE x [<!ENTITY e0 "ha">{_ENTITIES}]><OpenSCENARIO>&e9;</OpenSCENARIO>'
"""A billion of words from a few lines."""


BOMB = b"""<?xml version="1.0"?>
<!DOCTYPE OpenDRIVE [
 <!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;">
]>
<OpenDRIVE><header revMajor="1" revMinor="6" name="&c;"/></OpenDRIVE>
"""

BROKEN_ROADS = {
    "empty": (b"", ":1: "),
    "no XML": (b"\x00\x01\x02", ":1: "),
    "cut off": (xodr()[:-20], ":16: "),
    "another root": (b"<?xml version='1.0'?>\n<OpenSCENARIO/>", ":2: the root element is"),
    "entities": (BOMB, ":5: a document type (DOCTYPE) is not read"),
    "too deep": (b"<OpenDRIVE>" + b"<a>" * 60, "nest deeper than 32"),
    "no header": (b"<OpenDRIVE/>", "<header> is missing"),
    "an old version": (xodr(version=(1, 3)), "version 1.3; 1.4 to 1.8 are read"),
    "an unknown version": (xodr(version=(1, "x")), ":3: "),
    "NaN": (xodr(road(plan=geometry(LINE, 100.0, at=(float("nan"), 0.0, 0.0)))), "nan"),
    "a negative length": (xodr(road(plan=geometry(LINE, -5.0))), "-5"),
    "a road without end": (xodr(road(plan=geometry(LINE, 60.0))), "100"),
    "an unknown element": (xodr(road(more="<teleport/>")), "<teleport>"),
    "an unknown shape": (xodr(road(plan=geometry("<bezier/>", 100.0))), "<bezier>"),
    "a link to nowhere": (xodr(road(link=end("successor", "road", "7", "start"))), "7"),
    "the same id twice": (xodr(road(), road()), "a second time"),
    "sections out of order": (xodr(road(lanes=section(50.0) + section(0.0))), ":"),
    "a width that is none": (
        xodr(road(lanes=section(right=lane(-1, WIDTH.replace("3.5", "wide"))))),
        "'wide'",
    ),
}
"""Content of a file, and words of what is said of it."""
