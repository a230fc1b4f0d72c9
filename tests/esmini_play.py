"""Runs of esmini, a player of OpenSCENARIO nobody here wrote, that lies beside the project."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

ESMINI = Path(__file__).parents[2] / "shared" / "oracle" / "esmini"
STEP_S = 0.01

_VEHICLE = (
    '<Vehicle name="car" vehicleCategory="car"><ParameterDeclarations/>'
    '<BoundingBox><Center x="1.4" y="0" z="0.75"/>'
    '<Dimensions width="1.8" length="4.5" height="1.5"/></BoundingBox>'
    '<Performance maxSpeed="70" maxAcceleration="10" maxDeceleration="10"/><Axles>'
    '<FrontAxle maxSteering="0.5" wheelDiameter="0.6" trackWidth="1.6" positionX="2.8" '
    'positionZ="0.3"/><RearAxle maxSteering="0" wheelDiameter="0.6" trackWidth="1.6" positionX="0" '
    'positionZ="0.3"/></Axles><Properties/></Vehicle>'
)
_COLUMNS = {
    "x": "World_Position_X [m]",
    "y": "World_Position_Y [m]",
    "z": "World_Position_Z [m]",
    "heading": "World_Heading_Angle [rad]",
    "pitch": "World_Pitch_Angle [rad]",
}


class PlayedCar(NamedTuple):
    """A car at rest or at constant speed from a place on a lane; offset to the left."""

    road: str
    lane: int
    s_m: float
    offset_m: float = 0.0
    route: tuple[tuple[str, int, float], ...] = ()
    """Road, lane and s of waypoints."""

    @property
    def place(self) -> str:
        """Its position as XML."""
        return _lane_position(self.road, self.lane, self.s_m, self.offset_m)


def play(
    road_file: bytes, cars: Sequence[PlayedCar], speed_mps: float, until_s: float, folder: Path
) -> np.ndarray:
    """x, y, z, heading, pitch of cars by time step of 0.01 s, from 0 on [T, cars, 5]."""
    (folder / "roads.xodr").write_bytes(road_file)
    (folder / "play.xosc").write_text(_scenario(cars, speed_mps, until_s))
    run = subprocess.run(
        [
            *(ESMINI, "--osc", "play.xosc", "--headless", "--fixed_timestep", str(STEP_S)),
            *("--csv_logger", "log.csv", "--disable_log"),
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        errors="replace",
    )
    assert run.returncode == 0, run.stdout[-2000:]
    lines = (folder / "log.csv").read_text().splitlines()
    head = next(index for index, line in enumerate(lines) if line.startswith("Index"))
    names = [name.strip() for name in lines[head].split(",")]
    columns = [
        names.index(f"#{car + 1} {name}") for car in range(len(cars)) for name in _COLUMNS.values()
    ]
    rows = [[float(line.split(",")[k]) for k in columns] for line in lines[head + 1 :]]
    return np.array(rows).reshape(len(rows), len(cars), len(_COLUMNS))


def _lane_position(road: str, lane: int, s_m: float, offset_m: float = 0.0) -> str:
    return f'<LanePosition roadId="{road}" laneId="{lane}" s="{s_m}" offset="{offset_m}"/>'


def _private(name: str, car: PlayedCar, speed_mps: float) -> str:
    actions = [
        f"<TeleportAction><Position>{car.place}</Position></TeleportAction>",
        "<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape='step' value='0' "
        "dynamicsDimension='time'/><SpeedActionTarget>"
        f"<AbsoluteTargetSpeed value='{speed_mps}'/></SpeedActionTarget></SpeedAction>"
        "</LongitudinalAction>",
    ]
    if car.route:
        waypoints = "".join(
            f"<Waypoint routeStrategy='shortest'><Position>{_lane_position(*point)}</Position>"
            "</Waypoint>"
            for point in car.route
        )
        actions.append(
            "<RoutingAction><AssignRouteAction><Route name='r' closed='false'>"
            f"{waypoints}</Route></AssignRouteAction></RoutingAction>"
        )
    inside = "".join(f"<PrivateAction>{action}</PrivateAction>" for action in actions)
    return f'<Private entityRef="{name}">{inside}</Private>'


def _scenario(cars: Sequence[PlayedCar], speed_mps: float, until_s: float) -> str:
    names = [f"car{k}" for k in range(len(cars))]
    objects = "".join(f'<ScenarioObject name="{n}">{_VEHICLE}</ScenarioObject>' for n in names)
    private = "".join(_private(n, car, speed_mps) for n, car in zip(names, cars, strict=True))
    return (
        '<?xml version="1.0"?><OpenSCENARIO>'
        '<FileHeader revMajor="1" revMinor="1" date="2024-01-01T00:00:00" description="" '
        'author=""/><ParameterDeclarations/><CatalogLocations/>'
        '<RoadNetwork><LogicFile filepath="roads.xodr"/></RoadNetwork>'
        f"<Entities>{objects}</Entities>"
        f"<Storyboard><Init><Actions>{private}</Actions></Init>"
        '<StopTrigger><ConditionGroup><Condition name="end" delay="0" conditionEdge="none">'
        f'<ByValueCondition><SimulationTimeCondition value="{until_s}" rule="greaterThan"/>'
        "</ByValueCondition></Condition></ConditionGroup></StopTrigger>"
        "</Storyboard></OpenSCENARIO>"
    )
