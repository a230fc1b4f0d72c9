"""The example that learns to keep the lane: what it writes is a stack that a campaign can run."""

import json
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="torch is not installed")

from processes import outcomes

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
pytestmark = [pytest.mark.train, pytest.mark.slow]


def test_the_example_learns_and_drives(marked, tmp_path, monkeypatch):
    """With a few pictures the network is no driver yet, but every step is done."""
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES))
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path / "torch"))
    out = tmp_path / "learned"
    words = ("--quick", "--device", "cpu", "--envs", "2", "--steps", "15", "--rounds", "2")
    done = marked.run("learn_lane", "--out", str(out), *words)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "round 2: the pupil drove 100 %" in done.stdout
    assert "60 pictures" in done.stdout
    model = json.dumps({"model": str(out / "lane.npz")})
    checked = marked.run(
        *("devkit", "check", "learned_lane:LearnedLane", "--ticks", "15", "--parameters", model),
    )
    assert checked.returncode == 0, checked.stdout[-2000:]
    ran = marked.run(
        *("conductor", "run", str(out / "learned-lane.yaml"), "--cases", "1"),
        *("--out", str(tmp_path / "run")),
    )
    assert ran.returncode in (0, 1), ran.stderr[-2000:]
    (case,) = outcomes(tmp_path / "run").values()
    assert case["scalars"]["distance_m"] > 20.0


def test_the_stack_is_the_network_that_was_taught(tmp_path, monkeypatch):
    """NumPy's angles are those of torch."""
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import learn_lane
    import learned_lane
    import numpy as np
    import torch

    torch.manual_seed(3)
    net = learn_lane.LaneNet()
    learn_lane.save(net, tmp_path / "lane.npz")
    stack = learned_lane.LearnedLane(1, model=str(tmp_path / "lane.npz"))
    for height, width in ((36, 64), (90, 160), (180, 320)):
        picture = np.random.default_rng(height).integers(0, 256, (height, width, 3), np.uint8)
        with torch.no_grad():
            taught = float(net(learn_lane.shrunk(torch.from_numpy(picture[None])))[0])
        assert abs(taught) > 1e-4
        assert stack.angle_rad(picture) == pytest.approx(taught, abs=1e-5)
