"""A campaign of shipped scenarios with real processes: results, judge, recording, refusals."""

import json

import pytest
import yaml
from processes import outcomes

DATA = {
    "campaign": "traffic",
    "scenario": {
        "type": "storyboard",
        "storyboard": "cut-in",
        "scene": "motorway",
        "numbers": {"end.after_s": 9.0},
    },
    "camera": {"width": 64, "height": 36, "hz": 10, "reflections": False},
    "lidars": [{"name": "roof"}],
    "autonomy": {
        "perception": {"truth": {"type": "ground_truth"}},
        "parameters": {"cruise_speed_mps": 30},
    },
    "matrix": {
        "scenario.storyboard": ["cut-in", "cut-out"],
        "weather": ["clear", "heavy_rain"],
    },
}


def write(folder, **changes):
    path = folder / "traffic.yaml"
    path.write_text(yaml.safe_dump({**DATA, **changes}))
    return str(path)


def test_results_are_the_same_with_one_slot_and_with_three(marked, tmp_path):
    path, rows = write(tmp_path), {}
    for slots in ("1", "3"):
        done = marked.run(
            *("conductor", "run", path, "--workers", "1", "--slots", slots),
            *("--out", str(tmp_path / slots), "--view", "record"),
        )
        assert done.returncode in (0, 1), done.stderr
        rows[slots] = outcomes(tmp_path / slots)
    same = marked.run("conductor", "fingerprint", str(tmp_path / "1"), str(tmp_path / "3"))
    assert same.returncode == 0, same.stdout
    assert same.stdout.startswith("the same: ")
    assert len(rows["1"]) == len(rows["3"]) == 4
    verdicts = {row["verdict"] for row in rows["3"].values()}
    assert verdicts <= {"pass", "collision"}, "the storyboard ends before time is up"
    judged = json.loads((tmp_path / "3/judgement.json").read_text())
    assert judged["agree"] == judged["attempts"] == 4
    assert all(row["scalars"]["events_started"] > 0 for row in rows["3"].values())
    report = (tmp_path / "3/report.html").read_text()
    assert "the storyboard came to its end" in report
    for row in rows["3"].values():
        assert (tmp_path / "3" / row["attempt_dir"] / "recording.rrd").is_file()


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        ({"storyboard": "cut-inn"}, "did you mean 'cut-in'"),
        ({"storyboard": "gone.xosc"}, "gone.xosc: no such file"),
        ({"scene": "rural"}, "not on the scene's"),
        ({"numbers": {"actors.van.ahead": 1.0}}, "did you mean 'actors.van.ahead_m'"),
    ],
)
def test_what_cannot_run_is_refused_in_one_line_before_a_lease(marked, tmp_path, scenario, words):
    matrix = {"weather": ["clear"]}
    path = write(tmp_path, scenario={**DATA["scenario"], **scenario}, matrix=matrix)
    out = tmp_path / "out"
    done = marked.run("conductor", "run", path, "--out", str(out))
    assert done.returncode == 2, done.stdout
    lines = [line for line in done.stderr.splitlines() if "scenario.storyboard" in line]
    assert len(lines) == 1, done.stderr
    assert words in lines[0]
    assert not (out / "cases").exists()
