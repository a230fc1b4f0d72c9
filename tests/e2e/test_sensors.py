"""A stack that drives by its own sensors, through the real fabric, in one slot and in three."""

import json

import pyarrow.parquet as pq
import pytest
from processes import outcomes

STACK = '''
import math

import numpy as np

from devkit.stack import Observation, Stack
from schemas.messages import (
    ENCODER_COLUMNS, GNSS_COLUMNS, IMU_COLUMNS, Command, Episode, SensorErrors,
)

FIX = GNSS_COLUMNS.index("fix")
LON = GNSS_COLUMNS.index("longitude_deg")
YAW_RATE = IMU_COLUMNS.index("rate_z_radps")
UP = IMU_COLUMNS.index("accel_z_mps2")
REAR = [ENCODER_COLUMNS.index(f"rear_{side}_ticks") for side in ("left", "right")]
WAY_PER_TICK_M = 2 * math.pi * 0.36 / 100
JAMMED, FREE = 10, 20


class Navigator(Stack):
    """Brakes after 15 m by its encoders, steers against the gyro's drift, blends GNSS into both.

    Whatever a sensor says reaches the command unrounded, so one changed bit changes the verdict's
    fingerprint. It jams its own receiver for ten ticks. An assertion ends the rig.
    """

    def __init__(self, slots: int) -> None:
        super().__init__(slots)
        self.way_m = [0.0] * slots
        self.start_lon = [math.nan] * slots
        self.fixes = [0] * slots

    def reset(self, slot: int, episode: Episode) -> None:
        self.way_m[slot], self.start_lon[slot], self.fixes[slot] = 0.0, math.nan, 0

    def step(self, observation: Observation) -> list[Command]:
        return [self.drive(slot, observation) for slot in observation.active_slots()]

    def drive(self, slot: int, observation: Observation) -> Command:
        tick, sensors = int(observation.tick[slot]), observation.sensors
        assert sensors["encoders"].dtype == np.int64
        assert ("gnss" in sensors) == (tick % 2 == 0), tick
        imu, ticks = sensors["imu"][slot], sensors["encoders"][slot]
        assert abs(imu[UP] - 9.80665) < 1.0
        self.way_m[slot] = float(ticks[REAR].mean()) * WAY_PER_TICK_M
        if "gnss" in sensors:
            fix = sensors["gnss"][slot]
            assert (fix[FIX] == 0.0) == (JAMMED < tick <= FREE), tick
            assert np.isnan(fix[LON]) == (fix[FIX] == 0.0)
            if fix[FIX]:
                if self.fixes[slot] == 0:
                    self.start_lon[slot] = fix[LON]
                self.fixes[slot] += 1
                east_m = math.radians(fix[LON] - self.start_lon[slot]) * 6371e3 * math.cos(0.607)
                self.way_m[slot] += 0.05 * (east_m - self.way_m[slot])
        brake = self.way_m[slot] > 15.0
        errors = {JAMMED: SensorErrors(gnss_dropout=True), FREE: SensorErrors(imu_noise=3.0)}
        return Command(
            slot=slot,
            token=int(observation.token[slot]),
            tick=tick,
            throttle=0.0 if brake else min(1.0, 0.001 * abs(self.way_m[slot])),
            brake=1.0 if brake else 0.0,
            steering_rad=float(np.clip(-0.1 * imu[YAW_RATE], -0.05, 0.05)),
            aeb=brake,
            sensors=errors.get(tick),
        )
'''

CAMPAIGN = """
campaign: own-sensors
seed: 6
control_hz: 20
scenario: {ego_start_m: 40, ego_speed_mps: 12, standstill_s: 0.2}
camera: {width: 64, height: 36, hz: 20}
sensors:
  gnss: {hz: 10, noise_horizontal_m: 0.1, bias_horizontal_m: 0.5}
  imu: {}
  encoders: {ppr: 100}
autonomy: {stack: "navigator:Navigator"}
matrix:
  scenario.duration_s: [1.55, 2.0]
  sensors.imu.gyro_noise_degps_per_sqrt_hz: [0.007, 0.07]
  repeat: [0, 1]
"""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """The campaign file, its stack on the path."""
    (tmp_path / "navigator.py").write_text(STACK)
    (tmp_path / "own-sensors.yaml").write_text(CAMPAIGN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path / "own-sensors.yaml"


def run(marked, campaign, folder, slots):
    done = marked.run(
        *("conductor", "run", str(campaign), "--out", str(folder), "--output", "json"),
        *("--workers", "1", "--slots", str(slots)),
    )
    assert done.returncode in (0, 1), done.stderr
    found = json.loads(done.stdout)
    reasons = {name: row["reasons"] for name, row in outcomes(folder).items()}
    assert found["committed"] == found["cases"] == 8, reasons
    assert found["unresolved"] == found["cancelled"] == 0, reasons
    return found


def test_a_stack_on_its_own_sensors_in_one_slot_and_in_three(marked, campaign, tmp_path):
    one = run(marked, campaign, tmp_path / "one", 1)
    three = run(marked, campaign, tmp_path / "three", 3)
    assert one["fingerprint"] == three["fingerprint"]
    steering = {
        tuple(pq.read_table(path).column("steering_rad").to_pylist())
        for path in (tmp_path / "one").glob("cases/*/attempt-1/kpi.parquet")
    }
    assert len(steering) == 8, "every case draws its own errors"
