"""Cases with ``driver: robot``: the storyboard's path until the stack acts, physics from there."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from schemas.case import Case
from schemas.kinds.scenario import kind_of
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.wire.interventions import PlaceEgo
from twin.kpi import verdict as judging
from twin.kpi.judge_record import surroundings_of
from twin.play.playing import PoseRow, play_programs
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.road.tables.road_tables import road_tables
from twin.scenario.families import replay
from twin.scenario.storyboard.case.files import load_storyboard
from twin.vehicle.columns import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.road_scene import road_map

LANE_CHANGE = """scenario: robot
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 15}
actors:
  van: {kind: van, lane: 2, ahead_m: 60, speed_mps: 10}
events:
  faster:
    at_s: 0.2
    do: {ego: {speed_mps: 20, in_s: 1.0}}
  aside:
    at_s: 0.4
    do: {ego: {change_lane: 3, in_s: 1.5}}
end: {after_s: 2.5}
"""
STRAIGHT = """scenario: steady
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 15}
actors:
  van: {kind: van, lane: 2, ahead_m: 30, speed_mps: 12}
events:
  slower:
    at_s: 1.0
    do: {van: {speed_mps: 10, in_s: 1.0}}
end: {after_s: 2.5}
"""
BEND = """scenario: bend
road: rural
ego: {lane: 1, s_m: 230, speed_mps: 15}
actors:
  car: {kind: car, lane: 1, ahead_m: 100, speed_mps: 15}
end: {after_s: 1.5}
"""
"""A bend to the left of 0.004/m, up a slope."""
Stack = Callable[[int, float], Command]
"""What a stack asks for: at a tick, at a sim time [s]."""


def case_of(storyboard: object, *, latency_ms: int = 0, **scenario: object) -> Case:
    campaign, mistakes = parse_campaign(
        {
            "campaign": "robot",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {
                "type": "storyboard",
                "storyboard": str(storyboard),
                "driver": "robot",
                **scenario,
            },
            "matrix": {"weather": ["clear"], "autonomy.latency_ms": [latency_ms]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


@pytest.fixture
def changes(tmp_path: Path) -> Path:
    path = tmp_path / "changes.yaml"
    path.write_text(LANE_CHANGE)
    return path


@pytest.fixture
def straight(tmp_path: Path) -> Path:
    path = tmp_path / "straight.yaml"
    path.write_text(STRAIGHT)
    return path


def command(tick: int, **values: bool | float) -> Command:
    return Command(0, 1, tick, **{"throttle": 0.0, "brake": 0.0, "steering_rad": 0.0, **values})


def idle(tick: int, _time_s: float) -> Command:
    """Never acts, though it asks for throttle and steers along its lane."""
    return command(tick, throttle=1.0, steering_rad=0.01)


def acting(from_s: float, **values: float) -> Stack:
    return lambda tick, time_s: (
        command(tick, **values) if time_s > from_s - 1e-9 else idle(tick, time_s)
    )


def drive(
    cases: Sequence[Case], stacks: Sequence[Stack], slots: int, hold: tuple[int, int] = (0, 0)
) -> dict[int, tuple[Finished, str]]:
    """What became of cases, one after the other where a slot is free, with a digest of what was
    sensed and recorded; ``hold``: slot 0 stands still between two ticks of the rig."""
    engine = Engine(cases[0], slots)
    waiting, running = list(range(len(cases))), dict[int, int]()
    digests = {number: hashlib.sha256() for number in waiting}
    done: dict[int, tuple[Finished, str]] = {}
    for tick in range(2000):
        if not waiting and not running:
            break
        held = hold[0] <= tick < hold[1]
        if hold[1] and tick == hold[0]:
            engine.hold(0)
        if hold[1] and tick == hold[1]:
            engine.go_on(0)
        for slot in range(slots):
            if slot not in running and waiting and not tick % engine.refill_every:
                running[slot] = waiting.pop(0)
                engine.reset(slot, cases[running[slot]])
        moving = [slot for slot in running if slot or not held]
        for name, data in sorted(engine.sense().items()):
            for slot in moving:
                digests[running[slot]].update(name.encode() + data.values[slot].tobytes())
        commands = [
            stacks[running[s]](int(engine.tick[s]), float(engine.sim_time_ns[s]) / 1e9)
            if s in moving
            else None
            for s in range(slots)
        ]
        for finished in engine.step(commands):
            number = running.pop(finished.slot)
            for name, column in finished.table.columns.items():
                digests[number].update(name.encode() + repr(column.values.tolist()).encode())
            done[number] = finished, digests[number].hexdigest()
    engine.close()
    return done


def drive_one(case: Case, stack: Stack) -> Finished:
    return drive([case], [stack], 1)[0][0]


def values(finished: Finished, name: str) -> np.ndarray:
    return finished.table.columns[name].values


def played(path: Path, ego: str = "ego") -> dict[int, PoseRow]:
    """The ego as ``twin play`` has it, by time [10 ms]."""
    loaded = load_storyboard(str(path), {}, load_vehicle("opencav"))
    roads = road_tables(road_map(loaded.road).network)
    (scenario,) = play_programs([loaded.program], roads, step_s=0.01, every=1, until_s=10.0)
    rows = (row for row in scenario.rows if row.entity.lower() == ego)
    return {round(row.time_s * 100): row for row in rows}


def test_a_stack_that_never_acts_is_carried_along_the_storyboard(changes):
    finished = drive_one(case_of(changes), idle)
    told = played(changes)
    times = (values(finished, "sim_time_ns") // 10_000_000).tolist()
    known = [k for k, time in enumerate(times) if time in told]
    assert len(known) >= 50
    for k in known:
        row = told[times[k]]
        off_m = np.hypot(values(finished, "x_m")[k] - row.x_m, values(finished, "y_m")[k] - row.y_m)
        assert off_m < 1e-6
        assert values(finished, "speed_mps")[k] == pytest.approx(row.speed_mps, abs=0.06)
    assert values(finished, "y_m")[-1] - values(finished, "y_m")[0] == pytest.approx(3.75, abs=0.05)
    assert finished.verdict == "pass"
    assert finished.reasons[1] == "the stack did not intervene, the robot drove to the end"
    assert values(finished, "robot_drives").all()
    assert all(
        finished.scalars[f"intervention_{name}"] is None
        for name in ("kind", "time_s", "speed_mps", "dtc_m", "ttc_s")
    )


def test_what_is_left_of_the_last_period_is_no_standstill(changes):
    """The storyboard ends between two ticks; the ego does not stop there."""
    finished = drive_one(case_of(changes, numbers={"end.after_s": 2.42}), idle)
    assert values(finished, "storyboard_running")[-1] == 0.0
    assert values(finished, "speed_mps")[-1] == pytest.approx(20.0, abs=0.01)
    assert finished.scalars["decel_peak_mps2"] < 0.5


def test_until_it_brakes_the_same_and_physics_afterwards(straight):
    case = case_of(straight)
    never, braking = drive_one(case, idle), drive_one(case, acting(1.0, brake=0.6))
    first = int(np.flatnonzero(values(braking, "robot_drives") == 0.0)[0])
    assert values(braking, "sim_time_ns")[first] == 1_000_000_000
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2"):
        assert values(braking, name)[:first].tolist() == values(never, name)[:first].tolist()
    assert values(braking, "x_m")[first] == values(never, "x_m")[first]
    scalars = braking.scalars
    assert scalars["intervention_kind"] == 1
    assert scalars["intervention_time_s"] == 1.0
    assert scalars["intervention_speed_mps"] == pytest.approx(15.0, abs=1e-9)
    assert scalars["intervention_dtc_m"] == values(braking, "dtc_m")[first]
    assert scalars["intervention_ttc_s"] == values(braking, "ttc_s")[first]
    speed = values(braking, "speed_mps")
    step_m = np.diff(values(braking, "x_m"))[first - 1 :]
    assert step_m[0] == pytest.approx(0.75, abs=1e-6)
    assert step_m[1] == pytest.approx(0.75, abs=0.02), "no jump: the brake only begins to act"
    assert (np.diff(speed[first : first + 20]) < 0).all()
    assert speed[-1] < 9.0
    # The brake of the vehicle has its lag: no full deceleration at once.
    assert 0.0 < speed[first] - speed[first + 1] < 0.2
    assert braking.reasons[-1] == "the stack intervened by braking after 1.00 s, at 15.00 m/s"


def test_a_warning_is_noted_and_changes_nothing(straight):
    def warns(tick: int, time_s: float) -> Command:
        return command(tick, warning=time_s > 0.5 - 1e-9, brake=0.6 * (time_s > 1.0 - 1e-9))

    case = case_of(straight)
    warned, silent = drive_one(case, warns), drive_one(case, acting(1.0, brake=0.6))
    first = int(np.flatnonzero(values(warned, "warning"))[0])
    assert warned.scalars["warning_time_s"] == 0.5
    assert warned.scalars["warning_ttc_s"] == values(warned, "ttc_s")[first]
    assert warned.scalars["warning_before_braking_s"] == 0.5
    assert silent.scalars["warning_time_s"] is None
    assert values(warned, "speed_mps").tolist() == values(silent, "speed_mps").tolist()


def test_who_never_acts_is_driven_into_what_stands_there(straight):
    case = case_of(straight, numbers={"actors.van.speed_mps": 0.0, "actors.van.ahead_m": 20.0})
    finished = drive_one(case, idle)
    assert finished.verdict == "collision"
    assert finished.scalars["impact_speed_mps"] == pytest.approx(15.0, abs=0.01)
    assert "'van' (car)" in finished.reasons[0]
    assert finished.reasons[-1] == "the stack did not intervene, the robot drove to the end"


def test_the_robot_does_not_come_back(straight):
    def taps(tick: int, time_s: float) -> Command:
        return command(tick, brake=0.3 * (0.5 <= time_s < 0.6))

    finished = drive_one(case_of(straight), taps)
    drives = values(finished, "robot_drives")
    assert (np.diff(drives) <= 0.0).all()
    assert values(finished, "speed_mps")[-1] < 14.8, "it rolls without throttle"


def test_a_brake_from_the_threshold_on_counts(straight):
    case = case_of(straight, robot_brake=0.2)
    shares = {0.1999: None, 0.2: 1, 0.2001: 1, 0.0: None}
    stacks = [acting(0.5, **{pedal: k}) for k in shares for pedal in ("brake", "handbrake")]
    done = drive([case] * len(stacks), stacks, 4)
    kinds = [done[k][0].scalars["intervention_kind"] for k in range(len(stacks))]
    assert kinds == [kind for kind in shares.values() for _ in range(2)]


def test_steering_from_the_threshold_on_counts_to_both_sides(straight):
    case = case_of(straight, robot_steering_deg=2.0)
    angles_deg = {1.99: None, 2.01: 2, -1.99: None, -2.01: 2, 30.0: 2}
    stacks = [acting(0.5, steering_rad=float(np.radians(deg))) for deg in angles_deg]
    done = drive([case] * len(stacks), stacks, 5)
    for k, (deg, kind) in enumerate(angles_deg.items()):
        finished = done[k][0]
        assert finished.scalars["intervention_kind"] == kind
        if kind:
            words = "the stack intervened by steering after 0.50 s"
            assert finished.reasons[-1].startswith(words)
            gone_m = values(finished, "y_m")[-1] - values(finished, "y_m")[0]
            assert gone_m * deg > 0.0
            assert abs(gone_m) > 0.5


@pytest.mark.slow
def test_steering_is_compared_with_the_path_of_the_robot(tmp_path):
    """On a bend a stack that steers along it does not intervene, nor one that does not steer."""
    path = tmp_path / "bend.yaml"
    path.write_text(BEND)
    case, bend_rad = case_of(path, robot_steering_deg=0.5), float(np.arctan(3.09 * 0.004))
    along = drive_one(case, acting(0.0, steering_rad=bend_rad))
    assert along.scalars["intervention_kind"] is None
    assert np.abs(values(along, "accel_mps2")).max() < 0.3, "no jerk at the start on a slope"
    turned = np.diff(values(along, "yaw_rad")) / (0.05 * 15.0)
    assert turned[:-1] == pytest.approx(0.004, rel=0.03), "straight on once the storyboard is over"
    for more_rad, kind in ((-bend_rad, None), (0.008, None), (0.01, 2), (-bend_rad - 0.009, 2)):
        stack = acting(0.5, steering_rad=bend_rad + more_rad)
        finished = drive_one(case, stack)
        assert finished.scalars["intervention_kind"] == kind, more_rad
    assert finished.scalars["intervention_time_s"] == 0.5


def test_a_command_counts_where_it_comes_into_force(straight):
    case = case_of(straight, latency_ms=170)
    finished = drive_one(case, acting(0.5, brake=0.5))
    assert finished.scalars["intervention_time_s"] == pytest.approx(0.65)
    speed = values(finished, "speed_mps")
    first = int(np.flatnonzero(values(finished, "robot_drives") == 0.0)[0])
    assert speed[:first] == pytest.approx(15.0, abs=1e-6)
    assert speed[first + 1] == pytest.approx(15.0, abs=0.1), "the throttle of before is taken back"


@pytest.mark.slow
def test_neighbours_holding_and_restarts_change_no_byte(changes, straight):
    road = {"scene": "motorway"}
    cases = [
        case_of(changes, **road),
        case_of(straight, **road),
        case_of(straight, driver="stack", **road),
    ]
    stacks = [acting(1.3, brake=0.5), acting(0.7, steering_rad=0.1), acting(0.6, brake=0.5)]
    alone = {k: drive([cases[k]], [stacks[k]], 1)[0][1] for k in range(3)}
    assert len(set(alone.values())) == 3
    together = drive(cases, stacks, 3)
    assert {k: digest for k, (_, digest) in together.items()} == alone
    held = drive(cases, stacks, 3, hold=(20, 40))
    assert {k: digest for k, (_, digest) in held.items()} == alone
    order = [2, 0, 1, 0, 2]  # a slot that is used again
    again = drive([cases[k] for k in order], [stacks[k] for k in order], 2)
    assert [again[k][1] for k in range(5)] == [alone[k] for k in order]
    assert together[2][0].scalars["intervention_kind"] is None, "no robot, no intervention"
    assert not together[2][0].table.columns["robot_drives"].valid.any()


def test_the_judge_comes_to_the_same_from_the_rows(straight):
    finished = drive_one(case_of(straight), acting(1.0, brake=0.6))
    record = finished.record
    assert record is not None

    class Rows:
        rows = finished.table.rows

        def column(self, name: str) -> np.ndarray:
            return finished.table.columns[name].values

        def valid(self, name: str) -> np.ndarray:
            return finished.table.columns[name].valid

    run = replay(record.scenario, surroundings_of(record), Rows())
    mine = run.scalars(Rows())
    assert mine == {name: finished.scalars[name] for name in mine}
    assert {"intervention_kind", "intervention_ttc_s"} <= set(mine)
    assert run.judge(Rows(), True) == judging.Verdict(finished.verdict, finished.reasons)
    names = {kind.name for kind in kind_of(record.scenario).scalars}
    assert set(mine) <= names


def test_nobody_else_moves_the_ego_of_a_robot(straight):
    case = case_of(straight)
    engine = Engine(case, 1)
    engine.reset(0, case)
    engine.sense()
    place = PlaceEgo(x_m=200.0, y_m=-7.625, yaw_rad=0.0, speed_mps=20.0)
    with pytest.raises(ValueError, match="the robot has the ego"):
        engine.place_ego(0, place)
    engine.step([command(0, brake=1.0)])
    engine.place_ego(0, place)
    engine.sense()
    assert engine.state[0, COLUMN["x_m"]] == 200.0
    engine.close()


@pytest.mark.parametrize(
    "wrong", [{"robot_brake": 0.0}, {"robot_steering_deg": 91.0}, {"driver": "nobody"}]
)
def test_thresholds_out_of_range_are_refused(wrong):
    campaign, mistakes = parse_campaign(
        {
            "campaign": "robot",
            "scenario": {"type": "storyboard", "storyboard": "cut-in", **wrong},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is None
    assert next(iter(wrong)) in str(mistakes)
