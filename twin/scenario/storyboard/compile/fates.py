"""What happens with every element type: the one table of handlers, and what has none and why."""

from __future__ import annotations

from collections.abc import Mapping

from twin.scenario.storyboard.compile.actions import ACTIONS
from twin.scenario.storyboard.compile.conditions import CONDITIONS
from twin.scenario.storyboard.compile.context import Handler
from twin.scenario.storyboard.compile.entities import ENTITIES
from twin.scenario.storyboard.compile.environments import ENVIRONMENTS
from twin.scenario.storyboard.compile.motions import MOTIONS
from twin.scenario.storyboard.compile.places import POSITIONS
from twin.scenario.storyboard.compile.routes import ROUTES
from twin.scenario.storyboard.compile.signals import SIGNALS
from twin.scenario.storyboard.compile.trailers import TRAILERS
from twin.scenario.storyboard.compile.trajectories import TRAJECTORIES
from twin.scenario.storyboard.openscenario.standard import REFUSED

HANDLERS: Mapping[str, Handler] = {
    **ENTITIES,
    **POSITIONS,
    **TRAJECTORIES,
    **ROUTES,
    **CONDITIONS,
    **MOTIONS,
    **ACTIONS,
    **ENVIRONMENTS,
    **SIGNALS,
    **TRAILERS,
}
"""Handlers by element type."""

REFUSED_TYPES: Mapping[str, str] = {
    **REFUSED,
    "ExternalObjectReference": "objects of other files are not known",
    "OverrideControllerValueAction": "pedals of a controller are not overridden",
    "PositionOfCurrentEntity": "a place on a route that moves with an entity is not played",
    "RandomRouteAction": "routes are not drawn at random; assign one",
    "SensorReferenceSet": "visibility for single sensors is not played",
    "TrafficAction": "traffic is not generated; give every entity by name",
    "UserDefinedLight": "only lamps of the standard are known",
}
"""Element types that are refused where they stand in a scenario, with the reason."""

NO_EFFECT: Mapping[str, str] = {
    "AnimationAction": "bodies move by their speed",
    "Color": "lamps have the colour of their kind",
    "CustomContent": "it is for other tools",
    "DomeImage": "the sky follows the sun and the clouds",
    "UsedArea": "the whole road network is used",
}
"""Element types without effect, with the reason; each is noted."""

NO_EFFECT_NAMES: Mapping[str, str] = {
    "SceneGraphFile": "roads are drawn from the road network",
}
"""Elements without effect whose type others share, by name."""

NO_EFFECT_ATTRIBUTES: Mapping[tuple[str, str], str] = {
    ("ActivateControllerAction", "controllerRef"): "the default controller drives",
    ("ActivateControllerAction", "objectControllerRef"): "the default controller drives",
    ("ActivateControllerAction", "animation"): "it is not controlled by controllers",
    ("ActivateControllerAction", "lighting"): "it is not controlled by controllers",
    ("AssignControllerAction", "activateAnimation"): "it is not controlled by controllers",
    ("AssignControllerAction", "activateLighting"): "it is not controlled by controllers",
    ("RelativeAngleCondition", "coordinateSystem"): "the angle is the one between both entities",
    ("Orientation", "p"): "bodies stand as the road does",
    ("Orientation", "r"): "bodies stand as the road does",
    ("WorldPosition", "p"): "bodies stand as the road does",
    ("WorldPosition", "r"): "bodies stand as the road does",
    ("DistanceCondition", "routingAlgorithm"): "distances follow the road",
    ("RelativeDistanceCondition", "routingAlgorithm"): "distances follow the road",
    ("TimeHeadwayCondition", "routingAlgorithm"): "distances follow the road",
    ("TimeToCollisionCondition", "routingAlgorithm"): "distances follow the road",
    ("Performance", "maxAccelerationRate"): "only actions limit how acceleration changes",
    ("Performance", "maxDecelerationRate"): "only actions limit how acceleration changes",
    ("TransitionDynamics", "followingMode"): "transitions are exact",
    ("LightState", "luminousIntensity"): "lamps are as bright as their kind",
    ("LightStateAction", "transitionTime"): "lamps change at once",
    ("Weather", "atmosphericPressure"): "the air is as dense as ever",
    ("Weather", "temperature"): "nothing freezes or melts",
    ("GeoPosition", "verticalRoadSelection"): "of roads above one another the nearest counts",
    ("TrailerCoupler", "dz"): "trailers stand on the road",
    ("TrailerHitch", "dz"): "trailers stand on the road",
}
"""Attributes without effect, with the reason; each is noted, unless it is 0 or false."""

DESCRIBED_ATTRIBUTES: Mapping[tuple[str, str], str] = {
    ("Axle", "maxSteering"): "the way of a vehicle is not limited by its steering",
    ("Axle", "positionZ"): "wheels stand on the road",
    ("Axle", "trackWidth"): "bodies have wheels of their own",
    ("Axle", "wheelDiameter"): "bodies have wheels of their own",
    ("MiscObject", "miscObjectCategory"): "every object is an obstacle",
    ("MiscObject", "model3d"): "bodies have looks of their own",
    ("Pedestrian", "model"): "bodies have looks of their own",
    ("Pedestrian", "model3d"): "bodies have looks of their own",
    ("Pedestrian", "role"): "it changes nothing",
    ("Vehicle", "model3d"): "bodies have looks of their own",
    ("Vehicle", "role"): "it changes nothing",
}
"""Attributes that only describe, with the reason; not noted, because every catalog has them."""

STRUCTURE = frozenset(
    {
        *("Act", "Action", "Actors", "AbsoluteSpeed", "AbsoluteTargetLane", "AddEntityAction"),
        *("AbsoluteTargetLaneOffset", "AbsoluteTargetSpeed", "Axle", "Axles", "BoundingBox"),
        *("ByEntityCondition", "ByObjectType", "ByType", "ByValueCondition", "Center"),
        *("ClothoidSplineSegment", "Condition", "ConditionGroup", "ControlPoint"),
        *("DeleteEntityAction", "Dimensions", "DynamicConstraints", "Entities"),
        *("EntityCondition", "EntityRef", "EntitySelection", "Event", "FinalSpeed", "Fog"),
        *("InRoutePosition", "Init", "InitActions", "Knot", "LaneChangeTarget"),
        *("LaneOffsetActionDynamics", "LaneOffsetTarget", "LightState", "LightType"),
        *("Maneuver", "ManeuverGroup", "ModifyRule", "MonitorDeclaration", "None"),
        *("ObjectController", "Orientation", "ParameterAddValueRule", "ParameterModifyAction"),
        *("Phase", "RelativeLaneRange", "TrafficSignalController", "TrafficSignalState"),
        "TrafficSignalGroupState",
        *("TrafficSignals", "Trailer", "TrailerCoupler", "TrailerHitch"),
        *("ParameterMultiplyByValueRule", "ParameterSetAction", "Performance", "Position"),
        *("PositionInLaneCoordinates", "PositionInRoadCoordinates", "Precipitation", "Private"),
        *("RelativeSpeedToMaster", "RelativeTargetLane", "RelativeTargetLaneOffset"),
        *("RelativeTargetSpeed", "RoadCondition", "RoadNetwork", "RouteRef", "ScenarioObject"),
        *("SelectedEntities", "Shape", "SpeedActionTarget", "SpeedProfileEntry", "Story"),
        *("Storyboard", "Sun", "TargetDistanceSteadyState", "TargetTimeSteadyState"),
        *("TimeOfDay", "TimeReference", "TimeToCollisionConditionTarget", "Timing"),
        *("TrajectoryFollowingMode", "TrajectoryRef", "TransitionDynamics"),
        *("TriggeringEntities", "VariableAddValueRule", "VariableDeclaration"),
        *("VariableModifyAction", "VariableModifyRule", "VariableMultiplyByValueRule"),
        *("VariableSetAction", "VehicleLight", "Vertex", "Waypoint", "Weather", "Wind"),
    }
)
"""Element types that handlers of others read as a part of theirs."""


def fate_of(type_name: str, attribute: str = "") -> str:
    """What happens with an element type or one of its attributes: a word, often a reason."""
    if type_name in REFUSED_TYPES:
        return f"refused: {REFUSED_TYPES[type_name]}"
    if type_name in NO_EFFECT:
        return f"no effect: {NO_EFFECT[type_name]}"
    for table in (NO_EFFECT_ATTRIBUTES, DESCRIBED_ATTRIBUTES):
        if (type_name, attribute) in table:
            return f"no effect: {table[type_name, attribute]}"
    if type_name in HANDLERS or type_name in STRUCTURE:
        return "played"
    return "read"
