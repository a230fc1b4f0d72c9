"""Rain, snow and fog before a LiDAR: published figures, and the physics drop by drop."""

import json

import numpy as np
import pytest
from lidar_rigs import profile
from msgspec.structs import replace
from typer.testing import CliRunner

from twin.base.errors import UsageError
from twin.cli import app
from twin.sensors.lidar import hydrometeors, near_field, scatter
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.validate import precipitation

SHIPPED = ("spinning_16", "spinning_32", "spinning_128")


def row_of(rate_mm_per_h: float, *, snow: bool) -> int:
    """Row of the tables of drops."""
    rates = scatter.RATES_MM_PER_H
    nearest = int(np.abs(np.log(rates / rate_mm_per_h)).argmin())
    return nearest + (len(rates) if snow else 0)


@pytest.mark.parametrize("name", SHIPPED)
def test_what_a_lidar_sees_of_rain_and_snow_is_within_what_was_published(name):
    kind = load_lidar_profile(name)
    found = precipitation.figures(kind)
    rows = precipitation.checks(found, kind)
    assert len(rows) == (4 if name == "spinning_128" else 7)
    assert not [row for row in rows if not row.passed]
    for weather in ("rain", "snow"):
        own = [each for each in found if each.weather == weather]
        returns = [each.returns for each in own]
        assert returns == sorted(returns)
        assert returns[-1] > 0.001
        assert own[-1].range_m[0] > kind.range_min_m
        # The air takes more returns of targets away the more of it there is.
        targets = [each.target for each in own]
        assert targets == sorted(targets, reverse=True)
        assert targets[0] > 0.9


def test_light_rain_is_all_but_invisible():
    """At 2 mm/h three of four pulses into the sky came back from a drop, with a median of 6.6 m."""
    found = precipitation.figures(load_lidar_profile("spinning_128"))
    assert found[0].weather == "rain"
    assert found[0].amount == 2.0
    assert found[0].returns < 0.001


def test_a_drop_reflects_as_geometric_optics_says():
    """At 1550 nm absorption ends glory, and Mie's theory (miepython 3.3, sizes within 5 %) says the
    same."""
    mie = {1.0: 0.036, 2.0: 0.021, 3.0: 0.019, 4.0: 0.019}
    found = hydrometeors.sphere_efficiency(np.array(list(mie)), long_wave=True)
    assert found == pytest.approx(list(mie.values()), rel=0.12)
    short = hydrometeors.sphere_efficiency(np.array([1.0]), long_wave=False)[0]
    assert short == pytest.approx(0.0198 + 0.0741, rel=0.02)  # front and rear
    large = hydrometeors.drop_reflectance(np.array([1.0, 3.0, 5.0]), long_wave=False)
    assert large[0] == pytest.approx(short / 4, rel=0.08)
    assert (np.diff(large) > 0.0).all()  # the flatter, the brighter


def test_water_is_darker_at_1550_nm():
    seen = [
        scatter.scatter(profile(wavelength_nm=wavelength, range_10_percent_m=150.0)).drops_expected[
            row_of(25.0, snow=False)
        ]
        for wavelength in (905.0, 1550.0)
    ]
    assert seen[1] < 0.5 * seen[0]


def counted_on_detector(kind, range_m: float) -> float:
    """Share of rays from a Gaussian beam, through a lens beside it, that meet the detector."""
    rng = np.random.default_rng(3)
    n = 400_000
    width, height = (float(v[0]) for v in near_field.beam_size(kind, np.array([range_m])))
    beam = rng.normal(size=(n, 2)) * np.array([width, height]) / 4.0  # 1 / e^2 at two sigma
    radius = 0.5 * near_field.APERTURE_M * np.sqrt(rng.uniform(size=n))
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    lens = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    # Focused at infinity: a ray's place on the detector is its angle.
    angle = (beam + np.array([near_field.BASELINE_M, 0.0]) - lens) / range_m
    field = 0.5 * max(near_field.APERTURE_M / kind.focus_m, 1e-3 * max(kind.divergence_mrad))
    return float((np.hypot(angle[:, 0], angle[:, 1]) < field).mean())


@pytest.mark.parametrize("range_m", [2.0, 5.0, 10.0, 30.0])
def test_share_of_light_on_the_detector_by_rays(range_m):
    kind = load_lidar_profile("spinning_32")
    expected = counted_on_detector(kind, range_m) / counted_on_detector(kind, 60.0)
    found = near_field.near_field(kind, np.array([range_m])).mean[0]
    assert found == pytest.approx(expected, rel=0.06)


def test_nearby_less_is_seen_and_far_away_all():
    kind = load_lidar_profile("spinning_32")
    at = np.array([0.6, 1.0, 2.0, 4.0, 8.0, 16.0, 60.0])
    caught = near_field.near_field(kind, at).mean
    assert (np.diff(caught) > 0.0).all()
    assert caught[1] < 0.01
    assert caught[-1] == pytest.approx(1.0, abs=0.01)
    sharp = near_field.near_field(replace(kind, focus_m=0.0), at)
    assert sharp.mean == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("snow", "rate"),
    [pytest.param(True, 1.0, marks=pytest.mark.slow), (True, 4.0), (False, 60.0)],
)
def test_number_of_echoes_drop_by_drop(snow, rate):
    """Drops strewn at random over a beam twice as wide, each held against the threshold."""
    kind = load_lidar_profile("spinning_128")
    row = row_of(rate, snow=snow)
    rate = float(scatter.RATES_MM_PER_H[row % len(scatter.RATES_MM_PER_H)])
    of = hydrometeors.fall(rate, snow=snow)
    target = hydrometeors.target_mm2(kind, snow=snow)
    rng = np.random.default_rng(11)
    n = 2_000_000
    r = rng.uniform(kind.range_min_m, 60.0, n)
    wide, high = near_field.beam_size(kind, r)
    side = rng.uniform(-1.6, 1.6, (n, 2))  # over the beam's half axes
    reach = np.hypot(side[:, 0], side[:, 1])
    # Large drops are rare: draw sizes evenly and weigh them.
    diameter = rng.uniform(0.02, 8.0, n)
    weight = of.n0 * np.exp(-of.slope_per_mm * diameter) * 7.98  # [1/m^3]
    weight = weight * (1.6 * wide) * (1.6 * high) * (60.0 - kind.range_min_m) / n
    x, y = 0.5 * side[:, 0] * wide, 0.5 * side[:, 1] * high
    apart = np.hypot(x + near_field.BASELINE_M, y)
    caught = near_field.on_detector(kind, r, apart)
    caught = caught / counted_on_detector(kind, kind.range_10_percent_m)
    signal = 2.0 * np.exp(-2.0 * reach**2) * caught * 1e-6 / (wide * high * r**2)
    signal *= np.interp(diameter, hydrometeors.DIAMETERS_MM, target)
    signal *= np.exp(-2.0 * of.extinction_per_m * r)
    seen = (signal > scatter.threshold(kind)) & (reach < 1.6)
    counted, error = weight[seen].sum(), np.sqrt((weight[seen] ** 2).sum())
    assert error < 0.04 * counted
    found = scatter.scatter(kind).drops_expected[row]
    assert abs(found - counted) < 0.05 * counted + 3.0 * error


def test_which_return_is_kept_decides_its_range():
    kind = load_lidar_profile("spinning_128")
    row = row_of(4.0, snow=True)
    median = {
        mode: scatter.scatter(replace(kind, returns=mode)).drops[row, 16, 0]
        for mode in ("first", "strongest", "last")
    }
    assert median["first"] < median["strongest"] < median["last"]


def test_command_prints_the_figures():
    ran = CliRunner().invoke(app, ["validate", "lidar", "spinning_16", "--output", "json"])
    assert ran.exit_code == 0, ran.output
    printed = json.loads(ran.stdout[ran.stdout.index("{") :])
    assert printed["passed"]
    assert len(printed["figures"]) == 11
    table = CliRunner().invoke(app, ["validate", "lidar", "spinning_16"])
    assert "snow, 1 mm/h" in table.stdout
    assert "Pitropov" in table.stdout
    nobody = CliRunner().invoke(app, ["validate", "lidar", "spinning_17"])
    assert isinstance(nobody.exception, UsageError)


def test_command_fails_outside_of_the_published_range(tmp_path):
    """A sensor that sees ten times farther than the class that counted flakes."""
    text = (
        "schema: 1\nlidar: keen\ntheta_res_deg: 2\nphi_min_deg: -10\nphi_max_deg: 10\n"
        "phi_res_deg: 1\nrange_min_m: 0.5\nrange_max_m: 120\nrange_10_percent_m: 80\nhz: 10\n"
        "wavelength_nm: 905\ndivergence_mrad: [0.2, 0.2]\nfocus_m: 0\nnoise_m: 0.01\n"
    )
    path = tmp_path / "keen.yaml"
    path.write_text(text)
    assert CliRunner().invoke(app, ["validate", "lidar", str(path)]).exit_code == 1
