"""twin bench storyboard: its targets and what it says."""

from __future__ import annotations

import pytest

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
