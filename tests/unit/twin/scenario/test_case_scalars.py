"""Scalars of a case from its rows and its last state."""

import numpy as np
import pytest

from schemas.campaign import Scenario
from schemas.messages import Command
from twin.kpi.recorder import KpiRecorder
from twin.kpi.verdict import scalars
from twin.road.lane import straight
from twin.scenario import families
from twin.scenario.surroundings import Surroundings
from twin.vehicle.state import COLUMN

PERIOD_NS = 50_000_000
GROUND = Surroundings(straight(0.0, 100.0), None, 1.4, 2.4, 0.9)
RUN = families.begin(Scenario(), GROUND, 0.0, 0.0)


def rows_of(ticks):
    """Rows of one case and its last state; ``ticks``: columns of the state, and AEB or None."""
    recorder = KpiRecorder(1)
    state = np.zeros((1, len(COLUMN)))
    for tick, (values, aeb) in enumerate(ticks):
        state[0] = 0.0
        for name, value in values.items():
            state[0, COLUMN[name]] = value
        command = None if aeb is None else Command(0, 1, tick, 0.0, 0.0, 0.0, aeb)
        now = np.array([tick])
        recorder.add([0], now, now * PERIOD_NS, state, [command], [{}])
    return recorder.of(0), state[0]


def test_the_fastest_moment_may_be_the_impact():
    """A collision's last row shows a car that stands; it was fastest when it hit."""
    rows, state = rows_of(
        [
            ({"speed_mps": 4.0, "dtc_m": 1.0}, False),
            ({"speed_mps": 0.0, "collisions": 1.0, "impact_speed_mps": 6.25}, None),
        ]
    )
    found = scalars(rows, state, RUN)
    assert (found["speed_max_mps"], found["impact_speed_mps"]) == (6.25, 6.25)
    assert found["collisions"] == 1


def test_the_fastest_moment_may_be_long_before_the_impact():
    rows, state = rows_of(
        [
            ({"speed_mps": 9.5, "dtc_m": 1.0}, False),
            ({"speed_mps": 0.0, "collisions": 1.0, "impact_speed_mps": 6.25}, None),
        ]
    )
    assert scalars(rows, state, RUN)["speed_max_mps"] == 9.5


def test_what_was_not_measured_is_missing():
    rows, state = rows_of([({"speed_mps": 3.0, "dtc_m": 8.0, "accel_mps2": 0.5}, None)])
    found = scalars(rows, state, RUN)
    for name in ("aeb_time_s", "aeb_dtc_m", "aeb_ttc_s", "impact_speed_mps", "distance_m"):
        assert found[name] is None, name
    assert found["decel_peak_mps2"] == 0.0, "it only gained speed"
    assert found["collisions"] == 0


def test_the_first_trigger_counts_and_a_tick_without_a_command_is_none():
    rows, state = rows_of(
        [
            ({"dtc_m": 30.0, "closing_mps": 10.0}, False),
            ({"dtc_m": 20.0, "closing_mps": 8.0, "accel_mps2": -3.5}, True),
            ({"dtc_m": 12.0, "closing_mps": 6.0, "accel_mps2": -7.25}, True),
            ({"dtc_m": 14.0, "closing_mps": 0.0}, None),
        ]
    )
    found = scalars(rows, state, RUN)
    assert found["aeb_time_s"] == 0.05
    assert (found["aeb_dtc_m"], found["aeb_ttc_s"]) == (20.0, 2.5)
    assert (found["dtc_min_m"], found["dtc_end_m"]) == (12.0, 14.0)
    assert (found["sim_time_s"], found["ticks"]) == (pytest.approx(0.15), 3)
    assert found["decel_peak_mps2"] == 7.25


def test_a_trigger_while_nothing_closes_has_no_time_to_collision():
    rows, state = rows_of([({"dtc_m": 20.0, "closing_mps": 0.0}, True)])
    found = scalars(rows, state, RUN)
    assert (found["aeb_dtc_m"], found["aeb_ttc_s"]) == (20.0, None)


def test_lane_keeping_has_its_way_and_its_errors():
    """The errors of the rows, whichever side; the way of the progress."""
    recorder = KpiRecorder(1)
    state = np.zeros((1, len(COLUMN)))
    for tick, error_m in enumerate((0.3, -0.4)):
        now = np.array([tick])
        recorder.add([0], now, now * PERIOD_NS, state, [None], [{"lateral_error_m": error_m}])
    lane = families.begin(Scenario(type="lane_keeping"), GROUND, 0.0, 0.0)
    lane.observe(np.array([12.5]), np.array([0.2]))
    found = scalars(recorder.of(0), state[0], lane)
    assert found["distance_m"] == pytest.approx(12.5)
    assert found["lateral_error_rms_m"] == pytest.approx(0.25 * 2**0.5)
    assert found["lateral_error_max_m"] == pytest.approx(0.4)
