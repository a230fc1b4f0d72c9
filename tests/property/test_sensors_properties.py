"""Sensors over the whole range of their parameters."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pymap3d
from case_changes import changed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_rows import built, case, on_device, readings, resting

from schemas.kinds.sensors.gnss import Gnss
from schemas.kinds.sensors.imu import Imu
from schemas.messages import GNSS_COLUMNS
from schemas.validation import convert_all
from twin.sensors.encoders.wheels import WheelEncoders
from twin.sensors.gnss.receiver import SatelliteReceiver
from twin.sensors.imu.unit import InertialUnit
from twin.sensors.truth import TRUTH
from twin.world.scene import Origin

FIX = GNSS_COLUMNS.index("fix")
FAST = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def within(low, high):
    return st.floats(low, high, allow_nan=False)


origins = st.builds(
    Origin,
    latitude_deg=within(-89.9, 89.9),
    longitude_deg=within(-180, 180),
    altitude_m=within(-500, 9000),
    heading_deg=within(0, 359.9),
)
places = st.tuples(within(-2000, 2000), within(-2000, 2000), within(-200, 500))
imus = st.builds(
    Imu,
    accel_noise_mps2_per_sqrt_hz=within(0, 1),
    accel_bias_mps2=within(0, 10),
    accel_scale=within(0, 0.5),
    gyro_noise_degps_per_sqrt_hz=within(0, 10),
    gyro_bias_degps=within(0, 100),
    gyro_scale=within(0, 0.5),
    bias_time_s=within(0.1, 1e6),
)
receivers = st.builds(
    Gnss,
    hz=st.sampled_from([0, 1, 2, 4, 5, 10, 20]),
    antenna_m=st.lists(within(-20, 20), min_size=3, max_size=3),
    noise_horizontal_m=within(0, 1000),
    noise_vertical_m=within(0, 1000),
    bias_horizontal_m=within(0, 1000),
    bias_vertical_m=within(0, 1000),
    bias_time_s=within(0.1, 1e6),
    dropouts_per_min=within(0, 600),
    dropout_s=within(0.01, 3600),
)


def with_section(name, **sections):
    one = case(name)
    return changed(one, sensors=msgspec.structs.replace(one.variation.sensors, **sections))


@given(origins, places)
@FAST
def test_gnss_round_trip_anywhere_on_earth(origin, place):
    one = case(gnss={"noise": False, "antenna_m": [0, 0, 0]})
    sensor = built(SatelliteReceiver, one, 1, origin)
    sensor.reset(0, one)
    lat, lon, alt, fix = readings(
        sensor, 1, 1, resting(1, **dict(zip(TRUTH, place, strict=False)))
    )[0, 0]
    assert fix == 1.0
    assert -180.0 <= lon <= 180.0
    east, north, up = pymap3d.geodetic2enu(
        lat, lon, alt, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    heading = math.radians(origin.heading_deg)
    forward = math.sin(heading) * east + math.cos(heading) * north
    left = math.sin(heading) * north - math.cos(heading) * east
    assert math.dist((forward, left, up), place) < 1e-3


@given(receivers)
@FAST
def test_every_allowed_receiver_gives_numbers_or_no_fix(gnss):
    assert convert_all(msgspec.to_builtins(gnss), Gnss)[1] == []
    one = with_section("g", gnss=gnss)
    sensor = built(SatelliteReceiver, one, 3, Origin())
    for slot in (0, 2):
        sensor.reset(slot, one)
    found = readings(sensor, 3, 100)
    fix = found[..., FIX]
    assert np.isin(fix, (0.0, 1.0)).all()
    assert not found[:, 1].any()
    assert (np.isfinite(found[:, 0]).all(axis=1) == (fix[:, 0] == 1.0)).all()
    assert found[:, 0].tobytes() == found[:, 2].tobytes()
    if gnss.dropouts_per_min == 0.0:
        assert (fix[:, (0, 2)] == 1.0).all()


@given(imus, st.integers(0, 2**63 - 1), st.integers(1, 8))
@FAST
def test_every_allowed_imu_is_finite_and_the_same_in_every_slot(imu, seed, slots):
    assert convert_all(msgspec.to_builtins(imu), Imu)[1] == []
    one = changed(with_section("i", imu=imu), seed=seed)

    def run(count, slot):
        sensor = built(InertialUnit, one, count)
        sensor.reset(slot, one)
        return readings(sensor, count, 25)[:, slot]

    alone = run(1, 0)
    assert np.isfinite(alone).all()
    assert run(slots, slots - 1).tobytes() == alone.tobytes()


@given(imus, within(-100, 100), within(-10, 10))
@FAST
def test_amplitude_zero_switches_an_error_off(imu, force_mps2, rate_radps):
    """Without white noise and bias only the scale is left; without that, the truth."""
    no_noise = {"accel_noise_mps2_per_sqrt_hz": 0.0, "gyro_noise_degps_per_sqrt_hz": 0.0}
    no_bias = {"accel_bias_mps2": 0.0, "gyro_bias_degps": 0.0}
    scaled = msgspec.structs.replace(imu, **no_noise, **no_bias)
    exact = msgspec.structs.replace(scaled, accel_scale=0.0, gyro_scale=0.0)
    rows = resting(1, force_x_mps2=force_mps2, rate_z_radps=rate_radps)

    def run(section):
        one = with_section("i", imu=section)
        sensor = built(InertialUnit, one, 1)
        sensor.reset(0, one)
        return readings(sensor, 1, 5, rows)[:, 0]

    first = TRUTH.index("force_x_mps2")
    assert (run(exact) == rows[0, first : first + 6]).all()
    assert (run(scaled) == run(scaled)[0]).all()


@given(
    st.integers(1, 1_000_000),
    within(1e-3, 1000),
    st.lists(within(-1e6, 1e6), min_size=4, max_size=4),
)
@FAST
def test_encoders_are_the_floor_of_their_formula(ppr, cgr, angles):
    one = case(encoders={"ppr": ppr, "cgr": cgr})
    sensor = built(WheelEncoders, one, 1)
    sensor.reset(0, one)
    rows = resting(1)
    first = TRUTH.index("wheel_fl_rad")
    rows[0, first : first + 4] = angles
    found = sensor.read(on_device(rows), np.zeros(1, np.int32))[0]
    expected = [math.floor(ppr * cgr * (angle / (2 * math.pi))) for angle in angles]
    assert found.tolist() == expected


# Steps from 1e-9 rad: four ticks of the smallest float are as far as none.
@given(
    st.lists(within(-0.5, 2.0).map(lambda rad: round(rad, 9)), min_size=2, max_size=40),
    st.integers(1, 5000),
)
@FAST
def test_encoder_ticks_stay_within_one_of_the_way(steps, ppr):
    one = case(encoders={"ppr": ppr})
    sensor = built(WheelEncoders, one, 1)
    sensor.reset(0, one)
    first = TRUTH.index("wheel_fl_rad")
    for tick, angle in enumerate(np.cumsum(steps)):
        rows = resting(1)
        rows[0, first] = angle
        ticks = sensor.read(on_device(rows), np.array([tick], np.int32))[0, 0]
        assert 0 <= ppr * angle / (2 * math.pi) - ticks < 1 + 1e-9
