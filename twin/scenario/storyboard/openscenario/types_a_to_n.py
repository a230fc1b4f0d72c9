"""Element types of OpenSCENARIO XML from A to N; :mod:`.standard` explains the notation."""

TYPES = """
AbsoluteSpeed: value=d / TargetDistanceSteadyState>1|TargetTimeSteadyState>1|?
AbsoluteTargetLane: value=s
AbsoluteTargetLaneOffset: value=d
AbsoluteTargetSpeed: value=d
AccelerationCondition: rule=Rule value=d direction=DirectionalDimension?>2
AcquirePositionAction:  / Position
Act: name=s / ManeuverGroup+ StartTrigger:Trigger? StopTrigger:Trigger?
Action: name=s / GlobalAction|UserDefinedAction|PrivateAction
ActivateControllerAction: controllerRef=s?>2 objectControllerRef=s?>3 lateral=b? longitudinal=b?
  animation=b?>2 lighting=b?>2
Actors: selectTriggeringEntities=b / EntityRef*
AddEntityAction:  / Position
AngleCondition>3: angleType=AngleType angle=d angleTolerance=d
  coordinateSystem=CoordinateSystem?
AnimationAction>2: loop=b? animationDuration=d? / AnimationType AnimationState?
AnimationFile>2: timeOffset=d? / File
AnimationState>2: state=d
AnimationType>2:  / ComponentAnimation|PedestrianAnimation|AnimationFile|UserDefinedAnimation
AppearanceAction>2:  / LightStateAction|AnimationAction
AssignControllerAction: activateLateral=b?>1 activateLongitudinal=b?>1 activateAnimation=b?>2
  activateLighting=b?>2 / Controller?|CatalogReference?|ObjectController?>3
AssignRouteAction:  / Route|CatalogReference
AutomaticGear>2: gear=AutomaticGearType
Axle: maxSteering=d positionX=d positionZ=d trackWidth=d wheelDiameter=d
Axles:  / FrontAxle:Axle? RearAxle:Axle AdditionalAxle:Axle*
BoundingBox:  / Center Dimensions
Brake>2: value=d maxRate=d?
ByEntityCondition:  / TriggeringEntities EntityCondition
ByObjectType: type=ObjectType
ByType: objectType=ObjectType
ByValueCondition:  / ParameterCondition|TimeOfDayCondition|SimulationTimeCondition|
  StoryboardElementStateCondition|UserDefinedValueCondition|TrafficSignalCondition|
  TrafficSignalControllerCondition|VariableCondition>2
Catalog: name=s? / Vehicle* Controller* Pedestrian* MiscObject* Environment* Maneuver*
  Trajectory* Route*
CatalogLocations:  / VehicleCatalog:VehicleCatalogLocation?
  ControllerCatalog:ControllerCatalogLocation? PedestrianCatalog:PedestrianCatalogLocation?
  MiscObjectCatalog:MiscObjectCatalogLocation? EnvironmentCatalog:EnvironmentCatalogLocation?
  ManeuverCatalog:ManeuverCatalogLocation? TrajectoryCatalog:TrajectoryCatalogLocation?
  RouteCatalog:RouteCatalogLocation?
CatalogReference: catalogName=s entryName=s / ParameterAssignments?
Center: x=d y=d z=d
CentralSwarmObject: entityRef=s
Clothoid: curvature=d curvatureDot=d? length=d startTime=d? stopTime=d? curvaturePrime=d?>1 /
  Position
ClothoidSpline>3: timeEnd=d? / ClothoidSplineSegment+
ClothoidSplineSegment>3: curvatureStart=d curvatureEnd=d length=d hOffset=d? timeStart=d? /
  PositionStart:Position?
CollisionCondition:  / EntityRef|ByType:ByObjectType
Color>2: colorType=ColorType / ColorRgb|ColorCmyk
ColorCmyk>2: cyan=d magenta=d yellow=d key=d
ColorRgb>2: red=d green=d blue=d
ComponentAnimation>2:  / VehicleComponent|UserDefinedComponent
Condition: conditionEdge=ConditionEdge delay=d name=s / ByEntityCondition|ByValueCondition
ConditionGroup:  / Condition+
ConnectTrailerAction>3: trailerRef=s
Controller: name=s controllerType=ControllerType?>2 / ParameterDeclarations? Properties?
ControllerAction:  / AssignControllerAction|OverrideControllerValueAction|
  ActivateControllerAction>1
ControllerCatalogLocation:  / Directory
ControllerDistribution:  / ControllerDistributionEntry+
ControllerDistributionEntry: weight=d / Controller|CatalogReference
ControlPoint: time=d? weight=d? / Position
CustomCommandAction: "text" type=s
CustomContent>2: "text"
DeleteEntityAction:
Deterministic>1:  / DeterministicMultiParameterDistribution*
  DeterministicSingleParameterDistribution*
DeterministicMultiParameterDistribution>1:  / ValueSetDistribution
DeterministicSingleParameterDistribution>1: parameterName=s / DistributionSet|
  DistributionRange|UserDefinedDistribution
Dimensions: height=d length=d width=d
DirectionOfTravelDistribution>2: same=d opposite=d
Directory: path=s
DisconnectTrailerAction>3:
DistanceCondition: alongRoute=b? freespace=b rule=Rule value=d
  coordinateSystem=CoordinateSystem?>1 relativeDistanceType=RelativeDistanceType?>1
  routingAlgorithm=RoutingAlgorithm?>2 / Position
DistributionRange>1: stepWidth=d / Range
DistributionSet>1:  / Element:DistributionSetElement+
DistributionSetElement>1: value=s
DomeImage>2: azimuthOffset=d? / DomeFile:File
DynamicConstraints: maxAcceleration=d? maxAccelerationRate=d?>2 maxDeceleration=d?
  maxDecelerationRate=d?>2 maxSpeed=d?
EndOfRoadCondition: duration=d
Entities:  / ScenarioObject* EntitySelection*
EntityAction: entityRef=s / AddEntityAction|DeleteEntityAction
EntityCondition:  / EndOfRoadCondition|CollisionCondition|OffroadCondition|
  TimeHeadwayCondition|TimeToCollisionCondition|AccelerationCondition|StandStillCondition|
  SpeedCondition|RelativeSpeedCondition|TraveledDistanceCondition|ReachPositionCondition|
  DistanceCondition|RelativeDistanceCondition|RelativeClearanceCondition>2|AngleCondition>3|
  RelativeAngleCondition>3
EntityDistribution>3:  / EntityDistributionEntry+
EntityDistributionEntry>3: weight=d / ScenarioObjectTemplate
EntityRef: entityRef=s
EntitySelection: name=s / Members:SelectedEntities
Environment: name=s / ParameterDeclarations? TimeOfDay? Weather? RoadCondition?
EnvironmentAction:  / Environment|CatalogReference
EnvironmentCatalogLocation:  / Directory
Event: maximumExecutionCount=u? name=s priority=Priority / Action+ StartTrigger:Trigger?
ExternalObjectReference>1: name=s
File: filepath=s
FileHeader: author=s date=t description=s revMajor=u revMinor=u / License?>1 Properties?>2
FinalSpeed:  / AbsoluteSpeed|RelativeSpeedToMaster
Fog: visualRange=d / BoundingBox?
FollowTrajectoryAction: initialDistanceOffset=d?>1 / Trajectory? CatalogReference? TimeReference
  TrajectoryFollowingMode TrajectoryRef?>1
GeoPosition>1: latitude=d? longitude=d? height=d? latitudeDeg=d?>2 longitudeDeg=d?>2
  altitude=d?>2 verticalRoadSelection=i?>3 / Orientation?
GlobalAction:  / EnvironmentAction|EntityAction|InfrastructureAction|SetMonitorAction>3|
  ParameterAction|TrafficAction|VariableAction>2
Histogram>1:  / Bin:HistogramBin+
HistogramBin>1: weight=d / Range
InfrastructureAction:  / TrafficSignalAction
Init:  / Actions:InitActions
InitActions:  / GlobalAction* UserDefinedAction* Private*
InRoutePosition:  / FromCurrentEntity:PositionOfCurrentEntity|
  FromRoadCoordinates:PositionInRoadCoordinates|FromLaneCoordinates:PositionInLaneCoordinates
Knot: value=d
Lane>3: id=i
LaneChangeAction: targetLaneOffset=d? / LaneChangeActionDynamics:TransitionDynamics
  LaneChangeTarget
LaneChangeTarget:  / RelativeTargetLane|AbsoluteTargetLane
LaneOffsetAction: continuous=b / LaneOffsetActionDynamics LaneOffsetTarget
LaneOffsetActionDynamics: dynamicsShape=DynamicsShape maxLateralAcc=d?
LaneOffsetTarget:  / RelativeTargetLaneOffset|AbsoluteTargetLaneOffset
LanePosition: laneId=s offset=d? roadId=s s=d / Orientation?
LateralAction:  / LaneChangeAction|LaneOffsetAction|LateralDistanceAction
LateralDistanceAction: entityRef=s continuous=b distance=d? freespace=b
  displacement=LateralDisplacement?>1 coordinateSystem=CoordinateSystem?>1 / DynamicConstraints?
License>1: "text" name=s resource=s? spdxId=s?
LightState>2: mode=LightMode luminousIntensity=d? flashingOnDuration=d? flashingOffDuration=d? /
  Color?
LightStateAction>2: transitionTime=d? / LightType LightState
LightType>2:  / VehicleLight|UserDefinedLight
LogNormalDistribution>3: expectedValue=d variance=d / Range?
LongitudinalAction:  / SpeedAction|LongitudinalDistanceAction|SpeedProfileAction>2
LongitudinalDistanceAction: entityRef=s continuous=b distance=d? freespace=b timeGap=d?
  displacement=LongitudinalDisplacement?>1 coordinateSystem=CoordinateSystem?>1 /
  DynamicConstraints?
Maneuver: name=s / ParameterDeclarations? Event+
ManeuverCatalogLocation:  / Directory
ManeuverGroup: maximumExecutionCount=u name=s / Actors CatalogReference* Maneuver*
ManualGear>2: number=i
MiscObject: mass=d miscObjectCategory=MiscObjectCategory name=s model3d=s?>1 /
  ParameterDeclarations? BoundingBox Properties?
MiscObjectCatalogLocation:  / Directory
ModifyRule:  / AddValue:ParameterAddValueRule|MultiplyByValue:ParameterMultiplyByValueRule
MonitorDeclaration>3: name=s value=b
MonitorDeclarations>3:  / MonitorDeclaration*
None:
NormalDistribution>1: expectedValue=d variance=d / Range?
Nurbs: order=u / ControlPoint{2} Knot{2}
"""
