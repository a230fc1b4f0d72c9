"""A recorded drive becomes a campaign, which is driven, recorded and imported again."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from processes import Marked, nothing_left, outcomes

from schemas.files.yaml_file import dump_yaml, load_yaml
from twin.drives.apart import drive_apart
from twin.drives.drive import DriveQuestion
from twin.drives.thinning import at_times, unwrapped

FROM_S, UNTIL_S = 1.0, 2.5
SMALL = {
    "camera": {"width": 64, "height": 36, "hz": 10},
    "view": "record",
    "recording": {"drive": "all"},
}


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Folders of the recorded drive, and of the one that was made of it."""
    folder = tmp_path_factory.mktemp("drives")
    starter = Marked()

    def run(*words: str):
        done = starter.run(*words)
        assert done.returncode in (0, 1), (words, done.stdout[-800:], done.stderr[-2000:])
        return done

    def driven(campaign, name):
        out = folder / name
        run("conductor", "run", str(campaign), "--workers", "1", "--out", str(out))
        mcap = folder / f"{name}.mcap"
        words = (str(out), min(outcomes(out)), "--mcap", str(mcap))
        run("viewer", "export", *words, "--ros2", "--truth")
        return mcap

    try:
        with nothing_left(starter):
            first = folder / "first.yaml"
            data = {
                "campaign": "first",
                **SMALL,
                "scenario": {"type": "storyboard", "storyboard": "cut-in", "duration_s": 3},
                "autonomy": {"parameters": {"cruise_speed_mps": 30}},
                "matrix": {"weather": ["clear"]},
            }
            first.write_text(dump_yaml(data))
            recorded = driven(first, "recorded")
            made = folder / "made"
            told = run(
                *("conductor", "replay-log", str(recorded), "-o", str(made)),
                *("--from", str(FROM_S), "--to", str(UNTIL_S), "--output", "json"),
            )
            campaign = load_yaml(made / "campaign.yaml") | SMALL
            (made / "small.yaml").write_text(dump_yaml(campaign))
            again = driven(made / "small.yaml", "again")
    finally:
        starter.end()
    return recorded, again, json.loads(told.stdout), outcomes(folder / "again")


def test_objects_go_where_they_were_recorded(drives):
    recorded, again, told, _ = drives
    before, after = (drive_apart(path, DriveQuestion()) for path in (recorded, again))
    assert (told["ego"], told["objects"]) == ("/truth/odometry", "/truth/objects")
    (van,) = before.objects
    (same,) = after.objects
    assert van.kind == same.kind == "van"
    assert same.size_m[:2] == pytest.approx(van.size_m[:2], abs=1e-3)
    expected = at_times(unwrapped(van.poses), same.poses[:, 0] + FROM_S)
    assert len(same.poses) > 20
    off = np.hypot(*(same.poses - expected)[:, 1:3].T)
    assert off.max() < 0.01, off.max()
    assert np.abs(same.poses - expected)[:, 4].max() < 0.005


def test_ego_begins_where_and_as_fast_as_it_was(drives):
    recorded, again, told, _ = drives
    before, after = (drive_apart(path, DriveQuestion()).ego for path in (recorded, again))
    there = at_times(unwrapped(before), np.array([FROM_S, FROM_S + 0.1]))
    assert after[0, 1:3] == pytest.approx(there[0, 1:3], abs=0.01)
    assert after[0, 4] == pytest.approx(there[0, 4], abs=0.002)
    began = np.interp(0.1, after[:, 0], after[:, 1]) - after[0, 1]
    assert began == pytest.approx(there[1, 1] - there[0, 1], rel=0.02)
    assert told["duration_s"] == pytest.approx(UNTIL_S - FROM_S)


def test_made_campaign_has_a_verdict(drives):
    *_, ends = drives
    (end,) = ends.values()
    assert (end["outcome"], end["verdict"]) == ("verdict", "pass")
