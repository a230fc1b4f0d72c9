"""Rewards are formulas of single rows; what is missing adds nothing."""

import numpy as np
import pytest

from schemas.kinds.scenario import scenario_kinds
from twin.base.errors import UsageError
from twin.gym.rewards import RewardFormula
from twin.kpi.table import DetectionColumn, KpiColumn, KpiTable

LANE = scenario_kinds().find("lane_keeping")
NOTHING = DetectionColumn(np.zeros(1, np.int32), np.zeros(0, bool), [], *[np.zeros(0)] * 5)


def table(**columns):
    rows = len(next(iter(columns.values()))[0])
    made = {
        name: KpiColumn(np.array(values), None if valid is None else np.array(valid, bool))
        for name, (values, valid) in columns.items()
    }
    return KpiTable(rows, made, NOTHING)


def test_a_number_of_every_row():
    reward = RewardFormula("speed_mps / 4 - 10 * collisions", LANE)
    assert reward.columns == ["speed_mps", "collisions"]
    values = {"speed_mps": np.array([4.0, 8.0]), "collisions": np.array([0, 1])}
    assert reward.of_rows(values, {}, 2).tolist() == [1.0, -8.0]


def test_a_condition_gives_its_margin():
    reward = RewardFormula("speed_mps < 9 and abs(lateral_error_m) < 0.5", LANE)
    values = {"speed_mps": np.array([4.0]), "lateral_error_m": np.array([-0.2])}
    assert reward.of_rows(values, {"lateral_error_m": np.array([True])}, 1).tolist() == [0.3]


def test_unknown_rows_add_nothing():
    reward = RewardFormula("throttle + speed_mps", LANE)
    ended = table(
        speed_mps=([1.0, 2.0, 4.0], None), throttle=([0.5, 0.25, 0.0], [True, True, False])
    )
    assert reward.of_table(ended, 0) == 3.75
    assert RewardFormula("speed_mps", LANE).of_table(ended, 1) == 6.0
    assert reward.of_table(ended, 1) == 2.25
    assert reward.of_table(ended, 2) == 0.0
    quotient = RewardFormula("1 / speed_mps", LANE)
    assert quotient.of_table(table(speed_mps=([0.0, 2.0], None)), 0) == 0.5


def test_a_constant_is_a_reward():
    assert RewardFormula("1", LANE).of_table(table(tick=([0, 1, 2], None)), 1) == 2.0


@pytest.mark.parametrize(
    ("formula", "problem"),
    [
        ("", "reward: empty; say what a row is worth"),
        ("always (speed_mps > 1)", "always, eventually and until look at other rows"),
        ("speed_mps +", "ends too early"),
        ("speed_mps ** 2", "is not expected at character 12"),
        ("spede_mps", "no column 'spede_mps' with every row of scenario type lane_keeping; did"),
        ("nearest_object", "no column 'nearest_object'"),
        ("(speed_mps > 1) + 1", "a condition stands where a number is needed|is not expected"),
        ("1" * 1001, "1001 characters, at most 1000 are allowed"),
    ],
)
def test_what_is_no_reward_is_told_in_one_line(formula, problem):
    with pytest.raises(UsageError, match=problem) as told:
        RewardFormula(formula, LANE)
    assert "\n" not in str(told.value)
