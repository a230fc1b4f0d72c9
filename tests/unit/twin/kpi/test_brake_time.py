"""``brake_time_s`` counts control periods whose command brakes."""

import numpy as np

from twin.kpi.brake_time.duration import brake_time_s


class Rows:
    rows = 5

    def __init__(self, brake, valid):
        self.columns = {
            "brake": np.array(brake),
            "sim_time_ns": np.arange(5) * 50_000_000,
        }
        self.known = np.array(valid)

    def column(self, name):
        return self.columns[name]

    def valid(self, name):
        assert name == "brake"
        return self.known


def test_periods_that_brake_are_added_up():
    rows = Rows([0.0, 0.5, 1.0, 0.0, 0.0], [True, True, True, True, False])
    assert brake_time_s(rows) == 0.1


def test_without_a_command_there_is_no_time():
    assert brake_time_s(Rows([0.0] * 5, [False] * 5)) is None
