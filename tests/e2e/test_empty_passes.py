"""A stack that does nothing of use does not pass, and every command says so the same way."""

import json
import os

import pytest

STACK = """
from devkit.stack import Stack
from schemas.messages import VEHICLE_COLUMNS, Command

SPEED = VEHICLE_COLUMNS.index("speed_mps")

class Crawl(Stack):
    def __init__(self, slots, *, speed_mps=0.5):
        super().__init__(slots)
        self._speed_mps = speed_mps

    def reset(self, slot, episode):
        pass

    def step(self, observation):
        return [
            Command(
                slot=slot,
                token=int(observation.token[slot]),
                tick=int(observation.tick[slot]),
                throttle=0.3 if self._slow(observation, slot) else 0.0,
                brake=1.0 if self._speed_mps == 0.0 else 0.0,
                steering_rad=0.0,
            )
            for slot in observation.active_slots()
        ]

    def _slow(self, observation, slot):
        return float(observation.sensors["vehicle"][slot][SPEED]) < self._speed_mps
"""


@pytest.mark.parametrize(("speed_mps", "verdict"), [(0.5, "time_up"), (0.0, "false_braking")])
def test_crawling_and_standing_still_are_no_pass(marked, tmp_path, monkeypatch, speed_mps, verdict):
    (tmp_path / "crawler.py").write_text(STACK)
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", "") + os.pathsep + str(tmp_path))
    campaign = {
        "campaign": "crawl",
        "camera": {"width": 64, "height": 36, "hz": 10},
        "scenario": {"ego_start_m": 40, "duration_s": 4},
        "autonomy": {"stack": "crawler:Crawl", "parameters": {"speed_mps": speed_mps}},
        "matrix": {"weather": ["clear"]},
    }
    (tmp_path / "crawl.yaml").write_text(json.dumps(campaign))
    out = tmp_path / "out"
    arguments = ("conductor", "run", str(tmp_path / "crawl.yaml"), "--out", str(out))
    done = marked.run(*arguments, "--workers", "1")
    assert done.returncode == 1, done.stderr
    assert f"0 of 1 passed (1 {verdict})" in done.stdout
    end = next(iter(json.loads((out / "outcomes.json").read_text())["cases"].values()))
    assert (end["verdict"], end["passed"]) == (verdict, False)
    done = marked.run("conductor", "report", str(out))
    assert done.returncode == 1, done.stderr
    assert "<strong>0</strong> of 1 cases passed" in (out / "report.html").read_text()
    # The same command again finds nothing to do, and says the same.
    again = marked.run(*arguments, "--workers", "1")
    assert again.returncode == 1, again.stderr
