"""Element types of OpenSCENARIO XML from O to Z; :mod:`.standard` explains the notation."""

TYPES = """
ObjectController: name=s?>3 / CatalogReference|Controller
OffroadCondition: duration=d
Orientation: h=d? p=d? r=d? type=ReferenceContext?
OverrideBrakeAction: active=b value=d? / BrakePercent:Brake>2|BrakeForce:Brake>2|?
OverrideClutchAction: active=b value=d maxRate=d?>2
OverrideControllerValueAction:  / Throttle:OverrideThrottleAction? Brake:OverrideBrakeAction?
  Clutch:OverrideClutchAction? ParkingBrake:OverrideParkingBrakeAction?
  SteeringWheel:OverrideSteeringWheelAction? Gear:OverrideGearAction?
OverrideGearAction: active=b number=d? / ManualGear>2|AutomaticGear>2|?
OverrideParkingBrakeAction: active=b value=d? / BrakePercent:Brake>2|BrakeForce:Brake>2|?
OverrideSteeringWheelAction: active=b value=d maxRate=d?>2 maxTorque=d?>2
OverrideThrottleAction: active=b value=d maxRate=d?>2
ParameterAction: parameterRef=s / SetAction:ParameterSetAction|
  ModifyAction:ParameterModifyAction
ParameterAddValueRule: value=d
ParameterAssignment: parameterRef=s value=s
ParameterAssignments:  / ParameterAssignment*
ParameterCondition: parameterRef=s rule=Rule value=s
ParameterDeclaration: name=s parameterType=ParameterType value=s /
  ConstraintGroup:ValueConstraintGroup*>1
ParameterDeclarations:  / ParameterDeclaration*
ParameterModifyAction:  / Rule:ModifyRule
ParameterMultiplyByValueRule: value=d
ParameterSetAction: value=s
ParameterValueDistribution>1:  / ScenarioFile:File Deterministic|Stochastic
ParameterValueSet>1:  / ParameterAssignment+
Pedestrian: mass=d model=s? name=s pedestrianCategory=PedestrianCategory model3d=s?>1
  role=Role?>2 / ParameterDeclarations? BoundingBox Properties?
PedestrianAnimation>2: motion=PedestrianMotionType? userDefinedPedestrianAnimation=s? /
  PedestrianGesture*
PedestrianCatalogLocation:  / Directory
PedestrianGesture>2: gesture=PedestrianGestureType
Performance: maxAcceleration=d maxAccelerationRate=d?>2 maxDeceleration=d
  maxDecelerationRate=d?>2 maxSpeed=d
Phase: duration=d name=s / TrafficSignalState* TrafficSignalGroupState?>3
  TrafficeSignalGroupState:TrafficSignalGroupState?<2
PoissonDistribution>1: expectedValue=d / Range?
Polygon>3:  / Position{3}
Polyline:  / Vertex{2}
Position:  / WorldPosition|RelativeWorldPosition|RelativeObjectPosition|RoadPosition|
  RelativeRoadPosition|LanePosition|RelativeLanePosition|RoutePosition|GeoPosition>1|
  TrajectoryPosition>1
PositionInLaneCoordinates: laneId=s laneOffset=d? pathS=d
PositionInRoadCoordinates: pathS=d t=d
PositionOfCurrentEntity: entityRef=s
Precipitation: intensity=d? precipitationType=PrecipitationType precipitationIntensity=d?>1
Private: entityRef=s / PrivateAction+
PrivateAction:  / LongitudinalAction|LateralAction|VisibilityAction|SynchronizeAction|
  ActivateControllerAction|ControllerAction|TeleportAction|RoutingAction|AppearanceAction>2|
  TrailerAction>3
ProbabilityDistributionSet>1:  / Element:ProbabilityDistributionSetElement+
ProbabilityDistributionSetElement>1: value=s weight=d
Properties:  / Property* File* CustomContent*>2
Property: name=s value=s
RandomRouteAction>3:
Range>1: lowerLimit=d upperLimit=d
ReachPositionCondition: tolerance=d / Position
RelativeAngleCondition>3: entityRef=s angleType=AngleType angle=d angleTolerance=d
  coordinateSystem=CoordinateSystem?
RelativeClearanceCondition>2: oppositeLanes=b distanceForward=d? distanceBackward=d? freeSpace=b
  / RelativeLaneRange* EntityRef*
RelativeDistanceCondition: entityRef=s freespace=b relativeDistanceType=RelativeDistanceType
  rule=Rule value=d coordinateSystem=CoordinateSystem?>1 routingAlgorithm=RoutingAlgorithm?>2
RelativeLanePosition: entityRef=s dLane=i ds=d? offset=d? dsLane=d?>1 / Orientation?
RelativeLaneRange>2: from=i? to=i?
RelativeObjectPosition: entityRef=s dx=d dy=d dz=d? / Orientation?
RelativeRoadPosition: entityRef=s ds=d dt=d / Orientation?
RelativeSpeedCondition: entityRef=s rule=Rule value=d direction=DirectionalDimension?>2
RelativeSpeedToMaster: speedTargetValueType=SpeedTargetValueType value=d /
  TargetDistanceSteadyState>1|TargetTimeSteadyState>1|?
RelativeTargetLane: entityRef=s value=i
RelativeTargetLaneOffset: entityRef=s value=d
RelativeTargetSpeed: entityRef=s continuous=b speedTargetValueType=SpeedTargetValueType value=d
RelativeWorldPosition: entityRef=s dx=d dy=d dz=d? / Orientation?
RoadCondition: frictionScaleFactor=d wetness=Wetness?>2 / Properties?
RoadCursor>3: roadId=s s=d? / Lane*
RoadNetwork:  / LogicFile:File? SceneGraphFile:File? TrafficSignals? UsedArea?>1
RoadPosition: roadId=s s=d t=d / Orientation?
RoadRange>3: length=d? / RoadCursor{2}
Route: closed=b name=s / ParameterDeclarations? Waypoint{2}
RouteCatalogLocation:  / Directory
RoutePosition:  / RouteRef Orientation? InRoutePosition
RouteRef:  / Route|CatalogReference
RoutingAction:  / AssignRouteAction|FollowTrajectoryAction|AcquirePositionAction|
  RandomRouteAction>3
ScenarioObject: name=s / CatalogReference|Vehicle|Pedestrian|MiscObject|
  ExternalObjectReference>1 ObjectController*
ScenarioObjectTemplate>3:  / CatalogReference|Vehicle|Pedestrian|MiscObject|
  ExternalObjectReference ObjectController*
SelectedEntities:  / EntityRef+|ByType+
SensorReference>2: name=s
SensorReferenceSet>2:  / SensorReference+
SetMonitorAction>3: monitorRef=s value=b
Shape:  / Polyline|Clothoid|ClothoidSpline>3|Nurbs
SimulationTimeCondition: rule=Rule value=d
SpeedAction:  / SpeedActionDynamics:TransitionDynamics SpeedActionTarget
SpeedActionTarget:  / RelativeTargetSpeed|AbsoluteTargetSpeed
SpeedCondition: rule=Rule value=d direction=DirectionalDimension?>2
SpeedProfileAction>2: entityRef=s? followingMode=FollowingMode / DynamicConstraints?
  SpeedProfileEntry+
SpeedProfileEntry>2: speed=d time=d?
StandStillCondition: duration=d
Stochastic>1: numberOfTestRuns=u randomSeed=d? / StochasticDistribution+
StochasticDistribution>1: parameterName=s / ProbabilityDistributionSet|NormalDistribution|
  LogNormalDistribution>3|UniformDistribution|PoissonDistribution|Histogram|
  UserDefinedDistribution
Story: name=s / ParameterDeclarations? Act+
Storyboard:  / Init Story* StopTrigger:Trigger?
StoryboardElementStateCondition: storyboardElementRef=s state=StoryboardElementState
  storyboardElementType=StoryboardElementType
Sun: azimuth=d elevation=d intensity=d? illuminance=d?>2
SynchronizeAction: masterEntityRef=s targetToleranceMaster=d?>1 targetTolerance=d?>1 /
  TargetPositionMaster:Position TargetPosition:Position FinalSpeed?
TargetDistanceSteadyState>1: distance=d
TargetTimeSteadyState>1: time=d
TeleportAction:  / Position
TimeHeadwayCondition: entityRef=s alongRoute=b? freespace=b rule=Rule value=d
  coordinateSystem=CoordinateSystem?>1 relativeDistanceType=RelativeDistanceType?>1
  routingAlgorithm=RoutingAlgorithm?>2
TimeOfDay: animation=b dateTime=t
TimeOfDayCondition: dateTime=t rule=Rule
TimeReference:  / None|Timing
TimeToCollisionCondition: alongRoute=b? freespace=b rule=Rule value=d
  relativeDistanceType=RelativeDistanceType?>1 coordinateSystem=CoordinateSystem?>1
  routingAlgorithm=RoutingAlgorithm?>2 / TimeToCollisionConditionTarget
TimeToCollisionConditionTarget:  / Position|EntityRef
Timing: domainAbsoluteRelative=ReferenceContext offset=d scale=d
TrafficAction: trafficName=s?>1 / TrafficSourceAction|TrafficSinkAction|TrafficSwarmAction|
  TrafficAreaAction>3|TrafficStopAction>1
TrafficArea>3:  / Polygon|RoadRange+
TrafficAreaAction>3: numberOfEntities=u continuous=b / TrafficDistribution TrafficArea
TrafficDefinition: name=s / VehicleCategoryDistribution VehicleRoleDistribution?>2
  ControllerDistribution
TrafficDistribution>3:  / TrafficDistributionEntry+
TrafficDistributionEntry>3: weight=d / EntityDistribution Properties?
TrafficSignalAction:  / TrafficSignalControllerAction|TrafficSignalStateAction
TrafficSignalCondition: name=s state=s
TrafficSignalController: delay=d? name=s reference=s? / Phase*
TrafficSignalControllerAction: trafficSignalControllerRef=s phase=s
TrafficSignalControllerCondition: trafficSignalControllerRef=s phase=s
TrafficSignalGroupState>2: state=s
TrafficSignals:  / TrafficSignalController*
TrafficSignalState: state=s trafficSignalId=s
TrafficSignalStateAction: name=s state=s
TrafficSinkAction: radius=d rate=d? / Position TrafficDefinition?
TrafficSourceAction: radius=d rate=d velocity=d? speed=d?>2 / Position TrafficDefinition?
  TrafficDistribution?>3
TrafficStopAction>1:
TrafficSwarmAction: innerRadius=d numberOfVehicles=u offset=d semiMajorAxis=d semiMinorAxis=d
  velocity=d? / CentralObject:CentralSwarmObject TrafficDefinition? TrafficDistribution?>3
  InitialSpeedRange:Range?>2 DirectionOfTravelDistribution?>2
Trailer>3:  / Trailer:ScenarioObject|TrailerRef:EntityRef
TrailerAction>3:  / ConnectTrailerAction|DisconnectTrailerAction
TrailerCoupler>3: dx=d dz=d?
TrailerHitch>3: dx=d dz=d?
Trajectory: closed=b name=s / ParameterDeclarations? Shape
TrajectoryCatalogLocation:  / Directory
TrajectoryFollowingMode: followingMode=FollowingMode
TrajectoryPosition>1: s=d t=d? / Orientation? TrajectoryRef
TrajectoryRef>1:  / Trajectory|CatalogReference
TransitionDynamics: dynamicsDimension=DynamicsDimension dynamicsShape=DynamicsShape
  followingMode=FollowingMode?>2 value=d
TraveledDistanceCondition: value=d
Trigger:  / ConditionGroup*
TriggeringEntities: triggeringEntitiesRule=TriggeringEntitiesRule / EntityRef+
UniformDistribution>1:  / Range
UsedArea>1:  / Position{2}
UserDefinedAction:  / CustomCommandAction
UserDefinedAnimation>2: userDefinedAnimationType=s
UserDefinedComponent>2: userDefinedComponentType=s
UserDefinedDistribution>1: "text" type=s
UserDefinedLight>2: userDefinedLightType=s
UserDefinedValueCondition: name=s rule=Rule value=s
ValueConstraint>1: rule=Rule value=s
ValueConstraintGroup>1:  / ValueConstraint+
ValueSetDistribution>1:  / ParameterValueSet+
VariableAction>2: variableRef=s / SetAction:VariableSetAction|ModifyAction:VariableModifyAction
VariableAddValueRule>2: value=d
VariableCondition>2: variableRef=s rule=Rule value=s
VariableDeclaration>2: name=s variableType=ParameterType value=s
VariableDeclarations>2:  / VariableDeclaration*
VariableModifyAction>2:  / Rule:VariableModifyRule
VariableModifyRule>2:  / AddValue:VariableAddValueRule|
  MultiplyByValue:VariableMultiplyByValueRule
VariableMultiplyByValueRule>2: value=d
VariableSetAction>2: value=s
Vehicle: name=s vehicleCategory=VehicleCategory role=Role?>2 mass=d?>1 model3d=s?>1 /
  ParameterDeclarations? BoundingBox Performance Axles Properties? TrailerHitch?>3
  TrailerCoupler?>3 Trailer?>3
VehicleCatalogLocation:  / Directory
VehicleCategoryDistribution:  / VehicleCategoryDistributionEntry+
VehicleCategoryDistributionEntry: category=VehicleCategory weight=d
VehicleComponent>2: vehicleComponentType=VehicleComponentType
VehicleLight>2: vehicleLightType=VehicleLightType
VehicleRoleDistribution>2:  / VehicleRoleDistributionEntry+
VehicleRoleDistributionEntry>2: role=Role weight=d
Vertex: time=d? / Position
VisibilityAction: graphics=b sensors=b traffic=b / SensorReferenceSet?>2
Waypoint: routeStrategy=RouteStrategy / Position
Weather: cloudState=CloudState? atmosphericPressure=d?>1 temperature=d?>1
  fractionalCloudCover=FractionalCloudCover?>2 / Sun? Fog? Precipitation? Wind?>1 DomeImage?>2
Wind>1: direction=d speed=d
WorldPosition: h=d? p=d? r=d? x=d y=d z=d?
"""
