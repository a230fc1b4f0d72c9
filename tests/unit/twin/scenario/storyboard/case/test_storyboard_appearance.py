"""Lamps, weather and traffic lights of scenario files in the engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from test_storyboard_cases import case_of, drive

from schemas.case import Case
from schemas.messages import Command
from schemas.wire.interventions import SetEnvironment
from tests.road_files import lane, road, section, xodr
from twin.actors.lamps import VehicleLamp
from twin.actors.palette import build_palette
from twin.rig.engine import Engine
from twin.scenario.storyboard.case.motion import StoryboardMotion
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.sky.weather import AIR_PER_M, MOR_PER_EXTINCTION

pytestmark = pytest.mark.slow
"""Kernels of storyboards are compiled first."""

CAR = (
    '<Vehicle name="car" vehicleCategory="car"><BoundingBox><Center x="1.4" y="0" z="0.7"/>'
    '<Dimensions width="1.8" length="4.5" height="1.4"/></BoundingBox><Performance maxSpeed="70" '
    'maxDeceleration="8" maxAcceleration="5"/><Axles><FrontAxle maxSteering="0.5" '
    'wheelDiameter="0.6" trackWidth="1.7" positionX="2.8" positionZ="0.3"/><RearAxle '
    'maxSteering="0" wheelDiameter="0.6" trackWidth="1.7" positionX="0" positionZ="0.3"/></Axles>'
    "</Vehicle>"
)
FOG = '<Weather><Fog visualRange="60"/></Weather><RoadCondition frictionScaleFactor="0.25"/>'
NIGHT = '<TimeOfDay animation="false" dateTime="2026-01-31T23:00:00"/>'
SIGNAL = (
    '<signals><signal s="300" t="-5" id="light" name="light" dynamic="yes" orientation="+" '
    'zOffset="2" type="1000001" subtype="-1" value="-1"/></signals>'
)


def environment(body: str) -> str:
    return (
        '<GlobalAction><EnvironmentAction><Environment name="e">'
        f"{body}</Environment></EnvironmentAction></GlobalAction>"
    )


def signal(state: str) -> str:
    return (
        "<GlobalAction><InfrastructureAction><TrafficSignalAction><TrafficSignalStateAction "
        f'name="light" state="{state}"/></TrafficSignalAction></InfrastructureAction>'
        "</GlobalAction>"
    )


def lamp(name: str, mode: str) -> str:
    return (
        "<PrivateAction><AppearanceAction><LightStateAction><LightType><VehicleLight "
        f'vehicleLightType="{name}"/></LightType><LightState mode="{mode}" '
        'flashingOnDuration="0.2" flashingOffDuration="0.2"/></LightStateAction>'
        "</AppearanceAction></PrivateAction>"
    )


def scenario(folder: Path, name: str, actions: dict[str, float], init: str = "") -> Path:
    """A file in which the lead does actions, each at its time [s]."""
    text = xodr(road(900.0, lanes=section(right=lane(-1)))).decode()
    (folder / "own.xodr").write_text(text.replace("</road>", f"{SIGNAL}</road>", 1))
    places = "".join(
        f'<Private entityRef="{who}"><PrivateAction><TeleportAction><Position><LanePosition '
        f'roadId="0" laneId="-1" s="{s}"/></Position></TeleportAction></PrivateAction>'
        "<PrivateAction><LongitudinalAction><SpeedAction><SpeedActionDynamics "
        'dynamicsShape="step" dynamicsDimension="time" value="0"/><SpeedActionTarget>'
        '<AbsoluteTargetSpeed value="15"/></SpeedActionTarget></SpeedAction></LongitudinalAction>'
        "</PrivateAction></Private>"
        for who, s in (("Ego", 50), ("Lead", 80))
    )
    events = "".join(
        f'<Event name="e{k}" priority="parallel"><Action name="a{k}">{action}</Action>'
        f"<StartTrigger><ConditionGroup>{after(time_s)}</ConditionGroup></StartTrigger></Event>"
        for k, (action, time_s) in enumerate(actions.items())
    )
    path = folder / f"{name}.xosc"
    path.write_text(
        '<OpenSCENARIO><FileHeader author="a" date="2026-01-31T12:00:00" description="" '
        'revMajor="1" revMinor="3"/><CatalogLocations/><RoadNetwork><LogicFile '
        'filepath="own.xodr"/></RoadNetwork><Entities>'
        f'<ScenarioObject name="Ego">{CAR}</ScenarioObject><ScenarioObject name="Lead">{CAR}'
        f"</ScenarioObject></Entities><Storyboard><Init><Actions>{init}{places}</Actions></Init>"
        '<Story name="s"><Act name="act"><ManeuverGroup name="g" maximumExecutionCount="1">'
        '<Actors selectTriggeringEntities="false"><EntityRef entityRef="Lead"/></Actors>'
        f'<Maneuver name="m">{events}</Maneuver></ManeuverGroup></Act></Story>'
        f"<StopTrigger><ConditionGroup>{after(1.6)}</ConditionGroup></StopTrigger>"
        "</Storyboard></OpenSCENARIO>"
    )
    return path


def after(time_s: float) -> str:
    return (
        '<Condition name="c" conditionEdge="none" delay="0"><ByValueCondition>'
        f'<SimulationTimeCondition rule="greaterOrEqual" value="{time_s}"/></ByValueCondition>'
        "</Condition>"
    )


def plain(folder: Path) -> Path:
    return scenario(folder, "plain", {lamp("reversingLights", "off"): 9.0})


def air_of(case: Case, change: SetEnvironment | None = None) -> list[tuple[float, float]]:
    """Illuminance and extinction that the stack senses at every tick."""
    engine = Engine(case, 1)
    engine.reset(0, case)
    if change is not None:
        engine.environment(0).override(change)
    air = []
    done: list[object] = []
    while not done:
        lux, extinction = engine.sense()["environment"].values[0][:2].tolist()
        air.append((lux, extinction))
        tick = int(engine.tick[0])
        done = list(engine.step([Command(0, 1, tick, 0.3, 0.0, 0.0)]))
    engine.close()
    return air


def test_weather_and_light_change_when_the_action_is_done(tmp_path):
    path = scenario(tmp_path, "fog", {environment(FOG): 0.5, environment(NIGHT): 1.0})
    case = case_of(path)
    period_s = 1.0 / case.rig.control_hz
    air = air_of(case)
    in_fog = [extinction > 0.04 for _, extinction in air]
    dark = [lux < 10.0 for lux, _ in air]
    assert in_fog.index(True) == round(0.5 / period_s) + 1  # sensed at the tick after its step
    assert dark.index(True) == round(1.0 / period_s) + 1
    assert all(in_fog[in_fog.index(True) :])
    assert air[-1][1] == pytest.approx(MOR_PER_EXTINCTION / 60.0, rel=1e-5)
    assert air[0][1] == pytest.approx(AIR_PER_M, rel=1e-5)


def test_init_counts_from_the_first_tick_and_the_campaign_may_go_before(tmp_path):
    path = scenario(tmp_path, "fog", {lamp("fogLights", "on"): 9.0}, init=environment(FOG))
    assert air_of(case_of(path))[0][1] == pytest.approx(MOR_PER_EXTINCTION / 60.0, rel=1e-5)
    kept = air_of(case_of(path, environment="campaign"))
    np.testing.assert_allclose([extinction for _, extinction in kept], AIR_PER_M, rtol=1e-5)


def test_an_intervention_goes_before_the_file(tmp_path):
    path = scenario(tmp_path, "fog", {environment(FOG): 0.5})
    air = air_of(case_of(path), SetEnvironment(weather="heavy_fog"))
    assert air[-1][1] == pytest.approx(MOR_PER_EXTINCTION / 120.0, rel=1e-3)


def test_a_slippery_road_is_slippery_from_the_step_on(tmp_path):
    slippery = scenario(
        tmp_path, "ice", {environment('<RoadCondition frictionScaleFactor="0.25"/>'): 0.5}
    )
    speeds = {}
    for path in (plain(tmp_path), slippery):
        finished, _ = drive([case_of(path)], 1, braked_after_s=0.3)[0]
        speeds[path.stem] = finished.table.columns["speed_mps"].values
    grip, ice = speeds["plain"], speeds["ice"]
    period_s = 0.05 if len(grip) < 40 else 1.6 / len(grip)
    same = int(0.5 / period_s)
    np.testing.assert_array_equal(grip[:same], ice[:same])
    assert ice[-1] > grip[-1] + 2.0


def test_neighbours_and_cases_before_change_no_byte(tmp_path):
    changing = scenario(
        tmp_path,
        "changing",
        {environment(FOG): 0.5, lamp("indicatorLeft", "flashing"): 0.3},
        init=environment('<Weather><Precipitation precipitationType="rain" '
                         'precipitationIntensity="8"/></Weather>'),
    )  # fmt: skip
    scene = str(tmp_path / "own.xodr")
    cases = [case_of(path, scene=scene) for path in (changing, plain(tmp_path))]
    alone = {number: drive([case], 1)[0][1] for number, case in enumerate(cases)}
    assert len(set(alone.values())) == 2
    order = [0, 1, 1, 0, 1]
    again = drive([cases[number] for number in order], 2)
    assert [again[k][1] for k in range(5)] == [alone[number] for number in order]
    held = drive(cases, 2, hold=(8, 14))
    assert {number: digest for number, (_, digest) in held.items()} == alone


def test_lamps_of_actors_are_placed_with_them(tmp_path):
    path = scenario(
        tmp_path,
        "lamps",
        {
            lamp("indicatorLeft", "flashing"): 0.4,
            lamp("lowBeam", "off"): 0.6,
            lamp("brakeLights", "on"): 0.8,
        },
    )
    case = case_of(path)
    engine = Engine(case, 1)
    engine.reset(0, case)
    left, lit, braking = [], [], []
    period_s = 1.0 / case.rig.control_hz
    for tick in range(round(1.5 / period_s)):
        engine.sense()
        placement = engine.placement
        assert placement.lights is not None
        left.append(bool(placement.lights[0, 0] >> VehicleLamp.INDICATOR_LEFT & 1))
        lit.append(bool(placement.lamps[0, 0]))
        braking.append(bool(placement.brake[0, 0]))
        engine.step([Command(0, 1, tick, 0.3, 0.0, 0.0)])
    engine.close()
    ticks = {name: round(s / period_s) + 1 for name, s in (("left", 0.4), ("low", 0.6), ("b", 0.8))}
    assert left.index(True) == ticks["left"]
    assert sum(left) == pytest.approx(0.5 * (len(left) - ticks["left"]), abs=0.2 / period_s)
    assert lit.index(False) == ticks["low"]
    assert braking.index(True) == ticks["b"]
    assert not any(lit[ticks["low"] :])


def test_traffic_lights_show_the_states_of_their_own_slot(tmp_path):
    path = scenario(tmp_path, "signals", {signal("green"): 0.1}, init=signal("red"))
    case = case_of(path)
    motion = StoryboardMotion(
        case, load_vehicle("opencav"), build_palette().kinds, 2, "cpu", ("other", "light")
    )
    motion.begin(1, case)
    before = motion.at(np.zeros(2)).signals
    assert before is not None
    assert before.tolist() == [[0, 0], [0, 1]]
    motion.alone(1, 0.3)
    after_it = motion.at(np.zeros(2)).signals
    assert after_it is not None
    assert after_it.tolist() == [[0, 0], [0, 4]]
    motion.clear(1)
    cleared = motion.at(np.zeros(2)).signals
    assert cleared is not None
    assert not cleared.any()


def test_phases_of_controllers_are_shown(tmp_path):
    path = scenario(tmp_path, "phases", {lamp("fogLights", "on"): 9.0})
    phases = "".join(
        f'<Phase name="{state}" duration="0.2"><TrafficSignalState trafficSignalId="light" '
        f'state="{state}"/></Phase>'
        for state in ("red", "red_amber", "green")
    )
    controlled = (
        '<LogicFile filepath="own.xodr"/><TrafficSignals><TrafficSignalController name="c">'
        f"{phases}</TrafficSignalController></TrafficSignals>"
    )
    path.write_text(path.read_text().replace('<LogicFile filepath="own.xodr"/>', controlled))
    case = case_of(path)
    motion = StoryboardMotion(
        case, load_vehicle("opencav"), build_palette().kinds, 1, "cpu", ("light",)
    )
    motion.begin(0, case)
    shown = []
    for _ in range(4):
        motion.alone(0, 0.1)
        signals = motion.at(np.zeros(1)).signals
        assert signals is not None
        shown.append(int(signals[0, 0]))
        motion.alone(0, 0.1)
    assert shown == [1, 3, 4, 1]
