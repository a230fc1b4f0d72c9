"""A stack that cheats reaches nothing and changes no verdict, its own or a neighbour's."""

import json
import os
from pathlib import Path

import pytest
from bait import WORD, baited
from foreign_campaigns import campaign
from processes import outcomes, wait_for

from twin.sandbox.possible import why_not

REDTEAM = Path(__file__).parents[1] / "redteam"

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not())


def run(marked, tmp_path, name, autonomy):
    """The campaign's folder, its fingerprint, and what was said."""
    path = campaign(tmp_path, name, autonomy, matrix={"weather": ["clear", "heavy_fog"]})
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "1", "--output", "json"),
        *("--out", str(tmp_path / f"run-{name}")),
    )
    assert done.returncode in (0, 1), done.stderr
    return tmp_path / f"run-{name}", json.loads(done.stdout)["fingerprint"], done.stderr


@pytest.mark.parametrize("mode", ["default", "strict"])
def test_a_cheating_stack_reaches_nothing(marked, tmp_path, monkeypatch, mode):
    monkeypatch.setenv("PYTHONPATH", f"{REDTEAM}:{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", WORD)
    secret = tmp_path / "keys/authority.key"
    secret.parent.mkdir()
    secret.write_text("secret")
    targets = {"folder": str(tmp_path / "run-cheat"), "pid": os.getpid(), "secret": str(secret)}
    with baited("cheated", {"sandbox": mode}, **targets) as autonomy:
        cheated, found, _ = run(marked, tmp_path, "cheat", autonomy)
    honest, expected, _ = run(marked, tmp_path, "honest", {})
    assert found == expected
    text = "".join(path.read_text() for path in cheated.glob("cases/*/attempt-*/log.txt"))
    said = [line for line in text.splitlines() if line.startswith("CHEAT ")]
    assert len(said) >= 22, text
    assert [line for line in said if "REACHED" in line] == []
    assert "CHEAT fill the disk: No space left on device" in said
    assert json.loads((cheated / "outcomes.json").read_text())["protection"] == [mode]
    assert not marked.processes("import time; time.sleep(615)")
    assert not (cheated / "cheat.txt").exists()
    assert {name: case["verdict"] for name, case in outcomes(cheated).items()} == {
        name: case["verdict"] for name, case in outcomes(honest).items()
    }


def test_a_stack_without_a_sandbox_is_told_on_the_first_screen_and_in_the_record(marked, tmp_path):
    folder, _, said = run(marked, tmp_path, "open", {"sandbox": "off"})
    line = "unprotected: autonomy.sandbox is off"
    assert f"{line}; the stack may do whatever you may" in said
    assert json.loads((folder / "outcomes.json").read_text())["protection"] == [line]
    wait_for(lambda: not marked.processes("devkit"), "the end of its processes")
