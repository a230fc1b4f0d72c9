"""Sensor kernels against NumPy, closed forms and an independent geodesy library."""

import math

import numpy as np
import pymap3d
import pytest
import warp as wp
from sensor_rows import CPU, GRAVITY_MPS2, HOME, built, case, on_device, readings, resting

from schemas.messages import GNSS_COLUMNS, IMU_COLUMNS, SensorErrors
from twin.sensors.encoders.wheels import WheelEncoders
from twin.sensors.gnss.receiver import SatelliteReceiver
from twin.sensors.imu.unit import InertialUnit
from twin.sensors.noise import gaussian
from twin.sensors.truth import TRUTH
from twin.world.scene import Origin

FIX = GNSS_COLUMNS.index("fix")
ACCEL = [IMU_COLUMNS.index(f"accel_{axis}_mps2") for axis in "xyz"]


@wp.kernel
def draw_kernel(key: wp.uint64, out: wp.array(dtype=wp.float64)):
    tid = wp.tid()
    out[tid] = gaussian(key, tid // 8, tid % 8)


def receiver(one, slots=1, origin=HOME, used=None):
    sensor = built(SatelliteReceiver, one, slots, origin)
    for slot in range(slots) if used is None else used:
        sensor.reset(slot, one)
    return sensor


# --- GNSS ---------------------------------------------------------------------------------------


def test_gnss_round_trip_is_under_a_millimetre():
    one = case(gnss={"noise": False, "antenna_m": [0, 0, 0]})
    rng = np.random.default_rng(1)
    for lat, lon, alt in ((34.8, -82.32, 250.0), (-33.9, 151.2, 10.0), (89.9, 180.0, 0.0)):
        origin = Origin(latitude_deg=lat, longitude_deg=lon, altitude_m=alt)  # x is east
        east_north_up = rng.uniform((-2000, -2000, -50), (2000, 2000, 300), (64, 3))
        rows = resting(64)
        rows[:, :3] = east_north_up
        found = readings(receiver(one, 64, origin), 64, 1, rows)[0]
        back = pymap3d.geodetic2enu(*found[:, :3].T, lat, lon, alt)
        assert np.abs(np.stack(back, axis=1) - east_north_up).max() < 1e-4
        assert (found[:, FIX] == 1.0).all()


@pytest.mark.parametrize(
    ("heading_deg", "north_m", "east_m"),
    [(0, 100, 0), (90, 0, 100), (180, -100, 0), (270, 0, -100)],
)
def test_heading_of_the_scene_turns_the_world(heading_deg, north_m, east_m):
    one = case(gnss={"noise": False, "antenna_m": [0, 0, 0]})
    origin = Origin(latitude_deg=50.0, longitude_deg=8.0, heading_deg=heading_deg)
    found = readings(receiver(one, 1, origin), 1, 1, resting(1, x_m=100.0))[0, 0]
    east, north, _ = pymap3d.geodetic2enu(*found[:3], 50.0, 8.0, 0.0)
    assert (float(east), float(north)) == pytest.approx((east_m, north_m), abs=1e-4)


def test_the_antenna_moves_with_the_vehicle():
    one = case(gnss={"noise": False, "antenna_m": [2.0, 1.0, 1.5]})
    half = math.radians(90.0) / 2  # heading left
    rows = resting(1, x_m=10.0, qz=math.sin(half), qw=math.cos(half))
    found = readings(receiver(one), 1, 1, rows)[0, 0]
    back = pymap3d.geodetic2enu(*found[:3], 34.8, -82.32, 250.0)
    assert [float(v) for v in back] == pytest.approx([9.0, 2.0, 1.5], abs=1e-4)


def test_gnss_errors_have_the_configured_size():
    cars = 200
    settings = {"hz": 1, "bias_time_s": 20.0, "antenna_m": [0, 0, 0]}
    one = case(hz=10, gnss=settings)
    sensor = built(SatelliteReceiver, one, cars, HOME)
    for slot in range(cars):
        sensor.reset(slot, case(f"car-{slot}", hz=10, gnss=settings))
    found = readings(sensor, cars, 4000)
    east, north, up = pymap3d.geodetic2enu(*found[..., :3].reshape(-1, 3).T, 34.8, -82.32, 250.0)
    gnss = one.variation.sensors.gnss
    for errors, white_m, bias_m in (
        (east, gnss.noise_horizontal_m, gnss.bias_horizontal_m),
        (north, gnss.noise_horizontal_m, gnss.bias_horizontal_m),
        (up, gnss.noise_vertical_m, gnss.bias_vertical_m),
    ):
        errors = errors.reshape(len(found), cars)
        total_m = math.hypot(white_m, bias_m)
        assert errors.std() == pytest.approx(total_m, rel=0.05)
        assert errors[0].std() == pytest.approx(total_m, rel=0.15)  # from the first fix on
        assert abs(errors.mean()) < 0.1 * total_m
        for lag_s in (1, 20):  # what is left of the correlation after a time
            product = (errors[lag_s:] * errors[:-lag_s]).mean()
            assert product == pytest.approx(bias_m**2 * math.exp(-lag_s / 20.0), rel=0.08)


def test_dropouts_come_and_last_as_configured():
    cars, fixes = 100, 1200
    settings = {"dropouts_per_min": 6.0, "dropout_s": 3.0}
    sensor = built(SatelliteReceiver, case(gnss=settings), cars, HOME)
    for slot in range(cars):
        sensor.reset(slot, case(f"car-{slot}", gnss=settings))
    found = readings(sensor, cars, 2 * fixes)
    lost = found[..., FIX] == 0.0
    assert (np.isnan(found[..., :3]).all(axis=2) == lost).all()
    starts = (lost[1:] & ~lost[:-1]).sum()
    received_min = (~lost[:-1]).sum() / 10.0 / 60.0
    assert starts / received_min == pytest.approx(6.0, rel=0.1)
    assert lost[1:].sum() / 10.0 / starts == pytest.approx(3.0, rel=0.1)


# --- IMU ----------------------------------------------------------------------------------------


def test_imu_at_rest_reads_plus_g_up():
    quiet = built(InertialUnit, case(imu={"noise": False}), 1)
    quiet.reset(0, case(imu={"noise": False}))
    assert readings(quiet, 1, 1)[0, 0].tolist() == [0, 0, GRAVITY_MPS2, 0, 0, 0]
    real = built(InertialUnit, case(imu={}), 1)
    real.reset(0, case(imu={}))
    mean = readings(real, 1, 400)[:, 0, ACCEL].mean(axis=0)
    assert mean == pytest.approx([0, 0, GRAVITY_MPS2], abs=0.005 * 3 * GRAVITY_MPS2)
    assert mean[2] != GRAVITY_MPS2


def test_imu_passes_the_truth_of_every_axis():
    one = case(imu={"noise": False})
    sensor = built(InertialUnit, one, 2)
    sensor.reset(0, one)
    sensor.reset(1, one)
    rows = np.arange(2.0 * len(TRUTH)).reshape(2, -1)
    first = TRUTH.index("force_x_mps2")
    assert (readings(sensor, 2, 1, rows)[0] == rows[:, first : first + 6]).all()


def test_scale_error_is_one_draw_per_case_and_axis():
    only = {"accel_noise_mps2_per_sqrt_hz": 0.0, "gyro_noise_degps_per_sqrt_hz": 0.0}
    only |= {"accel_bias_mps2": 0.0, "gyro_bias_degps": 0.0}
    only |= {"accel_scale": 0.02, "gyro_scale": 0.01}
    cars = 300
    sensor = built(InertialUnit, case(imu=only), cars)
    for slot in range(cars):
        sensor.reset(slot, case(f"car-{slot}", imu=only))
    forces = {f"force_{axis}_mps2": 10.0 for axis in "xyz"}
    rates = {f"rate_{axis}_radps": 1.0 for axis in "xyz"}
    found = readings(sensor, cars, 3, resting(cars, **forces, **rates))
    assert (found == found[0]).all()
    scale = found[0] / np.repeat([10.0, 1.0], 3) - 1.0
    assert scale.std(axis=0) == pytest.approx(np.repeat([0.02, 0.01], 3), rel=0.15)
    assert np.abs(np.corrcoef(scale.T) - np.eye(6)).max() < 0.2


def test_factors_act_from_the_next_sample_on():
    one = case(imu={"accel_scale": 0.0, "gyro_scale": 0.0})
    sensor = built(InertialUnit, one, 2)
    for slot in range(2):
        sensor.reset(slot, one)
    truth, tick = on_device(resting(2)), np.zeros(2, np.int32)
    before = sensor.read(truth, tick).copy()
    assert (before[0] == before[1]).all()
    sensor.modulate(1, SensorErrors(imu_noise=0.0, imu_bias=0.0))
    quiet = sensor.read(truth, tick + 1).copy()
    assert quiet[1].tolist() == [0, 0, GRAVITY_MPS2, 0, 0, 0]
    assert (quiet[0] != quiet[1]).all()
    sensor.modulate(1, SensorErrors())
    after = sensor.read(truth, tick + 2)
    assert (after[0] == after[1]).all()  # the bias has walked on meanwhile


# --- encoders -----------------------------------------------------------------------------------


def test_encoders_count_every_edge_exactly():
    one = case(encoders={"ppr": 16, "cgr": 120})
    sensor = built(WheelEncoders, one, 4)
    for slot in range(4):
        sensor.reset(slot, one)
    first = TRUTH.index("wheel_fl_rad")
    step = 2 * math.pi / (16 * 120)
    for revolutions in (0, 1, 7, -1, 100_000, -100_000):
        for parts, extra in ((0, 0), (0.5, 0), (0.999, 0), (1.001, 1), (-0.001, -1), (-1.001, -2)):
            rows = resting(4)
            rows[:, first : first + 4] = 2 * math.pi * revolutions + parts * step
            if parts == 0:  # an edge itself belongs to the next tick, in whatever rounding
                rows[:, first : first + 4] += 1e-4 * step
            found = sensor.read(on_device(rows), np.zeros(4, np.int32))
            assert found.dtype == np.int64
            assert (found == 1920 * revolutions + extra).all(), (revolutions, parts)


def test_ticks_over_a_drive_add_up():
    """No tick is lost or counted twice, however the turning is cut into readings."""
    one = case(encoders={"ppr": 48, "cgr": 2.5})
    sensor = built(WheelEncoders, one, 1)
    sensor.reset(0, one)
    angles = np.cumsum(np.random.default_rng(3).normal(0.5, 2.0, 2000))
    first = TRUTH.index("wheel_rr_rad")
    counted, last = 0, 0
    for tick, angle in enumerate(angles):
        rows = resting(1)
        rows[0, first] = angle
        now = int(sensor.read(on_device(rows), np.array([tick], np.int32))[0, 3])
        counted, last = counted + now - last, now
    assert counted == math.floor(120 * (angles[-1] / (2 * math.pi)))


# --- independence of slots ----------------------------------------------------------------------


@pytest.mark.parametrize("kind", [SatelliteReceiver, InertialUnit, WheelEncoders])
def test_bytes_do_not_depend_on_slot_batch_or_neighbours(kind):
    gnss = {"dropouts_per_min": 60.0, "dropout_s": 0.5}
    settings = {"gnss": gnss, "imu": {"hz": 10}, "encoders": {"hz": 10}}
    mine, other = case("mine", **settings), case("other", seed=9, **settings)
    own = np.random.default_rng(5).normal(0.0, 3.0, len(TRUTH))

    def run(slots, slot, neighbours):
        sensor = built(kind, mine, slots)
        rows = np.random.default_rng(slots).normal(0.0, 3.0, (slots, len(TRUTH)))
        rows[slot] = own
        for k in range(slots):
            if k == slot:
                sensor.reset(k, mine)
            elif k in neighbours:
                sensor.reset(k, other)
        return readings(sensor, slots, 80, rows)[:, slot].tobytes()

    alone = run(1, 0, ())
    for slots, slot in ((3, 0), (3, 2), (64, 0), (64, 1), (64, 37), (64, 63)):
        assert run(slots, slot, range(slots)) == alone
        assert run(slots, slot, ()) == alone


@pytest.mark.parametrize("kind", [SatelliteReceiver, InertialUnit])
def test_a_slot_forgets_its_last_case(kind):
    one, other = case("one", gnss={}, imu={"hz": 10}), case("other", gnss={}, imu={"hz": 10})
    sensor = built(kind, one, 1)
    sensor.reset(0, one)
    first = readings(sensor, 1, 30)
    sensor.modulate(0, SensorErrors(gnss_dropout=True, imu_noise=5.0))
    sensor.reset(0, other)
    assert (readings(sensor, 1, 30) != first).any()
    sensor.reset(0, one)
    assert readings(sensor, 1, 30).tobytes() == first.tobytes()
    sensor.clear(0)
    assert not readings(sensor, 1, 2).any()


def test_a_dropout_ends_with_its_case():
    lossy = case(gnss={"dropouts_per_min": 600.0, "dropout_s": 3600.0})
    sensor = receiver(lossy)
    assert readings(sensor, 1, 40)[-1, 0, FIX] == 0.0
    calm = case(gnss={})
    sensor.reset(0, calm)
    assert readings(sensor, 1, 1)[0, 0, FIX] == 1.0


def test_gaussian_numbers_are_normal():
    count = 400_000
    out = wp.zeros(count, dtype=wp.float64, device=CPU)
    wp.launch(draw_kernel, count, inputs=[wp.uint64(77)], outputs=[out], device=CPU)
    values = out.numpy()
    assert abs(values.mean()) < 0.006
    assert values.std() == pytest.approx(1.0, abs=0.005)
    for limit in (1.0, 2.0, 3.0, 4.0):
        beyond = math.erfc(limit / math.sqrt(2.0))
        found = (np.abs(values) > limit).mean()
        assert found == pytest.approx(beyond, abs=4 * math.sqrt(beyond / count))
    series = values.reshape(-1, 8)
    assert np.abs(np.corrcoef(series.T) - np.eye(8)).max() < 0.015
    assert abs((series[1:] * series[:-1]).mean()) < 0.006
