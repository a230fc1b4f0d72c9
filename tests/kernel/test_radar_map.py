"""The radar's map against a Fourier transform of samples, its false alarms, and equal bytes."""

import math

import numpy as np
import pytest
import warp as wp
from lidar_rigs import wall, world
from radar_rigs import HEIGHT_M, RANGE, SNR, measure, radar, small_profile, vehicle_row

from twin.sensors.radar.bodies import LOBE, Reflector
from twin.sensors.radar.profile import load_radar_profile
from twin.sensors.radar.rain import coefficients
from twin.sensors.radar.sensor import bytes_per_slot
from twin.sensors.radar.threshold import factor, false_alarms, level_mean
from twin.sensors.radar.window import chebyshev

PROFILE = small_profile()


def targets():
    rng = np.random.default_rng(5)
    return [
        Reflector(
            LOBE,
            (float(x), float(y), HEIGHT_M + float(z)),
            size_m=(float(m2), 100.0),
            velocity_mps=(float(v), 0.0),
        )
        for x, y, z, m2, v in zip(
            rng.uniform(4, 33, 12),
            rng.uniform(-3, 3, 12),
            rng.uniform(-0.4, 1, 12),
            rng.uniform(0.1, 20, 12),
            rng.uniform(-15, 12, 12),
            strict=True,
        )
    ]


def test_the_map_is_the_fourier_transform_of_the_samples():
    """Samples of every chirp and antenna, windowed and transformed by NumPy."""
    sensor = radar(reflectors=targets())
    measure(sensor)
    echoes = sensor.echoes.numpy()[0]
    echoes = echoes[echoes["power"] > 0.0]
    assert len(echoes) == 12
    ranges, speeds = PROFILE.samples, PROFILE.chirps
    fast = np.arange(ranges) - 0.5 * (ranges - 1)
    slow = np.arange(speeds) - 0.5 * (speeds - 1)
    windows = [chebyshev(n, PROFILE.sidelobe_db) for n in (ranges, speeds)]
    antenna = PROFILE.columns - 1
    samples = np.zeros((speeds, ranges), complex)
    for echo in echoes:
        signal = complex(*echo["signal"]) * complex(*echo["step"]) ** antenna
        tone = np.exp(2j * np.pi * echo["row"] * fast / ranges)
        samples += signal * np.outer(np.exp(2j * np.pi * echo["column"] * slow / speeds), tone)
    weighted = samples * np.outer(windows[1], windows[0])
    expected = np.fft.fft2(weighted) / (windows[0].sum() * windows[1].sum())
    # The transform counts from the first sample, the map from the windows' middle.
    late = [np.exp(1j * np.pi * np.arange(n) * (n - 1) / n) for n in (speeds, ranges)]
    expected *= np.outer(*late)
    # Speed cells are a circle: a tone that wraps has turned by the middle of the window.
    shape = (speeds, ranges)
    there = sensor.touched.numpy().reshape(shape) != 0
    pairs = sensor.signals.numpy()[:, antenna].reshape(*shape, 2)
    ours = np.where(there, pairs[..., 0] + 1j * pairs[..., 1], 0.0)
    loudest = math.sqrt(echoes["power"].max())
    # Faint limit of what is added, and side lobes 70 dB below each echo.
    assert np.abs(np.abs(ours) - np.abs(expected)).max() < 12 * (0.032 + 5e-4 * loudest)
    strong = np.abs(expected) > 20.0
    assert strong.sum() > 50
    assert ours[strong] == pytest.approx(expected[strong], rel=0.02)


@pytest.mark.parametrize("rate", [1e-2, 1e-3])
def test_noise_exceeds_the_threshold_as_often_as_asked(rate):
    sensor = radar(small_profile(false_alarm_rate=rate), noise=1)
    cells, alarms, total = 0, 0, 0.0
    rows = slice(sensor.model.first_row, sensor.model.last_row + 1)
    ticks = 140
    for tick in range(ticks):
        measure(sensor, tick=tick)
        sensor.look(peaks_only=False)
        alarm = sensor.alarm.numpy()[:, :, rows]
        cells += alarm.size
        alarms += int(alarm.sum())
        total += float(sensor.power.numpy().mean())
    assert cells > 1e6
    assert alarms / cells == pytest.approx(rate, rel=0.1)
    assert total / ticks == pytest.approx(1.0, abs=1e-3), "power is in units of the noise"


def test_the_factor_of_one_antenna_is_rohlings_product():
    for rate in (1e-2, 1e-4, 1e-6):
        above = factor(rate, 1)
        product = math.prod((32 - i) / (32 - i + above) for i in range(24))
        assert product == pytest.approx(rate, rel=1e-4)
        assert false_alarms(above, 1) == pytest.approx(rate, rel=1e-4)
    mean = sum(1.0 / (32 - i) for i in range(24))
    assert level_mean(1) == pytest.approx(mean, rel=1e-4)


@pytest.mark.parametrize(
    ("ghz", "k_h", "alpha_h", "k_v", "alpha_v"),
    [
        (10, 0.01217, 1.2571, 0.01129, 1.2156),
        (40, 0.4431, 0.8673, 0.4274, 0.8421),
        (80, 1.1704, 0.7115, 1.1668, 0.7021),
        (100, 1.3671, 0.6815, 1.3680, 0.6765),
    ],
)
def test_rain_has_the_coefficients_of_the_recommendations_table(ghz, k_h, alpha_h, k_v, alpha_v):
    """Table 5 of ITU-R P.838-3."""
    assert coefficients(ghz * 1e9, vertical=False) == pytest.approx((k_h, alpha_h), rel=5e-4)
    assert coefficients(ghz * 1e9, vertical=True) == pytest.approx((k_v, alpha_v), rel=5e-4)


def test_rain_is_an_echo_of_its_own_and_moves_with_the_air():
    sensor = radar(noise=1)
    sensor.weather(0, rain_mm_per_h=25.0)
    row = vehicle_row(speed_mps=12.0)
    powers = []
    for tick in range(8):
        measure(sensor, row, tick=tick)
        powers.append(sensor.power.numpy()[0].copy())
    near = np.mean(powers, axis=0)[:, 8:16].mean(axis=1)
    cell = round((-12.0 - PROFILE.speed_min_mps) / PROFILE.speed_cell_mps)
    assert near[cell] > 1.5
    assert near[(cell + 32) % 64] == pytest.approx(1.0, abs=0.1), "still air"


@pytest.mark.parametrize("slots", [5, 64])
def test_a_slot_measures_the_same_whatever_its_number_and_company(slots):
    def all_of(count):
        sensor = radar(reflectors=targets(), slots=count, noise=1, multipath=1, clutter=1)
        for slot in range(count):
            sensor.state.host[slot]["key"] = 99
            sensor.weather(slot, rain_mm_per_h=5.0)
        return [rows.tobytes() for rows in measure(sensor, tick=3)]

    alone = all_of(1)[0]
    assert len(alone) > 12 * 4 * 6 / 2
    assert set(all_of(slots)) == {alone}


def test_a_slot_without_a_case_has_no_rows_and_disturbs_no_other():
    sensor = radar(reflectors=targets(), slots=2, noise=1)
    both = measure(sensor)
    sensor.clear(0)
    rest = measure(sensor)
    assert len(both[0]) > 0
    assert len(rest[0]) == 0
    assert rest[1].tobytes() == both[1].tobytes()
    assert (sensor.rows.host[0] == 0.0).all()


def test_more_peaks_than_rows_keep_the_strongest():
    sensor = radar(small_profile(false_alarm_rate=0.1), noise=1)
    rows = measure(sensor)[0]
    assert int(sensor.peaks_total.numpy()[0]) > 128
    assert len(rows) == 128
    assert (np.diff(np.round(rows[:, RANGE] / PROFILE.range_cell_m)) >= -1).all()
    found = sensor.found.numpy()[0]
    levels = np.sort(found["snr_db"][found["kept"] != 0])
    assert rows[:, SNR].min() == levels[-128]


def test_hidden_targets_are_not_seen():
    behind = radar(reflectors=targets(), scene=world(wall(2.0, 40.0)))
    assert len(measure(behind)[0]) == 0


def test_a_wall_that_faces_the_radar_is_its_mirror_image():
    """Mirror term of clutter: pi R^2 r, r of a plain surface 0.4, over many random facets."""
    grid = small_profile(rays=[96, 64], half_view_deg=[60.0, 40.0], beam_deg=[300.0, 300.0])
    sensor = radar(grid, scene=world(wall(12.0, 40.0)), clutter=1)
    sums = []
    for tick in range(40):
        measure(sensor, tick=tick)
        echoes = sensor.echoes.numpy()[0]
        far = echoes["row"] * PROFILE.range_cell_m
        scale = sensor.model.signal / np.maximum(far, 1.0) ** 4
        near_axis = echoes["power"] > 0
        sums.append((echoes["power"] / scale * (12.0 / np.maximum(far, 1.0)) ** 4)[near_axis].sum())
    assert 10 * np.log10(np.mean(sums) / (math.pi * 144.0 * 0.4)) == pytest.approx(0.0, abs=1.0)


def test_the_memory_of_a_slot_is_what_is_allocated():
    """Arrays of the slots are as long as there are slots, or a multiple."""
    slots = 7
    sensor = radar(reflectors=targets(), slots=slots)
    shared = {"_templates", "_standing", "_surface"}
    own = {k: a for k, a in vars(sensor).items() if isinstance(a, wp.array) and k not in shared}
    assert all(a.shape[0] % slots == 0 for a in own.values())
    bodies = sensor.echoes.shape[1] - PROFILE.rays[0] * PROFILE.rays[1]
    assert sum(a.capacity for a in own.values()) == slots * bytes_per_slot(PROFILE, bodies)
    assert 12e6 < bytes_per_slot(load_radar_profile("long_range"), 1000) < 13e6, "docs/limits.md"


def test_products_and_sums_are_not_fused():
    """Fused ones differ between devices."""
    sensor = radar()
    assert [kernel.module.options["fuse_fp"] for kernel in sensor.unique] == [False] * 4
