"""A yard of materials from files beside recorded pictures: by day, at dusk and at night, in snow.

After a wanted change: ``UPDATE_GOLDEN=1 pytest tests/golden/test_looks.py``, then look at
``tests/golden/yard.png``. A failing test writes what it saw to ``build/golden``.
"""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import warp as wp
from golden.looks_scene import write_yard
from golden.test_pictures import MEAN_MAX, PERCENTILE_99_MAX, SEEN, difference

from schemas.campaign import Camera
from twin.render.memory import material_bytes
from twin.render.trace.geometry import Geometry
from twin.snapshot import contact_sheet
from twin.world.scene import load_scene
from twin.world.street.build import build_world

FILE = Path(__file__).with_name("yard.png")
HOURS, WEATHERS = ("13:00", "22:30"), ("clear", "light_snow")
WIDTH, HEIGHT, LABEL = 320, 180, 22


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    """The contact sheet, RGB."""
    folder = tmp_path_factory.mktemp("yard")
    path = folder / "sheet.png"
    contact_sheet(
        path,
        WEATHERS,
        HOURS,
        at_m=70.0,
        camera=Camera(width=WIDTH, height=HEIGHT, hfov_deg=80.0),
        scene=str(write_yard(folder)),
    )
    if os.environ.get("UPDATE_GOLDEN"):
        FILE.write_bytes(path.read_bytes())
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def pictures(sheet):
    """{(hour, weather): picture} of a contact sheet."""
    return {
        (hour, weather): sheet[
            (HEIGHT + LABEL) * r + LABEL : (HEIGHT + LABEL) * (r + 1), WIDTH * c : WIDTH * (c + 1)
        ]
        for r, hour in enumerate(HOURS)
        for c, weather in enumerate(WEATHERS)
    }


def test_the_yard_is_the_recorded_one(sheet):
    recorded = pictures(cv2.cvtColor(cv2.imread(str(FILE)), cv2.COLOR_BGR2RGB))
    bad = []
    for name, picture in pictures(sheet).items():
        apart = difference(picture, recorded[name])
        mean, high = float(apart.mean()), float(np.percentile(apart, 99))
        if mean > MEAN_MAX or high > PERCENTILE_99_MAX:
            bad.append(f"{name}: mean {mean:.2f}, 99 % {high:.2f}")
    if bad:
        SEEN.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(SEEN / "yard.png"), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
    assert not bad, f"{bad}; see {SEEN / 'yard.png'}"


def test_the_sign_is_green_by_day_and_glares_at_night(sheet):
    """Inside the arrow, and on the dark board beside it."""
    found = pictures(sheet)
    for hour in HOURS:
        picture = found[hour, "clear"].astype(int)
        arrow, board = picture[40, 205], picture[25, 190]
        assert arrow[1] > board[1] + 60, hour
    day, night = (found[hour, "clear"].astype(int)[40, 205] for hour in HOURS)
    assert day[1] > day[0] + 60
    assert night.min() > 200


def test_the_plan_of_memory_counts_what_materials_take(tmp_path):
    """All arrays of images, holes and details on a device, and a few bytes of tables."""
    world = build_world(load_scene(str(write_yard(tmp_path))))
    scene = Geometry(world, 1, wp.get_device("cpu")).scene
    arrays = [scene.textures.texels, scene.cuts.of_face, scene.cuts.alpha]
    looks = scene.looks
    arrays += [looks.row, looks.look, looks.normal, looks.rise, looks.color, looks.tangent]
    assert all(array.size for array in arrays)
    taken = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    assert material_bytes(world) == taken
    assert material_bytes(build_world(load_scene("crossing"))) == 0
