"""twin bench all, measured for real."""

from __future__ import annotations

import json


def test_two_runs_are_compared(marked, tmp_path):
    words = ("bench", "all", "--only", "vehicle,radar", "--output", "json")
    where = ("--history", str(tmp_path / "h.jsonl"), "--page", str(tmp_path / "page.html"))
    for number in range(2):
        done = marked.run("twin", *words, *where, "--label", f"run {number}")
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        assert [each["target"] for each in found["targets"]] == ["vehicle", "radar"]
        assert [each["earlier"] for each in found["targets"]] == [number, number]
        assert all(each["value"] > 1.0 for each in found["targets"])
    assert "run 1" in (tmp_path / "page.html").read_text()
