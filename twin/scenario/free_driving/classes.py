"""Classes of roads for free driving: how long, how curved, and what stands beside and above them.

Radii, widths and slopes lie within those of German guidelines (RAA 2008 for motorways, RAL 2012 for
rural roads, RASt 06 for streets); where nothing is said the figures are our own.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RoadClass:
    """A class of roads, and how the ego drives on it."""

    name: str
    about: str
    length_m: float
    """Of the road; vehicles that drive ahead do not reach its end."""
    begin_m: float
    """Station at which the ego begins."""
    drive_m: float
    """How far it drives."""
    lanes: int
    """Driven each way."""
    lane_m: float
    kind: str
    """Type of the road in its file."""
    limit_kmh: float
    radius_m: tuple[float, float]
    arc_m: tuple[float, float]
    straight_m: tuple[float, float]
    clothoid_m: float
    slope_max: float
    """Steepest [-]."""
    bridges: int
    """Over the road."""
    gantries: int
    covers_m: tuple[float, float]
    """From one manhole cover, or steel joint, to the next."""
    speed_mps: tuple[tuple[float, float], ...]
    """Speeds that the ego may wish to drive, lane by lane from the right."""


MOTORWAY = RoadClass(
    name="motorway",
    about="two lanes each way, a median, guard rails on all sides, bridges and gantries",
    length_m=3400.0,
    begin_m=250.0,
    drive_m=1620.0,
    lanes=2,
    lane_m=3.75,
    kind="motorway",
    limit_kmh=130.0,
    radius_m=(900.0, 2000.0),
    arc_m=(250.0, 450.0),
    straight_m=(80.0, 300.0),
    clothoid_m=180.0,
    slope_max=0.025,
    bridges=4,
    gantries=3,
    covers_m=(350.0, 600.0),
    speed_mps=((24.0, 28.0), (30.0, 36.0)),
)
RURAL = RoadClass(
    name="rural",
    about="a lane each way, curves with guard rails on their outer side, trees, a bridge",
    length_m=2300.0,
    begin_m=150.0,
    drive_m=1060.0,
    lanes=1,
    lane_m=3.5,
    kind="rural",
    limit_kmh=100.0,
    radius_m=(280.0, 600.0),
    arc_m=(90.0, 200.0),
    straight_m=(60.0, 200.0),
    clothoid_m=70.0,
    slope_max=0.03,
    bridges=2,
    gantries=0,
    covers_m=(150.0, 300.0),
    speed_mps=((21.0, 26.0),),
)
STREET = RoadClass(
    name="street",
    about="a lane each way, parked cars, footways with people, houses, lamps, manhole covers",
    length_m=1400.0,
    begin_m=80.0,
    drive_m=660.0,
    lanes=1,
    lane_m=3.25,
    kind="town",
    limit_kmh=50.0,
    radius_m=(150.0, 400.0),
    arc_m=(40.0, 110.0),
    straight_m=(60.0, 180.0),
    clothoid_m=30.0,
    slope_max=0.0,
    bridges=1,
    gantries=0,
    covers_m=(25.0, 60.0),
    speed_mps=((11.0, 13.5),),
)
CLASSES = (MOTORWAY, RURAL, STREET)
