"""Interventions on bodies of storyboards: where they are then, who reacts, and equal bytes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from schemas.case import Case
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.wire.interventions import (
    FreeObject,
    MoveObject,
    ObjectState,
    PlaceEgo,
    RemoveObject,
    SpawnObject,
)
from twin.actors.motion import Placement
from twin.rig.engine import Engine
from twin.rig.interventions.slot_changes import SlotChanges
from twin.road.beside.bodies import body_axes
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.shipped.library import road_path
from twin.vehicle.columns import COLUMN
from twin.world.road_scene import road_map

pytestmark = pytest.mark.slow
"""Kernels of storyboards are compiled first."""

FOLLOWED = """scenario: followed
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 20}
actors:
  van: {kind: van, lane: 1, ahead_m: 60, speed_mps: 15}
  follower: {kind: car, lane: 1, behind_m: 20, of: van, speed_mps: 15, behaviour: idm}
events:
  slower:
    at_s: 0.4
    do: {van: {speed_mps: 10, at_mps2: 5}}
end: {after_s: 6}
"""
HILLS = """scenario: hills
road: rural
ego: {lane: 1, s_m: 260, speed_mps: 15}
actors:
  van: {kind: van, lane: 1, ahead_m: 30, speed_mps: 15}
end: {after_s: 6}
"""
PERIOD_S = 0.05
Action = MoveObject | RemoveObject | FreeObject


def case_of(path: Path) -> Case:
    campaign, mistakes = parse_campaign(
        {
            "campaign": "moved",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {"type": "storyboard", "storyboard": str(path)},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Case:
    path = tmp_path_factory.mktemp("scenarios") / "followed.yaml"
    path.write_text(FOLLOWED)
    return case_of(path)


class Played:
    """A rig whose slot 0 is steered."""

    def __init__(self, cases: Sequence[Case]) -> None:
        self.engine = Engine(cases[0], len(cases))
        self.changes = SlotChanges(self.engine, "rig")
        self.digest = hashlib.sha256()
        for slot, case in enumerate(cases):
            self.engine.reset(slot, case)

    def tick(self, actions: Sequence[Action] = ()) -> None:
        for action in actions:
            self.changes.apply(0, action)
        for name, data in sorted(self.engine.sense().items()):
            self.digest.update(name.encode() + data.values[0].tobytes())
        ticks = self.engine.tick.tolist()
        self.engine.step([Command(s, 1, tick, 0.2, 0.0, 0.0) for s, tick in enumerate(ticks)])
        self.digest.update(repr([*self.bodies().values()]).encode())

    def ticks(self, count: int, actions: Mapping[int, Sequence[Action]] | None = None) -> None:
        for tick in range(count):
            self.tick((actions or {}).get(tick, ()))

    def bodies(self) -> dict[str, ObjectState]:
        return {state.name: state for state in self.changes.objects(0)}

    def velocity_mps(self, body: int) -> np.ndarray:
        placement = self.engine.objects.at(self.engine.sim_time_ns / 1e9)
        velocity: np.ndarray = placement.velocity_mps[0, body, :2]
        return velocity


def test_a_body_that_was_moved_goes_straight_ahead(followed: Case) -> None:
    rig = Played([followed])
    rig.ticks(3)
    before = rig.bodies()
    assert not any(state.by_hand for state in before.values())
    angle = math.radians(30.0)
    move = MoveObject(object=0, x_m=300.0, y_m=-5.0, yaw_rad=angle, speed_mps=8.0)
    assert rig.changes.apply(0, move) == 0
    now = rig.bodies()["van"]
    assert (now.x_m, now.y_m, now.by_hand) == (pytest.approx(300.0), pytest.approx(-5.0), True)
    assert not rig.bodies()["follower"].by_hand
    rig.ticks(20)  # past the event that would slow it down
    now = rig.bodies()["van"]
    way_m = 8.0 * 20 * PERIOD_S
    assert now.x_m == pytest.approx(300.0 + way_m * math.cos(angle), abs=1e-6)
    assert now.y_m == pytest.approx(-5.0 + way_m * math.sin(angle), abs=1e-6)
    expected = (8.0 * math.cos(angle), 8.0 * math.sin(angle))
    assert rig.velocity_mps(0) == pytest.approx(expected, abs=1e-6)
    rig.engine.close()


def test_others_react_to_it_and_it_goes_on_when_given_back(followed: Case) -> None:
    free = Played([followed])
    free.ticks(60)
    rig = Played([followed])
    rig.ticks(3)
    van = rig.bodies()["van"]
    stopped = MoveObject(object=0, x_m=van.x_m, y_m=van.y_m, yaw_rad=van.yaw_rad)
    rig.ticks(57, {0: [stopped]})
    assert rig.bodies()["van"].x_m == pytest.approx(van.x_m)
    behind = van.x_m - rig.bodies()["follower"].x_m
    assert 4.0 < behind < 25.0, "it stands behind it, and did not drive through"
    assert rig.bodies()["follower"].x_m < free.bodies()["follower"].x_m - 5.0
    moving = MoveObject(object=0, x_m=van.x_m, y_m=van.y_m, yaw_rad=van.yaw_rad, speed_mps=6.0)
    rig.tick([moving, FreeObject(0)])
    assert not rig.bodies()["van"].by_hand
    rig.ticks(10)
    assert rig.bodies()["van"].x_m == pytest.approx(van.x_m + 6.0 * 11 * PERIOD_S, abs=0.07)
    free.engine.close()
    rig.engine.close()


def test_one_that_was_taken_away_is_nowhere_and_comes_back_where_it_was(followed: Case) -> None:
    rig = Played([followed])
    rig.ticks(3)
    van = rig.bodies()["van"]
    rig.changes.apply(0, RemoveObject(0))
    away = rig.bodies()["van"]
    assert (away.present, away.by_hand) == (False, True)
    rig.ticks(10)
    placement = rig.engine.placement
    assert placement.kind[0, 0] == -1
    rig.changes.apply(0, RemoveObject(0))  # once more changes nothing
    rig.changes.apply(0, FreeObject(0))
    back = rig.bodies()["van"]
    assert (back.present, back.by_hand) == (True, False)
    assert (back.x_m, back.y_m) == (pytest.approx(van.x_m), pytest.approx(van.y_m))
    rig.ticks(2)
    assert rig.bodies()["van"].x_m > van.x_m
    rig.engine.close()


def test_the_same_actions_give_the_same_bytes_beside_any_neighbour(followed: Case) -> None:
    actions = {
        2: [MoveObject(object=1, x_m=150.0, y_m=-7.6, yaw_rad=0.1, speed_mps=12.0)],
        10: [RemoveObject(0)],
        20: [FreeObject(0), FreeObject(1)],
    }

    def digest(cases: Sequence[Case], actions: Mapping[int, Sequence[Action]]) -> str:
        rig = Played(cases)
        rig.ticks(40, actions)
        rig.engine.close()
        return rig.digest.hexdigest()

    alone = digest([followed], actions)
    assert digest([followed], actions) == alone
    assert digest([followed, followed, followed], actions) == alone
    assert digest([followed], {}) != alone
    assert digest([followed, followed], {}) == digest([followed], {})


def test_a_slot_forgets_what_was_moved_when_its_next_case_begins(followed: Case) -> None:
    rig = Played([followed])
    start = rig.bodies()
    rig.ticks(4, {1: [MoveObject(object=0, x_m=0.0, y_m=0.0)], 2: [RemoveObject(1)]})
    rig.engine.reset(0, followed)
    assert rig.bodies() == start
    rig.engine.close()


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (MoveObject(object=2, x_m=0.0, y_m=0.0), "given 2, the scenario of this case has 0 to 1"),
        (RemoveObject(31), "given 31, the scenario of this case has 0 to 1"),
        (FreeObject(7), "given 7, the scenario of this case has 0 to 1"),
        (SpawnObject("van", x_m=0.0, y_m=0.0), "the scenario of this case says who is there"),
    ],
)
def test_what_cannot_be_done_changes_nothing(followed: Case, action: Action, words: str) -> None:
    rig = Played([followed])
    before = rig.bodies()
    with pytest.raises(ValueError, match=words):
        rig.changes.apply(0, action)
    assert rig.bodies() == before
    rig.engine.close()


def stands_on(frame: RoadFrame, placement: Placement) -> None:
    """The ground below body 0, at its corners, is that of the road to 3 cm: it leans as that
    does, and moves along it."""
    assert placement.pitch_rad is not None
    assert placement.roll_rad is not None
    yaw, pitch, roll = (
        float(angles[0, 0])
        for angles in (placement.yaw_rad, placement.pitch_rad, placement.roll_rad)
    )
    forward, left, up = body_axes(yaw, pitch, roll)
    along = np.linspace(0.0, frame.road.length_m, 4000)
    line = frame.pose(along, np.zeros(along.size))
    middle = placement.position_m[0, 0]
    for ahead, aside in ((2.2, 0.9), (2.2, -0.9), (-2.2, 0.9), (-2.2, -0.9)):
        corner = middle + ahead * forward + aside * left
        s = along[np.hypot(line.x_m - corner[0], line.y_m - corner[1]).argmin()]
        below = frame.pose(s, 0.0)
        c, s_ = math.cos(float(below.heading_rad)), math.sin(float(below.heading_rad))
        t = -s_ * (corner[0] - float(below.x_m)) + c * (corner[1] - float(below.y_m))
        assert corner[2] == pytest.approx(float(frame.pose(s, t).z_m), abs=0.03)
    assert abs(pitch) > 0.02, "a slope"
    assert abs(placement.velocity_mps[0, 0] @ up) < 1e-9


def test_on_hills_bodies_and_the_ego_stand_on_the_road(tmp_path: Path) -> None:
    path = tmp_path / "hills.yaml"
    path.write_text(HILLS)
    rig = Played([case_of(path)])
    frame = next(iter(road_map(str(road_path("rural", tmp_path))).frames.values()))
    stands_on(frame, rig.engine.objects.at(np.zeros(1)))
    rig.ticks(40)
    stands_on(frame, rig.engine.objects.at(np.zeros(1)))
    place, ahead = (frame.lane_pose(-1, s) for s in (600.0, 606.0))
    x_m, y_m, yaw_rad = (float(v) for v in (place.x_m, place.y_m, place.heading_rad))
    move = MoveObject(object=0, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, speed_mps=10.0)
    rig.changes.apply(0, move)
    assert rig.engine.objects.at(np.zeros(1)).position_m[0, 0, 2] == pytest.approx(
        place.z_m, abs=0.05
    )
    rig.ticks(12)
    stands_on(frame, rig.engine.objects.at(np.zeros(1)))
    height_m = rig.engine.placement.position_m[0, 0, 2]
    assert height_m == pytest.approx(float(ahead.z_m), abs=0.07)
    assert abs(float(ahead.z_m - place.z_m)) > 0.14, "the road is a hill there"
    place = frame.lane_pose(-1, 450.0)
    x_m, y_m, yaw_rad = (float(v) for v in (place.x_m, place.y_m, place.heading_rad))
    rig.changes.apply(0, PlaceEgo(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    rig.ticks(10)
    assert rig.engine.state[0, COLUMN["z_m"]] == pytest.approx(place.z_m, abs=0.2)
    rig.engine.close()
