"""The same values however frames reach the stack; the bench of a campaign tells where time goes."""

import json
from pathlib import Path

import pytest

from conductor.run.source import find


@pytest.fixture
def inline(tmp_path: Path) -> Path:
    """chaos-16 with its stack in the simulator's process."""
    text = find("chaos-16").read_text()
    changed = text.replace("autonomy:\n", "autonomy:\n  placement: inline\n")
    assert changed != text
    path = tmp_path / "inline.yaml"
    path.write_text(changed)
    return path


def test_inline_and_the_bench(marked, quiet, inline):
    done = marked.run(
        *("twin", "bench", "campaign", str(inline), "--slots", "3,16", "--output", "json"),
        "--check",
    )
    assert done.returncode == 0, done.stderr
    assert "no GPU" in done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert [row["slots"] for row in rows] == [3, 16]
    for row in rows:
        assert row["fingerprint"] == quiet["fingerprint"]
        assert row["transport"] == "inline"
        assert row["cases"] == 16
        assert sum(row["shares"].values()) == pytest.approx(1.0)
        assert all(share > 0.0 for name, share in row["shares"].items() if name != "transport")
        assert sum(row["laps_s"].values()) == pytest.approx(row["loop_s"], rel=0.1)
        assert 0.0 < row["slot_use"] <= 1.0
        assert row["gpu_percent"] is None
    one, other = (row["sim_s"] for row in rows)
    assert one == pytest.approx(other), "the same cases"


def test_frames_as_payload(marked, quiet, tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_TRANSPORT", "bytes")
    folder = tmp_path / "c"
    done = marked.run(
        *("conductor", "run", "chaos-16", "--out", str(folder), "--output", "json"),
        *("--workers", "1", "--slots", "8"),
    )
    assert json.loads(done.stdout)["fingerprint"] == quiet["fingerprint"], done.stderr
    logs = "".join(path.read_text() for path in folder.glob("logs/*"))
    assert "rig ready, frames by bytes" in logs


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["chaos-16", "--slots", "0,4"], "--slots 0,4: expected numbers from 1 to 4096"),
        (["chaos-16", "--slots", "many"], "--slots many: expected numbers"),
        (["chaos-61"], "no such campaign; did you mean 'chaos-16'?"),
        (["chaos-16", "--device", "cuda:9"], "cuda:9"),
        (["chaos-16", "--out", "{out}", "--slots", "4"], "is there already"),
    ],
)
def test_bad_input_is_one_line(marked, tmp_path, arguments, said):
    (tmp_path / "slots-4").mkdir()
    given = [argument.replace("{out}", str(tmp_path)) for argument in arguments]
    done = marked.run("twin", "bench", "campaign", *given)
    assert done.returncode == 2, done.stdout + done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("no GPU")]
    assert len(lines) == 1
    assert said in lines[0]
    assert not done.stdout
