"""A picture of the wall, of synthetic cases."""

import cv2
import numpy as np
import pytest

from twin.base.errors import UnreachableError
from twin.base.gpu.vulkan import has_vulkan
from viewer.bench import running
from viewer.live.command import LiveOptions
from viewer.live.wall_shot import WallShot, shoot_wall
from viewer.recording.scenery import BLUE

pytestmark = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)


@pytest.mark.slow
def test_all_running_cases_are_on_the_picture(tmp_path):
    out = tmp_path / "wall.png"
    with running.source(9) as endpoint:
        found = shoot_wall(LiveOptions(connect=endpoint), out, (1280, 720), 60.0)
    assert found == WallShot(9, 9)
    picture = cv2.imread(str(out))
    assert picture.shape == (720, 1280, 3)
    frames = (np.abs(picture.astype(int) - BLUE[::-1]) < 12).all(axis=2)
    # Nine tiles in three columns on the left; the frames of neighbours touch.
    tall = frames[:, :860].sum(axis=0) > 200
    assert np.count_nonzero(np.diff(tall.astype(int)) == 1) == 4


def test_ended_cases_are_counted_too():
    assert WallShot(8, 5).told == "8 cases: 5 running, 3 ended"
    assert WallShot(1, 0).told == "1 case: 0 running, 1 ended"


def test_nothing_runs(tmp_path, port):
    options = LiveOptions(connect=f"tcp/127.0.0.1:{port}")
    with pytest.raises(UnreachableError, match="no case has shown itself for 0 s"):
        shoot_wall(options, tmp_path / "wall.png", (640, 360), 0.0)
    assert not (tmp_path / "wall.png").exists()
