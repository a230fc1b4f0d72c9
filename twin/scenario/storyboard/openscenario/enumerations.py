"""Enumerations of OpenSCENARIO XML; ``>2``: since version 1.2."""

ENUMS = """
AngleType: heading pitch roll
AutomaticGearType: n p r d
CloudState: cloudy free overcast rainy skyOff
ColorType: other red yellow green blue violet orange brown black grey white
ConditionEdge: falling none rising risingOrFalling
ControllerType: lateral longitudinal lighting animation movement appearance all
CoordinateSystem: entity lane road trajectory world>3
DirectionalDimension: longitudinal lateral vertical
DynamicsDimension: distance rate time
DynamicsShape: cubic linear sinusoidal step
FollowingMode: follow position
FractionalCloudCover: zeroOktas oneOktas twoOktas threeOktas fourOktas fiveOktas sixOktas
  sevenOktas eightOktas nineOktas
LateralDisplacement: any leftToReferencedEntity rightToReferencedEntity
LightMode: on off flashing
LongitudinalDisplacement: any trailingReferencedEntity leadingReferencedEntity
MiscObjectCategory: barrier building crosswalk gantry none obstacle parkingSpace patch pole
  railing roadMark soundBarrier streetLamp trafficIsland tree vegetation wind
ObjectType: miscellaneous pedestrian vehicle external>1
ParameterType: boolean dateTime double integer string unsignedInt unsignedShort int>2
PedestrianCategory: animal pedestrian wheelchair
PedestrianGestureType: phoneCallRightHand phoneCallLeftHand phoneTextRightHand phoneTextLeftHand
  wavingRightArm wavingLeftArm umbrellaRightHand umbrellaLeftHand crossArms coffeeRightHand
  coffeeLeftHand sandwichRightHand sandwichLeftHand
PedestrianMotionType: standing sitting lying squatting walking running reeling crawling cycling
  jumping ducking bendingDown
PrecipitationType: dry rain snow
Priority: overwrite override>2 parallel skip
ReferenceContext: absolute relative
RelativeDistanceType: lateral longitudinal cartesianDistance euclidianDistance>1
Role: none ambulance civil fire military police publicTransport roadAssistance
RouteStrategy: fastest leastIntersections random shortest
RoutingAlgorithm: assignedRoute fastest leastIntersections shortest undefined
Rule: equalTo greaterThan lessThan greaterOrEqual>1 lessOrEqual>1 notEqualTo>1
SpeedTargetValueType: delta factor
StoryboardElementState: completeState endTransition runningState skipTransition standbyState
  startTransition stopTransition
StoryboardElementType: act action event maneuver maneuverGroup story
TriggeringEntitiesRule: all any
VehicleCategory: bicycle bus car motorbike semitrailer trailer train tram truck van
VehicleComponentType: hood trunk doorFrontRight doorFrontLeft doorRearRight doorRearLeft
  windowFrontRight windowFrontLeft windowRearRight windowRearLeft sideMirrors sideMirrorRight
  sideMirrorLeft
VehicleLightType: daytimeRunningLights lowBeam highBeam fogLights fogLightsFront fogLightsRear
  brakeLights warningLights indicatorLeft indicatorRight reversingLights
  licensePlateIllumination specialPurposeLights
Wetness: dry moist wetWithPuddles lowFlooded highFlooded
"""
