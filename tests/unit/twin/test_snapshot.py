"""Contact sheets are PNG files of the expected size."""

import cv2
import numpy as np
import pytest

from schemas.campaign import Camera
from twin.play.critical_moment import LEAD_S, critical_moment_s
from twin.snapshot import SheetRequest, contact_sheet, scenario_film, usual_lights, write_sheet
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene


def test_sheet(tmp_path):
    path = tmp_path / "sheet.png"
    camera = Camera(width=48, height=27)
    contact_sheet(path, ["clear", "heavy_fog"], ["05:00", "12:00", "19:00"], camera=camera)
    assert cv2.imread(str(path)).shape == (3 * (27 + 22), 2 * 48, 3)


def test_the_ending_chooses_the_format(tmp_path):
    camera = Camera(width=48, height=27)
    contact_sheet(tmp_path / "a.jpg", ["clear"], ["12:00"], camera=camera)
    assert (tmp_path / "a.jpg").read_bytes()[:3] == b"\xff\xd8\xff"
    with pytest.raises(ValueError, match=r"ends in .png or .jpg"):
        contact_sheet(tmp_path / "a.bmp", ["clear"], ["12:00"], camera=camera)


def test_unknown_weather(tmp_path):
    with pytest.raises(ValueError, match="allowed: clear, cloudy"):
        contact_sheet(tmp_path / "a.png", ["hail"], ["12:00"])


def test_a_picture_of_a_film_is_the_same_without_those_before():
    camera = Camera(width=48, height=27)
    first, second = scenario_film("crossing-cyclist", (0.0, 5.0), camera=camera)
    (alone,) = scenario_film("crossing-cyclist", (5.0,), camera=camera)
    assert second.shape == (27, 48, 3)
    np.testing.assert_array_equal(second, alone)
    assert (first != second).any()


@pytest.mark.slow
def test_all_scenarios_are_shown_shortly_before_somebody_is_touched(tmp_path, monkeypatch):
    """Two of them, the other seven would take a minute."""
    names = ("child-behind-bus", "free-traffic")
    monkeypatch.setattr("twin.snapshot.shipped_scenarios", lambda **_: names)
    path = tmp_path / "all.png"
    write_sheet(path, SheetRequest(scenario="all", width_px=160))
    sheet = cv2.imread(str(path))
    assert sheet.shape == (90 + 22, 3 * 160, 3)
    assert not sheet[:, 320:].any(), "two pictures, and an empty place"
    # `twin play` has the child touched a second before it ends, at 8.71 s.
    assert critical_moment_s("child-behind-bus") == pytest.approx(8.71 - 1.0 - LEAD_S, abs=0.2)
    with pytest.raises(ValueError, match="snapshot: at-s: --scenario all shows"):
        write_sheet(path, SheetRequest(scenario="all", at_s=3.0))


def test_usual_lights():
    night = usual_lights("clear", 1.0)
    assert night.high
    assert not night.low
    assert usual_lights("heavy_fog", 1.0).fog
    assert not usual_lights("light_rain", 20_000.0).high


def test_requests_choose_weathers_family_and_day(tmp_path):
    path = tmp_path / "sheet.png"
    request = SheetRequest(
        weathers=("clear", "sleet"),
        times=("12:00",),
        custom=("sleet:rain=0.4,snow=0.3",),
        environment={"family": "autodrive", "date": "2025-06-21", "exposure_ev100": 13.0},
        width_px=48,
    )
    write_sheet(path, request)
    assert cv2.imread(str(path)).shape == (27 + 22, 2 * 48, 3)
    darker = SheetRequest(**{f: getattr(request, f) for f in ("weathers", "times", "custom")})
    write_sheet(tmp_path / "other.png", darker)
    assert path.read_bytes() != (tmp_path / "other.png").read_bytes()


def test_the_place_is_chosen_along_the_lane(tmp_path):
    """180 m along the lane of the street is the same place as so far before its obstacle."""
    camera, when = Camera(width=48, height=27), (["clear"], ["12:00"])
    scene, car = load_scene("downtown"), load_vehicle("opencav")
    before = scene.obstacle.x_m - (180.0 + scene.road.start_m) - car.front_offset_m
    for name, place in (("a", {"at_m": 180.0}), ("b", {"distance_m": before}), ("c", {})):
        contact_sheet(tmp_path / f"{name}.png", *when, camera=camera, **place)
    a, b, c = (cv2.imread(str(tmp_path / f"{name}.png")) for name in "abc")
    assert (a == b).all()
    assert (a != c).any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"at_m": -1.0}, "at-m -1: not on the lane, which is 410.0 m long; give a number from 0"),
        ({"at_m": float("nan")}, "at-m nan: not on the lane"),
        ({"custom": ("sleet:rain=2",)}, "custom.sleet.rain: given 2.0"),
        ({"custom": ("sleet:rain",)}, "allowed: KEY=NUMBER"),
        ({"custom": ("sleet:hail=0.1",)}, "unknown key"),
        ({"custom": ("clear:rain=0.1",)}, "choose another"),
        ({"times": ("25:00",)}, "given '25:00'"),
        ({"width_px": 3}, "width: given 3"),
        ({"environment": {"date": "2025-13-01"}}, "YYYY-MM-DD"),
        ({"weathers": ("hevy_fog",)}, "did you mean 'heavy_fog'"),
    ],
)
def test_mistakes_are_one_line(tmp_path, changes, words):
    with pytest.raises(ValueError) as error:
        write_sheet(tmp_path / "a.png", SheetRequest(**changes))
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a.png").exists()


def test_roads_of_a_file(tmp_path):
    """On a banked slope: the ego stands on the lane, and looks along it."""
    pytest.importorskip("lxml", reason="lxml is not installed")
    from road_files import road, xodr

    profiles = (
        '<elevationProfile><elevation s="0" a="40" b="0.1" c="0" d="0"/></elevationProfile>'
        '<lateralProfile><superelevation s="0" a="0.05" b="0" c="0" d="0"/></lateralProfile>'
    )
    file, path = tmp_path / "slope.xodr", tmp_path / "road.png"
    file.write_bytes(xodr(road(300.0, more=profiles)))
    request = SheetRequest(weathers=("clear",), times=("12:00",), road=str(file), width_px=64)
    write_sheet(path, request)
    picture = cv2.imread(str(path))[22:]
    sky, asphalt = picture[2, 32].astype(int), picture[-2, 32].astype(int)
    assert sky[0] > sky[2] + 10  # blue above
    assert abs(asphalt[0] - asphalt[2]) < 25  # grey below


def test_a_place_that_is_not_on_the_road(tmp_path):
    pytest.importorskip("lxml", reason="lxml is not installed")
    from road_files import xodr

    file = tmp_path / "flat.xodr"
    file.write_bytes(xodr())
    request = SheetRequest(road=str(file), at_m=101.0, width_px=64)
    with pytest.raises(ValueError, match=r"at-m 101: not on road 0, which is 100\.0 m long"):
        write_sheet(tmp_path / "a.png", request)
    file.write_bytes(xodr()[:-20])
    with pytest.raises(ValueError, match=r"flat\.xodr:\d+: "):
        write_sheet(tmp_path / "a.png", request)


def test_what_a_radar_sees_is_drawn_into_the_picture(tmp_path):
    def sheet(name, *sensors):
        request = SheetRequest(
            weathers=("clear",), times=("12:00",), width_px=160, sensors=sensors, distance_m=15.0
        )
        write_sheet(tmp_path / name, request)
        return cv2.imread(str(tmp_path / name)).astype(int)

    plain, drawn = sheet("plain.png"), sheet("drawn.png", "radar:profile=mid_range,noise=false")
    changed = (plain != drawn).any(axis=2)
    assert 10 < changed.sum() < 0.2 * changed.size
    # Everything stands, and so does the ego: the dots are grey.
    assert ((np.abs(drawn - (138, 126, 120)).max(axis=2) < 3) & changed).any()


@pytest.mark.parametrize(
    ("sensor", "told"),
    [
        ("lidar", r"sensor 'lidar': allowed: radar"),
        ("radar:profile", r"given 'profile', allowed: KEY=VALUE"),
        ("radar:profile=x", r"sensors.radar.profile: given 'x'"),
    ],
)
def test_a_sensor_that_cannot_be_drawn_is_refused(tmp_path, sensor, told):
    with pytest.raises(ValueError, match=told):
        write_sheet(tmp_path / "a.png", SheetRequest(sensors=(sensor,)))
