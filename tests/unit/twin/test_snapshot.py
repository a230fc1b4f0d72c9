"""Contact sheets are PNG files of the expected size."""

import cv2
import pytest

from schemas.campaign import Camera
from twin.snapshot import contact_sheet, usual_lights


def test_sheet(tmp_path):
    path = tmp_path / "sheet.png"
    camera = Camera(width=48, height=27)
    contact_sheet(path, ["clear", "heavy_fog"], ["05:00", "12:00", "19:00"], camera=camera)
    assert cv2.imread(str(path)).shape == (3 * (27 + 22), 2 * 48, 3)


def test_unknown_weather(tmp_path):
    with pytest.raises(ValueError, match="allowed: clear, cloudy"):
        contact_sheet(tmp_path / "a.png", ["hail"], ["12:00"])


def test_usual_lights():
    night = usual_lights("clear", 1.0)
    assert night.high
    assert not night.low
    assert usual_lights("heavy_fog", 1.0).fog
    assert not usual_lights("light_rain", 20_000.0).high
