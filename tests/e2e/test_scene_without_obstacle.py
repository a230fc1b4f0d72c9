"""A campaign in a scene without an obstacle, from its file to report, recordings and pictures."""

import json

import yaml
from processes import outcomes


def test_a_scene_without_an_obstacle_is_driven_reported_and_replayed(marked, tmp_path):
    (tmp_path / "free.yaml").write_text(yaml.safe_dump({"schema": 1, "scene": "free"}))
    data = {
        "campaign": "free",
        "scenario": {
            "scene": str(tmp_path / "free.yaml"),
            "duration_s": 2,
            "ego_speed_mps": 8,
            "standstill_s": 0.5,
        },
        "camera": {"width": 64, "height": 36, "hz": 10, "reflections": False},
        "matrix": {"weather": ["clear", "heavy_rain"]},
    }
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "1", "--view", "record", "--out", str(out))
    )
    assert done.returncode == 0, done.stderr
    for row in outcomes(out).values():
        assert row["verdict"] == "pass"
        assert row["scalars"]["dtc_min_m"] is row["scalars"]["dtc_end_m"] is None
        assert "nothing stood in its way" in row["reasons"][0]
    tables = marked.run("conductor", "report", str(out), "--output", "json")
    assert tables.returncode == 0, tables.stderr
    json.loads(tables.stdout)
    listed = marked.run("viewer", "replay", str(out), "--output", "json")
    assert listed.returncode == 0, listed.stderr
    assert len(json.loads(listed.stdout)["cases"]) == 2
    frame = tmp_path / "frame.png"
    taken = marked.run("viewer", "frame", str(out), "clear", "--at", "1", "--out", str(frame))
    assert taken.returncode == 0, taken.stderr
    mcap = marked.run("viewer", "export", str(out), "clear", "--mcap", str(tmp_path / "c.mcap"))
    assert mcap.returncode == 0, mcap.stderr
    snapshot = tmp_path / "free.jpg"
    shown = marked.run(
        *("twin", "snapshot", "--scene", str(tmp_path / "free.yaml"), "--out", str(snapshot)),
        *("--weather", "clear", "--time", "13:00"),
    )
    assert shown.returncode == 0, shown.stderr
    assert snapshot.stat().st_size > 5000
