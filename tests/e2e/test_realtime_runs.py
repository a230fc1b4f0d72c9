"""``clock: realtime`` with real processes: what a slow stack comes to, and that it is said."""

import csv
import json

from foreign_campaigns import campaign
from processes import outcomes

from twin.records.kpi_file import read_kpi

STACK = '''
import time

from devkit.stack import Stack
from schemas.messages import Command

SLOW_S = 1.0


class Timed(Stack):
    """Brakes from 0.5 s on; in the case repeat_1 it takes a second for every answer."""

    def reset(self, slot, episode):
        self.slow = episode.case == "repeat_1"

    def step(self, observation):
        if self.slow:
            time.sleep(SLOW_S)
        token, tick = int(observation.token[0]), int(observation.tick[0])
        brakes = bool(observation.sim_time_ns[0] >= 500_000_000)
        return [Command(0, token, tick, 0.0, float(brakes), 0.0, brakes)]
'''


def test_a_slow_stack_brakes_later_and_everybody_says_so(marked, tmp_path, monkeypatch):
    """One rig for both cases, though the worker has four slots."""
    (tmp_path / "timed.py").write_text(STACK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    path = campaign(
        *(tmp_path, "paced", {"stack": "timed:Timed"}),
        clock="realtime",
        scenario={"ego_start_m": 100, "ego_speed_mps": 6, "duration_s": 4, "standstill_s": 0.2},
        matrix={"repeat": [0, 1]},
    )
    out = tmp_path / "out"
    done = marked.run("conductor", "run", str(path), "--slots", "4", "--out", str(out))
    assert done.returncode == 1, done.stderr  # it stops far from the obstacle
    assert "realtime: of this run alone, it repeats on no other" in done.stdout
    cases = outcomes(out)
    quick, slow = (cases[f"repeat_{i}"] for i in range(2))
    # The stack sleeps a second of the wall's time; ticks that overran are another's fault.
    assert slow["realtime"]["age_p50_ms"] >= 1000 or slow["realtime"]["overruns"]
    assert slow["realtime"]["age_p50_ms"] > quick["realtime"]["age_p50_ms"]
    assert slow["realtime"]["dropped"] > quick["realtime"]["dropped"]
    assert slow["scalars"]["aeb_time_s"] > quick["scalars"]["aeb_time_s"] > 0.5
    assert slow["scalars"]["dtc_min_m"] < quick["scalars"]["dtc_min_m"]
    for case in (quick, slow):
        assert case["reasons"][-1].startswith("clock realtime, not repeatable: command age")
        assert case["realtime"]["factor"] <= 1.0
        folder = out / case["attempt_dir"]
        rows = list(csv.DictReader((folder / "realtime.csv").read_text().splitlines()))
        # The column of every tick after the first, and the age at which the brakes were asked for.
        kpis = read_kpi(folder / "kpi.parquet").to_pydict()
        assert [int(row["tick"]) for row in rows] == kpis["tick"][1:-1]
        braked = kpis["aeb"].index(True)
        age_ticks = float(rows[braked - 1]["command_age_ms"]) / 50
        assert kpis["sim_time_ns"][round(braked - age_ticks)] >= 500_000_000
    page = (out / "report.html").read_text()
    assert "sim time went with the wall clock and waited for no stack" in page
    told = marked.run("conductor", "fingerprint", str(out), "--output", "json")
    assert json.loads(told.stdout)["realtime"] is True
    again = marked.run("conductor", "compare", str(out), str(out), "--output", "json")
    assert any("clock realtime" in note for note in json.loads(again.stdout)["notes"])
