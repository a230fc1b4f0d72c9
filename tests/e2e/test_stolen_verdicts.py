"""A stack that connects to its conductor and wants another verdict than its simulator's."""

import json
from pathlib import Path

from foreign_campaigns import campaign
from processes import outcomes

STACK = '''
import json
from pathlib import Path

import thief
from devkit.stack import Stack
from schemas.messages import Command


class Cheating(Stack):
    """Drives into whatever is ahead, and says meanwhile that it passed."""

    def __init__(self, slots, *, folder):
        super().__init__(slots)
        self.folder = Path(folder)

    def reset(self, slot, episode):
        pass

    def step(self, observation):
        return [self.drive(slot, observation) for slot in observation.active_slots()]

    def drive(self, slot, observation):
        token, tick = int(observation.token[slot]), int(observation.tick[slot])
        if tick == 3:
            print("ATTACK", json.dumps(thief.attack(self.folder)), flush=True)
        return Command(slot, token, tick, 0.3, 0.0, 0.0)
'''

SCENARIO = {"ego_start_m": 24, "ego_speed_mps": 7, "duration_s": 6, "standstill_s": 0.5}
WEATHERS = ["clear", "cloudy"]


def test_a_stack_that_commits_its_own_verdict_collides_all_the_same(marked, tmp_path, monkeypatch):
    (tmp_path / "cheating.py").write_text(STACK)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{Path(__file__).parent}")
    folder = tmp_path / "run"
    # Without a sandbox, which would not even let it see the conductor: the binding holds alone.
    autonomy = {"stack": "cheating:Cheating", "parameters": {"folder": str(folder)}}
    autonomy["sandbox"] = "off"
    path = campaign(tmp_path, "cheats", autonomy, matrix={"weather": WEATHERS}, scenario=SCENARIO)
    done = marked.run("conductor", "run", str(path), "--workers", "1", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    assert "0 of 2 passed (2 collision)" in done.stdout
    rows = outcomes(folder)
    for case in WEATHERS:
        assert (rows[case]["verdict"], rows[case]["attempts"]) == ("collision", 1)
        log = (folder / f"cases/{case}/attempt-1/log.txt").read_text()
        (line,) = [line for line in log.splitlines() if line.startswith("ATTACK ")]
        found = json.loads(line.removeprefix("ATTACK "))
        assert {what.rpartition(" ")[2] for what in found} == {case}
        assert len(found) == 15
        taken = {what: how for what, how in found.items() if how == "TAKEN"}
        assert not taken, "verdicts, leases and files are those of the worker that has the lease"
        assert (found[f"commit {case}"], found[f"beat {case}"]) == ("fenced", "fenced")
        assert found[f"commit as the worker {case}"] == "refused"
        assert (found[f"files {case}"], found[f"files as the worker {case}"]) == ("refused",) * 2
        assert b"forged" not in (folder / f"cases/{case}/attempt-1/kpi.parquet").read_bytes()
        assert "forged" not in log.replace(line, "")
