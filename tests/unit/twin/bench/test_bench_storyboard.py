"""twin bench storyboard: its targets and what it says."""

from __future__ import annotations

import pytest

from twin.bench import moving_bodies
from twin.bench.camera import Size
from twin.bench.moving_bodies import MovingBodies
from twin.bench.storyboard import StoryboardFigures, as_json, lines, measure


@pytest.mark.parametrize(
    ("device", "step_ms", "demo_ms", "missed"),
    [
        ("cuda:0", 0.29, None, []),
        ("cuda:0", 0.31, None, ["0.310 of 0.3 ms a step"]),
        ("cpu", 0.31, None, []),
        ("cpu", 0.31, 400.0, []),
        ("cpu", 0.31, 200.0, ["15.5% of 10% of a demo case's time"]),
    ],
)
def test_targets(device, step_ms, demo_ms, missed):
    figures = StoryboardFigures(device, 1, 16, step_ms, demo_ms)
    assert figures.missed == missed
    assert as_json(figures)["target_ms"] == 0.3


def test_lines_name_the_target_of_the_device():
    on_gpu = lines(StoryboardFigures("cuda:0", 256, 16, 0.2, None))
    assert on_gpu[0].endswith("20,480 actors a millisecond (target 0.3 ms)")
    on_cpu = lines(StoryboardFigures("cpu", 1, 16, 0.25, 500.0))
    assert "5.0% of the 500 ms" in on_cpu[1]


@pytest.mark.slow
def test_measure():
    figures = measure("cpu", 1, 2, demo=False, cameras=False)
    assert figures.step_ms > 0.0
    assert figures.share is None


def moving(standing, moving_ones):
    return MovingBodies(Size(1, 320, 180), 16, 60.0, standing, moving_ones)


@pytest.mark.parametrize(
    ("standing", "moving_ones", "missed"),
    [
        (50.0, 45.0, []),
        (50.0, 44.9, ["10.2% of 10% slower pictures with moving bodies"]),
        (50.0, 51.0, []),
    ],
)
def test_moving_bodies_have_a_target(standing, moving_ones, missed):
    cameras = moving(standing, moving_ones)
    figures = StoryboardFigures("cpu", 1, 16, 0.25, None, cameras)
    assert cameras.missed == figures.missed == missed
    assert as_json(figures)["slower"] == pytest.approx(1.0 - moving_ones / standing)


def test_a_slow_step_and_slow_pictures_are_two_misses():
    late = StoryboardFigures("cuda:0", 256, 16, 0.31, None, moving(50.0, 40.0))
    assert len(late.missed) == 2


def test_lines_say_what_moving_bodies_cost():
    said = lines(StoryboardFigures("cpu", 1, 16, 0.25, None, moving(50.0, 48.0)))
    assert "50.0 frames/s of 320x180 with 16 standing bodies in each of 1 views" in said[-1]
    assert "48.0 with moving ones (+4.0% slower, target 10%)" in said[-1]


@pytest.mark.slow
def test_measure_of_moving_bodies_renders_them():
    figures = moving_bodies.measure("cpu", Size(1, 64, 36), 2)
    assert min(figures.empty_frames_per_s, figures.moving_frames_per_s) > 0.0
    assert figures.bodies == moving_bodies.BODIES
