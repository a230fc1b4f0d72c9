"""Gusts: their statistics, and that a case's wind is its own."""

import numpy as np
import pytest

from schemas.identity import stream_key
from twin.world.sky.weather import WEATHER
from twin.world.sky.wind import LENGTH_M, Winds, gaussian_pairs


def blow(winds, ticks):
    return np.stack([winds.advance(np.full(len(winds.now), k)).copy() for k in range(ticks)])


def storm(slots, mean=10.0, sigma=2.0, period_s=0.05, toward=(1.0, 0.0)):
    winds = Winds(slots, period_s)
    for slot in range(slots):
        winds.reset(slot, stream_key(1, f"case-{slot}", "wind"), toward)
        winds.set(slot, mean, sigma)
    return winds


def test_numbers_are_normal_and_streams_unrelated():
    keys = np.array([stream_key(0, str(i), "wind") for i in range(20_000)], np.uint64)
    a, b = (
        gaussian_pairs(keys, np.zeros(len(keys), np.int64)),
        gaussian_pairs(keys, np.ones(len(keys), np.int64)),
    )
    for sample in (a[:, 0], a[:, 1], b[:, 0]):
        assert abs(sample.mean()) < 0.03
        assert sample.std() == pytest.approx(1.0, abs=0.02)
        assert (np.abs(sample) < 1.959964).mean() == pytest.approx(0.95, abs=0.008)
    for one, other in ((a[:, 0], a[:, 1]), (a[:, 0], b[:, 0]), (a[1:, 0], a[:-1, 0])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.03


@pytest.mark.parametrize("period_s", [0.05, 0.01])
def test_gusts_have_drydens_variance_and_length_at_every_rate(period_s):
    mean, sigma = 10.0, 2.0
    series = blow(storm(600, mean, sigma, period_s), 600)
    along, across = series[..., 0] - mean, series[..., 1]
    for gust in (along, across):
        assert abs(gust.mean()) < 0.15
        assert gust.std() == pytest.approx(sigma, rel=0.05)
        lag = 40
        kept = (gust[lag:] * gust[:-lag]).mean() / gust.var()
        assert kept == pytest.approx(np.exp(-lag * period_s * mean / LENGTH_M), abs=0.05)
    assert abs((along * across).mean()) < 0.1


def test_a_case_has_the_same_wind_in_any_slot_and_company():
    alone = Winds(1, 0.05)
    alone.reset(0, stream_key(1, "case-2", "wind"), (0.0, 1.0))
    alone.set(0, 10.0, 2.0)
    crowd = storm(5, toward=(0.0, 1.0))
    a, b = blow(alone, 50), blow(crowd, 50)
    assert a[:, 0].tobytes() == b[:, 2].tobytes()
    # A slot that begins again later blows the same.
    crowd.reset(4, stream_key(1, "case-2", "wind"), (0.0, 1.0))
    crowd.set(4, 10.0, 2.0)
    again = []
    for k in range(50):
        tick = np.array([50 + k] * 4 + [k])
        again.append(crowd.advance(tick)[4].copy())
    assert np.array(again).tobytes() == a[:, 0].tobytes()


def test_calm_is_exactly_calm():
    winds = Winds(2, 0.05)
    winds.reset(0, 7, (1.0, 0.0))
    assert not blow(winds, 20).any()


def test_presets_blow_as_their_weather():
    assert (
        WEATHER["light_fog"].wind_mps < WEATHER["clear"].wind_mps < WEATHER["heavy_rain"].wind_mps
    )
    assert 5.5 < WEATHER["heavy_rain"].wind_mps < 10.7  # a moderate to a fresh breeze
    for weather in WEATHER.values():
        assert weather.gust_mps == pytest.approx(0.2 * weather.wind_mps)


def test_gusts_blow_along_the_wind_and_to_its_left():
    """The same case in two directions: one is the other one turned."""
    east, turned = (storm(1, toward=toward) for toward in ((1.0, 0.0), (0.6, 0.8)))
    along, across = blow(east, 60)[:, 0].T
    x, y = blow(turned, 60)[:, 0].T
    np.testing.assert_allclose(0.6 * x + 0.8 * y, along, rtol=1e-12)
    np.testing.assert_allclose(0.6 * y - 0.8 * x, across, atol=1e-12)
    assert np.abs(across).max() > 1.0
