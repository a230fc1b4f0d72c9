"""Pictures of the shipped street beside recorded ones, as an eye would compare them.

After a wanted change: ``UPDATE_GOLDEN=1 pytest tests/golden/test_pictures.py``, then look at
``tests/golden/pictures.png`` and ``curve.png``. A failing test writes what it saw to
``build/golden``.
"""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from schemas.campaign import Camera
from schemas.messages import Lights
from schemas.names import WEATHERS
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
from twin.snapshot import contact_sheet

FILE = Path(__file__).with_name("pictures.png")
CURVE = Path(__file__).with_name("curve.png")
SEEN = Path(__file__).parents[2] / "build" / "golden"
HOURS = ("05:00", "13:00", "18:15")
WIDTH, HEIGHT = 160, 90

# Colour differences (CIE 1976, 2.3 is just noticeable) after a blur of one pixel: processors round
# differently, so single pixels at edges and drops of rain may differ.
MEAN_MAX, PERCENTILE_99_MAX = 0.5, 4.0


@pytest.fixture(scope="module")
def pictures():
    """{(hour, weather): picture} of the first frame of each case, 40 m before the obstacle."""
    campaign, mistakes = parse_campaign(
        {
            "campaign": "pictures",
            "seed": 1,
            "camera": {"width": WIDTH, "height": HEIGHT},
            "scenario": {"ego_start_m": 40.0, "ego_speed_mps": 8.0},
            "matrix": {"time_of_day": list(HOURS), "weather": list(WEATHERS)},
        }
    )
    assert campaign is not None, mistakes
    cases = expand(campaign)
    engine = Engine(cases[0], len(cases))
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    for run in engine._runs:
        run.lights = Lights(low=True)
    images = engine.sense()["camera"].values
    names = [(hour, weather) for hour in HOURS for weather in WEATHERS]
    return {name: images[slot].copy() for slot, name in enumerate(names)}


def sheet(pictures):
    rows = [np.hstack([pictures[hour, w] for w in WEATHERS]) for hour in HOURS]
    return np.vstack(rows)


def recorded():
    whole = cv2.cvtColor(cv2.imread(str(FILE)), cv2.COLOR_BGR2RGB)
    return {
        (hour, weather): whole[HEIGHT * r : HEIGHT * (r + 1), WIDTH * c : WIDTH * (c + 1)]
        for r, hour in enumerate(HOURS)
        for c, weather in enumerate(WEATHERS)
    }


def difference(a, b):
    """Colour difference of every pixel."""
    lab = []
    for image in (a, b):
        blurred = cv2.GaussianBlur(image.astype(np.float32) / 255.0, (0, 0), 1.0)
        lab.append(cv2.cvtColor(blurred, cv2.COLOR_RGB2Lab))
    return np.linalg.norm(lab[0] - lab[1], axis=-1)


def test_pictures_are_the_recorded_ones(pictures):
    now = cv2.cvtColor(sheet(pictures), cv2.COLOR_RGB2BGR)
    if os.environ.get("UPDATE_GOLDEN"):
        cv2.imwrite(str(FILE), now)
    bad = []
    for name, expected in recorded().items():
        apart = difference(pictures[name], expected)
        mean, high = float(apart.mean()), float(np.percentile(apart, 99))
        if mean > MEAN_MAX or high > PERCENTILE_99_MAX:
            bad.append(f"{name}: mean {mean:.2f}, 99 % {high:.2f}")
    if bad:
        SEEN.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(SEEN / "pictures.png"), now)
    assert not bad, f"{bad}; see {SEEN / 'pictures.png'}"


@pytest.mark.slow
def test_a_curve_is_the_recorded_one(tmp_path):
    """The loop's tightest curve, by day and in the light of street lamps, dry and in snow."""
    now, seen = tmp_path / "curve.png", CURVE
    contact_sheet(
        now,
        ["clear", "light_snow"],
        ["13:00", "00:00"],
        at_m=898.0,
        camera=Camera(width=WIDTH, height=HEIGHT),
        scene="downtown-loop",
    )
    if os.environ.get("UPDATE_GOLDEN"):
        seen.write_bytes(now.read_bytes())
    a, b = (cv2.cvtColor(cv2.imread(str(p)), cv2.COLOR_BGR2RGB) for p in (now, seen))
    for k, picture in enumerate(np.split(difference(a, b), 2)):
        for side, half in zip(("clear", "snow"), np.split(picture, 2, axis=1), strict=True):
            if half.mean() > MEAN_MAX or np.percentile(half, 99) > PERCENTILE_99_MAX:
                SEEN.mkdir(parents=True, exist_ok=True)
                (SEEN / "curve.png").write_bytes(now.read_bytes())
                pytest.fail(f"{('day', 'night')[k]}, {side}; see {SEEN / 'curve.png'}")


def test_the_tolerance_tells_weathers_and_hours_apart(pictures):
    """The measure must fail for what a person would notice."""
    keys = list(pictures)
    for i, a in enumerate(keys):
        for b in keys[i + 1 :]:
            apart = difference(pictures[a], pictures[b])
            assert apart.mean() > 2 * MEAN_MAX, (a, b)
    moved = np.roll(pictures["13:00", "clear"], 2, axis=1)
    assert np.percentile(difference(moved, pictures["13:00", "clear"]), 99) > PERCENTILE_99_MAX
