"""LiDAR signal: intensity, weather, beams that meet two targets, dropouts."""

import numpy as np
import pytest
from lidar_rigs import (
    DROP,
    FOG,
    INTENSITY,
    KIND,
    QUIET,
    RANGE,
    SURFACE,
    X,
    look,
    profile,
    sensor,
    wall,
    world,
)

from schemas.sections.lidar import Lidar
from twin.render.trace.geometry import Face
from twin.sensors.lidar import scatter as lidar_scatter
from twin.sensors.lidar.lidar import LidarWeather
from twin.sensors.lidar.near_field import near_field
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.sensors.lidar.surface import face_colors, face_returns
from twin.world.meshes import materials

HEAVY_FOG = 2.996 / 120.0
ONE_RAY = {"theta_min_deg": 0.0, "theta_max_deg": 0.2, "phi_min_deg": 0.0, "phi_max_deg": 0.0}


def tilted(x_m: float, angle_rad: float):
    """A wall before the sensor whose normal is turned from it by ``angle_rad``."""
    side = np.array([np.sin(angle_rad), np.cos(angle_rad), 0.0]) * 30.0
    middle, up = np.array([x_m, 0.0, 0.0]), np.array([0.0, 0.0, 30.0])
    return [middle - side - up, middle + side - up, middle + side + up, middle - side + up]


def one(points: np.ndarray) -> float:
    return float(points[0, INTENSITY])


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 60.0, 75.0])
def test_intensity_falls_with_the_cosine_of_incidence_and_not_with_range(angle_deg):
    for x_m in (8.0, 25.0):
        scene = world(tilted(x_m, np.radians(angle_deg)), color=(0.6, 0.6, 0.6))
        found = one(look(sensor(scene, profile(**ONE_RAY))))
        # PLAIN: 0.12 + 0.75 x luminance.
        assert found == pytest.approx(57.0 * np.cos(np.radians(angle_deg)), abs=0.6)


def test_retro_reflectors_are_above_100_and_glass_is_dark():
    def seen(material):
        return one(look(sensor(world(wall(20.0), material=material), profile(**ONE_RAY))))

    assert seen(materials.REFLECTOR) > 180
    assert 100 < seen(materials.PAINT) < 130
    assert seen(materials.GLASS) < 10
    assert seen(materials.ASPHALT) < 60


def test_a_wet_road_returns_less_and_a_white_one_more():
    ground = [(-50, -50, -1.0), (50, -50, -1.0), (50, 50, -1.0), (-50, 50, -1.0)]
    down = profile(theta_min_deg=0.0, theta_max_deg=0.2, phi_min_deg=60.0, phi_max_deg=60.0)
    eye = sensor(world(ground, material=materials.ASPHALT, color=(0.1, 0.1, 0.1)), down)
    dry, wet = one(look(eye)), one(look(eye, LidarWeather(wetness=1.0)))
    white = one(look(eye, LidarWeather(snow_cover=0.95)))
    assert wet < 0.6 * dry
    assert white > 3.0 * dry
    long_wave = profile(
        theta_min_deg=0.0, theta_max_deg=0.2, phi_min_deg=60.0, phi_max_deg=60.0,
        wavelength_nm=1550,
    )  # fmt: skip
    eye = sensor(world(ground, material=materials.ASPHALT, color=(0.1, 0.1, 0.1)), long_wave)
    assert one(look(eye, LidarWeather(snow_cover=0.95))) < one(look(eye))


def test_an_image_on_a_face_decides_its_reflectance():
    """The left half of the image is white, the right half nearly black."""
    faces = np.zeros(3, Face.numpy_dtype())
    faces["texture"], faces["color"] = [0, 0, -1], 0.5
    image = np.zeros((4, 8, 3), np.uint8)
    image[:, :4] = 255
    uv = np.array([[[0.1, 0.1], [0.3, 0.1], [0.2, 0.5]], [[1.7, 0.1], [1.9, 0.1], [1.8, 0.5]]])
    uv = np.concatenate([uv, uv[:1]])
    colors = face_colors(faces, uv, (image,))
    assert colors[:, 0].tolist() == pytest.approx([0.5, 0.0, 0.5])
    bright, dark, plain = face_returns(faces, colors, profile())[:, 0]
    assert bright == plain
    assert dark == pytest.approx(0.12)


def test_range_at_10_percent_is_where_half_of_the_pulses_are_seen():
    # PLAIN of luminance 0.2 has reflectance 0.27: seen as far as sqrt(2.7) times 10 %.
    far = 100.0 * np.sqrt(2.7)
    kind = profile(theta_min_deg=-1, theta_max_deg=1, theta_res_deg=0.05, phi_min_deg=-1,
                   phi_max_deg=1, phi_res_deg=0.05)  # fmt: skip
    for distance, low, high in ((0.8 * far, 0.98, 1.0), (far, 0.46, 0.54), (1.2 * far, 0.0, 0.1)):
        scene = world(wall(distance), color=(0.2, 0.2, 0.2))
        points = look(sensor(scene, kind, Lidar(motion=False)))
        assert low <= (points[:, KIND] == SURFACE).mean() <= high


def surfaces(eye, weather, ticks):
    """Share of pulses that return from a surface, and their mean signal with lost ones as 0."""
    share, signal = [], []
    for tick in range(ticks):
        points = look(eye, weather, tick=tick)
        there = points[:, KIND] == SURFACE
        share.append(there.mean())
        signal.append(np.where(there, points[:, INTENSITY], 0.0).mean())
    return np.mean(share), np.mean(signal)


@pytest.mark.parametrize("distance_m", [10.0, 20.0, 35.0, 50.0, 70.0])
@pytest.mark.parametrize("mor_m", [120.0, 500.0])
def test_share_of_returns_on_a_target_in_fog_follows_beer_lambert(distance_m, mor_m):
    """Issue: LiDAR in fog, share of returns on the target follows exp(-2 alpha R), 5 %."""
    alpha = 2.996 / mor_m
    kind = profile(theta_min_deg=-3, theta_max_deg=3, theta_res_deg=0.02, phi_min_deg=-3,
                   phi_max_deg=3, phi_res_deg=0.05)  # fmt: skip
    eye = sensor(world(wall(distance_m), color=(0.9, 0.9, 0.9)), kind, Lidar(motion=False))
    expected = np.exp(-2.0 * alpha * distance_m)
    clear, full = surfaces(eye, LidarWeather(), 1)
    ticks = 1 if expected > 0.2 else 4
    share, signal = surfaces(eye, LidarWeather(alpha), ticks)
    assert share / clear == pytest.approx(expected, rel=0.05)
    assert signal / full == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("distance_m", [5.0, 15.0, 30.0])
def test_where_extinction_weakens_the_signal_intensity_follows_beer_lambert(distance_m):
    kind = profile(extinction="signal", **ONE_RAY)
    eye = sensor(world(wall(distance_m), color=(0.9, 0.9, 0.9)), kind)
    ratio = one(look(eye, LidarWeather(0.015))) / one(look(eye))
    assert ratio == pytest.approx(np.exp(-2.0 * 0.015 * distance_m), abs=0.01)


def test_fog_answers_from_nearby_and_only_thick_fog_does():
    kind = profile(theta_min_deg=-30, theta_max_deg=30, phi_min_deg=-30, phi_max_deg=30)
    sky = world(wall(-50.0))
    eye = sensor(sky, kind)
    assert not look(eye)[:, KIND].any()
    points = look(eye, LidarWeather(HEAVY_FOG))
    fog = points[:, KIND] == FOG
    assert fog.mean() > 0.5
    assert 3.0 < np.median(points[fog, RANGE]) < 13.0
    assert np.quantile(points[fog, RANGE], 0.99) < 30.0
    assert points[fog, INTENSITY].max() <= 2.0  # droplets are poor targets
    assert (look(eye, LidarWeather(2.996 / 3000.0))[:, KIND] == FOG).mean() < 0.02


def test_fog_signal_is_the_lidar_equation_where_the_pulse_is_short():
    """Pulse e^(-2 a R) / R^2, as far as the receiver sees it; nothing before it listens."""
    kind = load_lidar_profile("spinning_32")
    r = np.array([10.0, 20.0, 30.0])
    alpha = np.array([0.02])
    found = lidar_scatter.soft_signal(kind, alpha, r)[0]
    middle = r - kind.pulse_m  # centre of mass of the pulse
    expected = kind.pulse_m * np.exp(-2.0 * 0.02 * middle) / middle**2
    expected *= near_field(kind, middle).mean
    assert found == pytest.approx(expected, rel=0.02)
    assert lidar_scatter.soft_signal(kind, alpha, np.array([0.45]))[0, 0] == 0.0


def test_drops_are_a_poisson_process_and_hard_targets_hide_those_behind():
    kind = profile(theta_min_deg=-30, theta_max_deg=30, phi_min_deg=-30, phi_max_deg=30,
                   divergence_mrad=[3.0, 1.5], range_10_percent_m=60.0)  # fmt: skip
    tables = lidar_scatter.scatter(kind)
    eye = sensor(world(wall(-50.0)), kind)
    shares = []
    for rate in (2.0, 25.0):
        share = np.mean([
            (look(eye, LidarWeather(0.0, rain_mm_per_h=rate), tick=t)[:, KIND] == DROP).mean()
            for t in range(4)
        ])  # fmt: skip
        row = np.abs(np.log(lidar_scatter.RATES_MM_PER_H / rate)).argmin()
        expected = 1.0 - np.exp(-tables.drops_expected[row])
        assert share == pytest.approx(expected, abs=4.0 * np.sqrt(expected / 4 / 14641))
        shares.append(share)
    assert shares[1] > 2.0 * shares[0]
    near = look(sensor(world(wall(1.5)), kind), LidarWeather(0.0, rain_mm_per_h=25.0))
    drops = near[:, KIND] == DROP
    assert (near[drops, RANGE] < 1.5 * np.sqrt(3.0)).all()
    assert (near[:, KIND] == SURFACE).mean() > 0.8


def test_without_the_option_weather_is_not_seen():
    eye = sensor(world(wall(60.0)), profile(), Lidar(noise=False, motion=False, weather=False))
    clear = look(eye)
    foggy = look(eye, LidarWeather(0.06, 25.0, 0.0, 1.0, 0.5))
    assert clear.tobytes() == foggy.tobytes()


def edge(near_m: float, far_m: float):
    """A near half wall on the left, a far wall behind it."""
    near = [(near_m, 0, -50), (near_m, 50, -50), (near_m, 50, 50), (near_m, 0, 50)]
    return world(near, wall(far_m))


def test_a_beam_on_an_edge_gives_a_mixed_range_or_one_of_two():
    wide = {"divergence_mrad": [20.0, 20.0], "sub_rays": 5, "pulse_m": 1.0, **ONE_RAY}
    mixed = look(sensor(edge(20.0, 20.3), profile(**wide)))[0, X]
    assert 20.02 < mixed < 20.28
    found = {
        mode: look(sensor(edge(20.0, 30.0), profile(**wide, returns=mode)))[0, X]
        for mode in ("strongest", "first", "last")
    }
    assert found["first"] == pytest.approx(20.0, abs=0.02)
    assert found["last"] == pytest.approx(30.0, abs=0.02)
    assert found["strongest"] == pytest.approx(20.0, abs=0.02)
    single = look(sensor(edge(20.0, 20.3), profile(**ONE_RAY)))[0, X]
    assert min(abs(single - 20.0), abs(single - 20.3)) < 1e-3


def test_noise_and_dropouts_have_the_given_size():
    kind = profile(noise_m=0.02, dropout=0.1, theta_res_deg=0.1, phi_res_deg=0.1)
    points = look(sensor(world(wall(15.0)), kind, Lidar(motion=False)))
    exact = look(sensor(world(wall(15.0)), kind, QUIET))
    assert np.isnan(points[:, RANGE]).mean() == pytest.approx(0.1, abs=0.008)
    error = (points - exact)[:, RANGE]
    assert np.nanstd(error) == pytest.approx(0.02, rel=0.03)
    assert abs(np.nanmean(error)) < 5e-4
    stepped = look(sensor(world(wall(15.0)), profile(step_m=0.01), QUIET))
    assert np.abs(stepped[:, RANGE] / 0.01 - np.round(stepped[:, RANGE] / 0.01)).max() < 1e-3
