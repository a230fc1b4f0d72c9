"""Verdicts and scalars of free driving, on rows by hand and in a rig."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from schemas.case import Case
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.sections.free_driving import FreeDriving
from twin.rig.engine import Engine
from twin.rig.slot import Finished
from twin.scenario.protocol import FirstContact
from twin.scenario.storyboard.case.free_run import FreeRun

TICK_S = 0.05


@dataclass
class HandRows:
    """Rows of a straight drive at one speed, whose stack brakes fully at a row."""

    full: int | None = None
    speed_mps: float = 20.0
    ttc_s: dict[int, float] | None = None
    braking: tuple[int, ...] = ()
    running: float = 0.0
    rows: int = 201

    def column(self, name: str) -> np.ndarray:
        at = np.arange(self.rows)
        full = self.rows if self.full is None else self.full
        columns = {
            "sim_time_ns": (at * TICK_S * 1e9).astype(np.int64),
            "speed_mps": np.full(self.rows, self.speed_mps),
            "x_m": at * TICK_S * self.speed_mps,
            "y_m": np.zeros(self.rows),
            "aeb": np.isin(at, self.braking) | (at >= full),
            "intervention_kind": np.where(at >= full, 1.0, 0.0),
            "storyboard_running": np.full(self.rows, self.running),
            "way_ttc_s": np.array([(self.ttc_s or {}).get(k, 0.0) for k in at.tolist()]),
        }
        return columns[name]

    def valid(self, name: str) -> np.ndarray:
        at = np.arange(self.rows)
        if name == "intervention_kind":
            return at >= (self.rows if self.full is None else self.full)
        if name == "way_ttc_s":
            return np.isin(at, list(self.ttc_s or {}))
        return np.ones(self.rows, np.bool_)


RUN = FreeRun(FreeDriving())


def test_who_never_brakes_passes_and_has_driven_the_whole_way():
    rows = HandRows(braking=(10, 11, 12, 50))
    assert RUN.verdict(rows, None).verdict == "pass"
    values = RUN.scalars(rows)
    assert values["driven_m"] == pytest.approx(200.0)
    assert values["driven_fast_m"] == pytest.approx(200.0)
    assert values["partial_brakings"] == 2
    assert values["full_braking_s"] is None
    assert values["false_brakings"] == 0


def test_slower_than_50_km_per_hour_is_not_fast():
    values = RUN.scalars(HandRows(speed_mps=13.8))
    assert values["driven_fast_m"] == 0.0
    assert values["driven_m"] == pytest.approx(138.0)


@pytest.mark.parametrize(
    ("ttc_s", "verdict"),
    [
        (None, "false_reaction"),
        ({100: 3.01}, "false_reaction"),
        ({100: 2.99}, "pass"),
        ({80: 2.0}, "pass"),
        ({79: 2.0}, "false_reaction"),
        ({101: 0.9}, "false_reaction"),
    ],
)
def test_a_full_braking_is_false_unless_a_collision_was_near(ttc_s, verdict):
    """Looked at from 1 s before row 100 on. What comes near later does so because nobody steers."""
    rows = HandRows(full=100, ttc_s=ttc_s)
    assert RUN.verdict(rows, None).verdict == verdict
    values = RUN.scalars(rows)
    assert values["false_brakings"] == (verdict == "false_reaction")
    assert values["full_braking_s"] == 5.0
    assert values["driven_m"] == pytest.approx(100.0)


def test_a_full_braking_is_no_partial_one():
    assert RUN.scalars(HandRows(full=100, braking=(20,)))["partial_brakings"] == 1
    assert RUN.scalars(HandRows(full=100, braking=(98, 99)))["partial_brakings"] == 1


def test_a_collision_is_one_unless_the_stack_braked_for_nothing():
    contact = FirstContact(9.0, 3.0, None)
    assert RUN.verdict(HandRows(), contact).verdict == "collision"
    assert RUN.verdict(HandRows(full=100), contact).verdict == "false_reaction"
    assert RUN.verdict(HandRows(full=100, ttc_s={100: 1.0}), contact).verdict == "collision"


def test_a_storyboard_that_still_runs_is_out_of_time():
    assert RUN.verdict(HandRows(running=1.0), None).verdict == "time_up"


SCENARIO = """scenario: free
road: motorway
ego: {lane: 2, s_m: 60, speed_mps: 25, behaviour: idm, idm: {changes_lanes: false}}
actors:
  van: {kind: van, lane: 2, ahead_m: 60, speed_mps: 25, behaviour: idm}
  stands: {kind: car, lane: 1, s_m: 150}
end: {after_s: 3.0}
"""


def case_of(tmp_path: Path, **scenario: object) -> Case:
    path = tmp_path / "free.yaml"
    path.write_text(SCENARIO)
    campaign, mistakes = parse_campaign(
        {
            "campaign": "free",
            "camera": {"width": 32, "height": 18, "hz": 10},
            "scenario": {
                "type": "storyboard",
                "storyboard": str(path),
                "driver": "robot",
                "robot_brake": 0.95,
                "free_driving": {"after_s": 0.5},
                **scenario,
            },
            "matrix": {"weather": ["clear"]},
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)[0]


def drive(case: Case, brake: float) -> Finished:
    engine = Engine(case, 1)
    engine.reset(0, case)
    for _ in range(200):
        engine.sense()
        tick = int(engine.tick[0])
        now = brake if engine.sim_time_ns[0] >= 1_000_000_000 else 0.0
        command = Command(0, 1, tick, throttle=0.0, brake=now, steering_rad=0.0, aeb=now > 0.0)
        finished = engine.step([command])
        if finished:
            engine.close()
            return finished[0]
    raise AssertionError("the case did not end")


def test_in_a_rig_a_full_braking_ends_the_case_and_a_partial_one_does_not(tmp_path):
    full = drive(case_of(tmp_path), 1.0)
    assert full.verdict == "false_reaction"
    assert full.scalars["sim_time_s"] == pytest.approx(1.5, abs=0.051)
    assert full.scalars["full_braking_s"] == 1.0
    assert full.scalars["driven_m"] == pytest.approx(25.0, abs=0.5)
    partial = drive(case_of(tmp_path), 0.4)
    assert partial.verdict == "pass"
    assert partial.scalars["partial_brakings"] == 1
    assert partial.scalars["sim_time_s"] == pytest.approx(3.0, abs=0.051)


def test_in_a_rig_truth_sees_who_stands_in_the_way(tmp_path):
    far = drive(case_of(tmp_path, numbers={"ego.lane": 1, "actors.stands.s_m": 125}), 1.0)
    ttc = far.table.columns["way_ttc_s"]
    gap_m = 125 - 60 - 0.5 * (4.5 + 5.17)
    assert ttc.values[0] == pytest.approx(gap_m / 25, abs=0.02)
    assert far.verdict == "pass"
    assert far.scalars["full_braking_ttc_s"] < 3.0
    aside = drive(case_of(tmp_path), 0.0)
    assert math.isnan(aside.scalars["full_braking_ttc_s"] or math.nan)


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        ({"driver": "stack"}, "free_driving needs driver: robot"),
        ({"trial": {"rule": "avoid"}}, "give one of them"),
    ],
)
def test_what_does_not_go_with_free_driving_is_said(scenario, words):
    campaign, mistakes = parse_campaign(
        {
            "campaign": "free",
            "scenario": {
                "type": "storyboard",
                "storyboard": "cut-in",
                "driver": "robot",
                "free_driving": {},
                **scenario,
            },
        }
    )
    assert campaign is None
    assert words in mistakes[0].message
