"""Cases of storyboards in the engine: starts, ends, events, and bytes that nothing else changes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.case import Case
from schemas.files.assets import asset_digest
from schemas.messages import OBJECT_CLASSES, Command
from schemas.plan import expand, parse_campaign
from schemas.wire.interventions import PlaceEgo
from twin.base.errors import RefusedError
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.road.shipped.library import road_path
from twin.world.road_scene import road_map

pytestmark = pytest.mark.slow
"""Kernels of storyboards are compiled first."""

CUT_IN = """scenario: near
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 20}
actors:
  van: {kind: van, lane: 3, ahead_m: 30, speed_mps: 15}
  walker: {kind: pedestrian, lane: 1, ahead_m: 20, speed_mps: 1}
events:
  cut_in:
    at_s: 0.5
    do: {van: {change_lane: 2, in_s: 1.0}}
end: {after_s: 2.5}
"""
CAMERA = {"width": 32, "height": 18, "hz": 10}


def case_of(storyboard: object, **scenario: object) -> Case:
    campaign, mistakes = parse_campaign(
        {
            "campaign": "near",
            "camera": CAMERA,
            "scenario": {"type": "storyboard", "storyboard": str(storyboard), **scenario},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


@pytest.fixture
def near(tmp_path: Path) -> Path:
    path = tmp_path / "near.yaml"
    path.write_text(CUT_IN)
    return path


def drive(
    cases: Sequence[Case],
    slots: int,
    *,
    braked_after_s: float = 9.0,
    hold: tuple[int, int] = (0, 0),
) -> dict[int, tuple[Finished, str]]:
    """What became of cases, which begin one after the other where a slot is free, with a digest of
    all that was sensed; ``hold``: slot 0 stands still between two ticks of the rig."""
    engine = Engine(cases[0], slots)
    waiting, running = list(range(len(cases))), dict[int, int]()
    digests = {number: hashlib.sha256() for number in waiting}
    done: dict[int, tuple[Finished, str]] = {}
    for tick in range(2000):
        if not waiting and not running:
            break
        held = hold[0] <= tick < hold[1]
        if tick == hold[0] and hold[1]:
            engine.hold(0)
        if tick == hold[1] and hold[1]:
            engine.go_on(0)
        for slot in range(slots):
            if slot not in running and waiting and not tick % engine.refill_every:
                running[slot] = waiting.pop(0)
                engine.reset(slot, cases[running[slot]])
        moving = [slot for slot in running if slot or not held]
        for name, data in sorted(engine.sense().items()):
            for slot in moving:
                digests[running[slot]].update(name.encode() + data.values[slot].tobytes())
        brakes = engine.sim_time_ns >= braked_after_s * 1e9
        commands = [
            Command(s, 1, int(engine.tick[s]), 0.4 * (not brakes[s]), 0.7 * bool(brakes[s]), 0.0)
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


def test_the_case_begins_as_the_storyboard_says_and_ends_with_it(near):
    case = case_of(near)
    engine = Engine(case, 1)
    engine.reset(0, case)
    engine.sense()
    assert engine.state[0, 1] == pytest.approx(-7.625), "the middle lane"
    placement = engine.placement
    there = placement.kind[0] >= 0
    assert there.tolist() == [True, True] + [False] * 30
    assert placement.class_index is not None
    classes = [OBJECT_CLASSES[k] for k in placement.class_index[0, :2].tolist()]
    assert classes == ["car", "pedestrian"]
    engine.close()
    finished, _ = drive([case], 1)[0]
    assert finished.verdict == "pass"
    assert finished.scalars["storyboard_end_s"] == pytest.approx(2.55, abs=0.051)
    assert finished.scalars["events_started"] == 1
    assert finished.scalars["event_last_s"] == pytest.approx(0.5, abs=0.011)
    assert finished.record is not None
    assert finished.record.events == ["cut_in"]
    assert finished.scalars["dtc_min_m"] == finished.scalars["nearest_min_m"]
    assert finished.names["nearest_object"] == "walker"


def test_a_collision_names_what_was_hit_and_the_event_before(near):
    case = case_of(near, duration_s=30.0)
    numbers = case_of(near, numbers={"end.after_s": 20.0, "actors.van.speed_mps": 5.0})
    assert numbers.rig == case.rig
    finished, _ = drive([numbers], 1)[0]
    assert finished.verdict == "collision"
    assert "'van' (car)" in finished.reasons[0]
    assert finished.reasons[1] == "the last event before was 'cut_in', at 0.50 s"


def test_time_may_be_up_before_the_storyboard(near):
    finished, _ = drive([case_of(near, duration_s=1.0)], 1)[0]
    assert finished.verdict == "time_up"
    assert finished.scalars["storyboard_end_s"] is None


def test_a_rest_does_not_end_the_case(near):
    case = case_of(near, numbers={"ego.speed_mps": 3.0}, standstill_s=0.0)
    finished, _ = drive([case], 1, braked_after_s=0.0)[0]
    assert finished.verdict == "pass"
    assert finished.scalars["sim_time_s"] > 2.0
    assert finished.table.columns["speed_mps"].values[-1] == 0.0


def test_neighbours_change_no_byte_whatever_their_programs(near):
    road = {"scene": "motorway", "duration_s": 2.0}
    cases = [
        case_of(near, scene="motorway"),
        case_of("cut-out", **road),
        case_of("free-traffic", **road),
    ]
    alone = {number: drive([case], 1)[0][1] for number, case in enumerate(cases)}
    assert len(set(alone.values())) == 3
    together = drive(cases, 3)
    assert {number: digest for number, (_, digest) in together.items()} == alone
    # A slot that is used again, by programs of other sizes.
    order = [2, 0, 1, 0, 2]
    again = drive([cases[number] for number in order], 2)
    assert [again[k][1] for k in range(5)] == [alone[number] for number in order]


def test_a_slot_that_stood_still_goes_on_with_the_same_bytes(near):
    cases = [case_of(near, scene="motorway"), case_of("cut-out", scene="motorway", duration_s=2.0)]
    never = drive(cases, 2)
    held = drive(cases, 2, hold=(20, 30))
    assert {k: digest for k, (_, digest) in held.items()} == {
        k: digest for k, (_, digest) in never.items()
    }


def test_a_program_on_another_road_is_refused(near):
    engine = Engine(case_of(near, scene="motorway"), 1)
    with pytest.raises(ValueError, match=r"takes place on .*rural"):
        engine.reset(0, case_of("animal-on-rural-road", scene="motorway"))
    engine.close()


def test_a_file_that_changed_since_the_submission_is_refused(near):
    case = case_of(near, scene="motorway")
    files = {str(near): asset_digest(near)}
    case = msgspec.structs.replace(
        case, variation=msgspec.structs.replace(case.variation, files=files)
    )
    engine = Engine(case, 1)
    engine.reset(0, case)
    near.write_text(CUT_IN.replace("speed_mps: 15", "speed_mps: 16"))
    with pytest.raises(RefusedError, match="not what the campaign was submitted with"):
        engine.reset(0, case)
    engine.close()


def test_a_case_whose_player_met_a_limit_fails(near):
    """A storyboard that begins and ends an event at every step."""
    events = "".join(
        f"  e{n}:\n    at_s: {n / 500:.3f}\n    do: {{van: {{speed_mps: 15, at_mps2: 9}}}}\n"
        for n in range(250)
    )
    near.write_text(CUT_IN[: CUT_IN.index("  cut_in:")] + events + "end: {after_s: 2.5}\n")
    finished, _ = drive([case_of(near)], 1)[0]
    assert finished.outcome == "failed"
    assert "TRANSITIONS_MAX" in finished.reasons[0]


def test_interventions_name_the_bodies_and_place_the_ego(near):
    case = case_of(near)
    engine = Engine(case, 1)
    engine.reset(0, case)
    engine.sense()
    states = engine.objects.states(0, engine.sim_time_ns / 1e9)
    assert [state.kind for state in states] == ["van", "pedestrian"]
    engine.place_ego(0, PlaceEgo(x_m=200.0, y_m=-7.625, yaw_rad=0.0, speed_mps=20.0))
    engine.sense()
    engine.step([Command(0, 1, 0, 0.0, 0.0, 0.0)])
    assert engine.state[0, 0] == pytest.approx(201.0, abs=0.1)
    engine.close()


def test_control_periods_are_whole_steps(near):
    case = case_of(near)
    fast = msgspec.structs.replace(case, rig=msgspec.structs.replace(case.rig, control_hz=250))
    with pytest.raises(ValueError, match="250: no whole steps of 10 ms"):
        Engine(fast, 1)


def test_bodies_move_between_the_ticks(near):
    """The vehicle meets bodies at every step: a period of five is five periods of one."""
    case = case_of(near)
    engine = Engine(case, 1)
    engine.reset(0, case)
    engine.sense()
    before = engine.placement.position_m[0, 0].copy()
    engine.step([Command(0, 1, 0, 0.0, 0.0, 0.0)])
    engine.sense()
    ahead = engine.placement.position_m[0, 0] - before
    assert np.allclose(ahead, (15.0 * 0.05, 0.0, 0.0), atol=1e-3)
    engine.close()


def test_the_middle_of_a_body_stands_on_its_slope(tmp_path: Path):
    """A bus has its origin on the rear axle, 2.7 m behind the middle of its box."""
    path = tmp_path / "climb.yaml"
    path.write_text(
        "scenario: climb\nroad: rural\nego: {lane: 1, s_m: 20, speed_mps: 1}\nactors:\n"
        + "".join(f"  bus{s}: {{kind: bus, lane: 1, s_m: {s}}}\n" for s in (150, 350, 600, 900))
        + "end: {after_s: 1}\n"
    )
    case = case_of(path)
    engine = Engine(case, 1)
    engine.reset(0, case)
    engine.sense()
    roads = road_map(str(road_path("rural", Path())))
    apart, steep = [], []
    for x, y, z in engine.placement.position_m[0].tolist()[:4]:
        under = roads.lane_under(x, y)
        frame = list(roads.frames.values())[int(under.road)]
        pose = frame.pose(float(under.s_m), float(under.t_m))
        apart.append(abs(z - float(pose.z_m)))
        steep.append(abs(float(pose.pitch_rad)))
    assert max(steep) > 0.02
    assert max(apart) < 0.01
    engine.close()
