"""Sensors that the stack does not look at are left out; verdicts and KPI bytes stay."""

import json

import pytest
from processes import outcomes

from twin.records.drive_record import RecordReader

CAMPAIGN = {
    "campaign": "reads",
    "scenario": {"ego_start_m": 14, "ego_speed_mps": 10, "duration_s": 2, "standstill_s": 0.2},
    "camera": {"width": 64, "height": 36, "hz": 10, "noise": True},
    "cameras": [{"name": "front_left", "width": 48, "height": 28, "hz": 20}],
    "lidars": [{"name": "roof", "hz": 10}],
    "matrix": {"weather": ["clear", "heavy_rain"]},
}
UNREAD = ["camera.front_left", "lidar.roof"]


@pytest.fixture
def campaign(tmp_path):
    path = tmp_path / "reads.yaml"
    path.write_text(json.dumps(CAMPAIGN))  # JSON is YAML
    return path


def test_the_bench_reads_everything_and_says_both_figures(marked, campaign):
    done = marked.run(
        *("twin", "bench", "campaign", str(campaign), "--slots", "2", "--output", "json"), "--check"
    )
    assert done.returncode == 0, done.stderr
    full, read = json.loads(done.stdout)["rows"]
    assert (full["everything"], read["everything"]) == (True, False)
    assert full["unread"] == read["unread"] == UNREAD
    assert full["fingerprint"] == read["fingerprint"]
    assert full["sim_s"] == pytest.approx(read["sim_s"])
    # One of the first camera at every second tick, two of the other in the same time.
    assert full["frames"] == pytest.approx(3 * read["frames"], abs=2 * full["cases"])
    assert read["frames"] > 0


def test_a_record_has_every_sensor_and_the_kpis_stay(marked, campaign, tmp_path):
    fingerprints = []
    for options in ((), ("--record-drive",)):
        folder = tmp_path / f"run{len(options)}"
        done = marked.run(
            *("conductor", "run", str(campaign), "--out", str(folder), "--output", "json"),
            *("--workers", "1", "--slots", "2", *options),
        )
        assert done.returncode in (0, 1), done.stderr
        fingerprints.append(json.loads(done.stdout)["fingerprint"])
    assert len(set(fingerprints)) == 1
    for row in outcomes(folder).values():
        reader = RecordReader(folder / row["attempt_dir"])
        names = [set(tick.seen.sensors) for tick in reader.ticks()]
        assert {"camera", *UNREAD} <= names[0]
        assert all("camera.front_left" in some for some in names[:-1])
    replayed = marked.run("devkit", "replay", str(folder), "--stack", "devkit.aeb:AebStack")
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
