"""Unmodified scripts in the manner of the AutoDRIVE devkit drive cases to standstill."""

import json

import pyarrow.parquet as parquet
import pytest
from autodrive_environments import SCRIPT, environment_of_2020, missing_today, python_3_8, today
from foreign_campaigns import campaign
from processes import outcomes

from twin.sandbox.possible import why_not

SECTIONS = {
    "scenario": {
        "ego_start_m": 30,
        "ego_speed_mps": 5,
        "duration_s": 12,
        "standstill_s": 0.5,
    },
    "camera": {"width": 64, "height": 36, "hz": 10},
    "cameras": [{"name": "front_left", "width": 64, "height": 36, "hz": 10}],
    "sensors": {"encoders": {}, "imu": {}, "pose": {}},
    "matrix": {"repeat": [0, 1]},
}


def drive(marked, folder, name, python, workers):
    autonomy = {"bridge": "autodrive", "command": [*python, str(SCRIPT)]}
    path = campaign(folder, name, autonomy, **SECTIONS)
    done = marked.run(
        *("conductor", "run", str(path), "--workers", workers, "--output", "json"),
        *("--out", str(folder / f"run-{name}")),
    )
    assert done.returncode == 0, done.stderr
    assert all(c["outcome"] == "verdict" for c in outcomes(folder / f"run-{name}").values())
    (kpi,) = (folder / f"run-{name}").glob("cases/repeat_0/attempt-*/kpi.parquet")
    speeds = parquet.read_table(kpi)["speed_mps"].to_pylist()
    assert max(speeds) > 3.0
    assert abs(speeds[-1]) < 0.01
    return json.loads(done.stdout)["fingerprint"]


@pytest.mark.skipif(bool(missing_today()), reason=missing_today() or "there")
def test_scripts_of_2020_and_of_today_drive_to_standstill(marked, tmp_path):
    """With the same values: the protocol's generation is no part of a verdict."""
    # Two workers and one port: they take turns.
    now = drive(marked, tmp_path, "today", [today()], "2")
    old = python_3_8()
    if old is None:
        pytest.skip("no Python 3.8 on this machine; python-socketio of today passed")
    # Packages of another Python must not be found by this one.
    python = ["env", "-u", "PYTHONPATH", environment_of_2020(old, tmp_path / "environment")]
    assert drive(marked, tmp_path, "of-2020", python, "1") == now


@pytest.mark.skipif(bool(missing_today()), reason=missing_today() or "there")
def test_a_published_script_finds_its_files_and_says_everything_in_the_log(marked, tmp_path):
    """As the page says: by its absolute path. A second worker waits at the port, with one line."""
    script = tmp_path / "devkit" / "opencav_aeb.py"
    script.parent.mkdir()
    (script.parent / "config.json").write_text('{"simulation_instances": [{"weather_id": 3}]}')
    published = "import json, sys\nwith open('config.json') as file: json.load(file)\n"
    published += "open('aeb_metrics.csv', 'w').write('AEB')\nsys.argv.pop(1)\n"
    script.write_text(published + SCRIPT.read_text())
    autonomy = {"bridge": "autodrive", "command": [today(), str(script), "1"]}
    path = campaign(tmp_path, "published", autonomy, **SECTIONS)
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "2", "--out", str(tmp_path / "out"))
    )
    assert done.returncode in (0, 1), done.stderr
    for case in ("repeat_0", "repeat_1"):
        (log,) = (tmp_path / f"out/cases/{case}").glob("attempt-*/log.txt")
        log = log.read_text()
        assert "first picture (64, 36) at" in log
        assert "the script's time and weather are ignored: the case decides" in log
        at_rest = [float(word.strip("[],")) for word in log.split("accelerations")[1].split()[:3]]
        assert abs(at_rest[2]) < 1.0, "gravity is no change of velocity"
    # It may write beside itself, but only in its sandbox, if there is one.
    assert (script.parent / "aeb_metrics.csv").exists() is bool(why_not())
    assert done.stderr.count("waits for port 4567") <= 1
    assert "rig ended" not in done.stderr


@pytest.mark.skipif(bool(missing_today()), reason=missing_today() or "there")
def test_a_script_that_raises_or_answers_nonsense_has_failed_its_case(marked, tmp_path):
    for mode, reason in (
        ("word", "V1 Steering is 'left', a number is needed, at tick 3"),
        ("nan", "command throttle is nan, allowed: 0 to 1, at tick 3"),
        ("exit", "ended: exit code 5"),
    ):
        autonomy = {
            "bridge": "autodrive",
            "command": [today(), str(SCRIPT), mode, "14572"],
            "parameters": {"port": 14572},
        }
        sections = {**SECTIONS, "matrix": {"weather": ["clear"]}}
        path, out = campaign(tmp_path, mode, autonomy, **sections), tmp_path / f"out-{mode}"
        done = marked.run("conductor", "run", str(path), "--out", str(out))
        assert done.returncode == 1, done.stderr
        (case,) = outcomes(out).values()
        assert (case["outcome"], case["attempts"]) == ("failed", 1)
        assert reason in case["reasons"][0]
        assert reason in done.stderr
        assert f"now comes {mode}" in (out / "cases/clear/attempt-1/log.txt").read_text()


@pytest.mark.skipif(bool(missing_today()), reason=missing_today() or "there")
def test_a_script_may_move_the_car_itself(marked, tmp_path):
    """Co-simulation: what the file holds is what was sent, and the verdict follows from it."""
    autonomy = {
        "bridge": "autodrive",
        "cosim": True,
        "command": [today(), str(SCRIPT), "cosim", "14571"],
        "parameters": {"port": 14571},
    }
    path = campaign(tmp_path, "cosim", autonomy, **{**SECTIONS, "matrix": {"weather": ["clear"]}})
    done = marked.run("conductor", "run", str(path), "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    (case,) = outcomes(tmp_path / "out").values()
    assert case["verdict"] == "pass"
    assert case["reasons"][-1] == "co-simulated: the stack commanded the car's poses"
    (kpi,) = (tmp_path / "out").glob("cases/*/attempt-*/kpi.parquet")
    rows = parquet.read_table(kpi).to_pydict()
    start = rows["x_m"][0]
    assert rows["x_m"] == pytest.approx(
        [start + 0.25 * min(tick, 24) for tick in rows["tick"]], abs=1e-9
    )
    assert rows["y_m"] == pytest.approx([rows["y_m"][0]] * len(rows["tick"]), abs=1e-9)
    # A quarter of a metre per twentieth of a second, at rest from the 24th on for half a second.
    assert rows["speed_mps"][1:25] == pytest.approx([5.0] * 24)
    assert rows["speed_mps"][25:] == [0.0] * 11
