"""The layout of a played scenario in Rerun's own viewer: its views have nothing to complain of."""

from __future__ import annotations

from pathlib import Path

import pytest
from played_files import played
from waiting import wait_for

from twin.base.gpu.vulkan import has_vulkan
from viewer.playback.window import window
from viewer.playing.recording import write_recording

pytestmark = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)


@pytest.mark.parametrize("paused", [False, True])
def test_views_are_there_and_it_plays_or_waits(tmp_path: Path, paused: bool) -> None:
    path = tmp_path / "s.rrd"
    write_recording(played(), path, speed=2.0, paused=paused)
    with window(["--window-size", "640x360", str(path)], headless=True) as shown:
        state = shown.loaded(1)
        names = {"Around Ego", "Whole scene", "Speeds [m/s]", "Events", "Scenario"}
        wait_for(lambda: {view.name for view in shown.client.get_state().views} == names, "views")
        assert [report for view in shown.client.get_state().views for report in view.reports] == []
        [recording] = state.recordings
        assert {line.name: line.end for line in recording.timelines} == {
            "sim_time": 2_000_000_000,
            "tick": 200,
        }

        def time_ns() -> int:
            return shown.client.get_state().recordings[0].current_time or 0

        if paused:
            for _ in range(3):
                shown.client.take_screenshot()
            assert time_ns() == 0
        else:
            wait_for(lambda: time_ns() > 100_000_000, "time that passes")
        logs = [str(entry) for entry in shown.client.get_logs()]
    assert [entry for entry in logs if "WARN" in entry.upper()] == []
