"""LiDAR profiles and mounts: shipped ones load, mistakes are one clear line."""

import pytest

from schemas.sections.lidar import POINT_COLUMNS, Lidar, LidarMount, LidarProfile, lidar_columns
from schemas.validation import convert_all
from twin.sensors.lidar.profile_file import load_lidar_profile, mounted_profile

BASE = """\
schema: 1
lidar: mine
theta_res_deg: 0.5
phi_min_deg: -10
phi_max_deg: 10
range_min_m: 0.5
range_max_m: 100
range_10_percent_m: 50
hz: 10
wavelength_nm: 905
noise_m: 0.02
"""


@pytest.mark.parametrize(
    ("name", "channels", "columns"),
    [("spinning_16", 16, 1800), ("spinning_32", 32, 1024), ("spinning_128", 128, 1800)],
)
def test_shipped_profiles_load(name, channels, columns):
    profile = load_lidar_profile(name)
    assert (profile.lidar, profile.channels, profile.columns) == (name, channels, columns)
    assert len(profile.phis_deg) == channels
    assert len(profile.thetas_deg) == columns
    assert profile.phis_deg == sorted(profile.phis_deg)  # from the top


def test_a_full_circle_leaves_out_the_repeated_column_and_an_arc_keeps_its_end():
    data = {"lidar": "a", "theta_res_deg": 0.5, "range_min_m": 1.0, "range_max_m": 9.0,
            "range_10_percent_m": 5.0, "hz": 10, "wavelength_nm": 905, "noise_m": 0.0}  # fmt: skip
    assert LidarProfile(**data).columns == 720
    assert LidarProfile(**data, theta_min_deg=-30, theta_max_deg=30).columns == 121
    assert LidarProfile(**data, theta_min_deg=-180, theta_max_deg=180).thetas_deg[-1] == 179.5
    assert LidarProfile(**data, phi_min_deg=-15, phi_max_deg=15, phi_res_deg=2).channels == 16


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("theta_res_deg: 0", "theta_res_deg: given 0"),
        ("theta_min_deg: 400", "theta_min_deg"),
        ("theta_max_deg: -5", "must be above theta_min_deg"),
        ("phi_max_deg: -20", "phi points down"),
        ("range_max_m: 0.2", "must be above range_min_m"),
        ("elevations_deg: [1, 2]", "elevations_deg must fall"),
        ("theta_res_deg: 0.01", "36000 columns are too many"),
        ("returns: dual", "allowed: first, last, strongest"),
        ("sub_rays: 3", "sub_rays"),
        ("colour: red", "colour: unknown key"),
        ("noise_m: .nan", "finite"),
    ],
)
def test_mistakes_in_a_profile_are_one_line(tmp_path, change, expected):
    path = tmp_path / "mine.yaml"
    key = change.split(":")[0]
    kept = [line for line in BASE.splitlines() if not line.startswith(f"{key}:")]
    path.write_text("\n".join([*kept, change]) + "\n")
    with pytest.raises(ValueError) as error:
        load_lidar_profile(str(path))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)
    assert "mine.yaml" in str(error.value)


def test_unknown_profiles_list_what_is_shipped():
    with pytest.raises(ValueError, match="not shipped; give one of spinning_128, spinning_16"):
        load_lidar_profile("spinning_64")


def test_a_mount_has_a_name_or_a_profile_of_its_own():
    mount, mistakes = convert_all(
        {"position_m": [1.5, 0, 1.9], "profile": "spinning_16"}, LidarMount
    )
    assert not mistakes
    assert mounted_profile(mount).channels == 16
    for data in ({"position_m": [0, 0, 0]}, {"position_m": [0, 0, 0], "rotation_deg": [0, 0]}):
        assert convert_all(data, LidarMount)[1]
    bad = {"position_m": [0, 0, 0], "inline": {"lidar": "x"}}
    assert "inline.theta_res_deg" in convert_all(bad, LidarMount)[1][0].path


def test_truth_adds_columns():
    assert lidar_columns(Lidar()) == POINT_COLUMNS
    assert lidar_columns(Lidar(truth=True))[-2:] == ("instance", "semantic")
