"""The recordings of a campaign as a table: what is there, what is missing, where each opens."""

import json

import pytest
from rich.console import Console
from unit.viewer.recorded_case import write

from twin.base.errors import UsageError
from viewer.playback.catalogue import read_catalogue, table
from viewer.playback.folder import find_recording


def campaign(folder):
    """One case that braked, one that did not, one whose recorder was killed, two without."""
    cases = folder / "cases"
    write(cases / "a-braked" / "attempt-1", case="a-braked", weather="clear")
    write(cases / "b-not" / "attempt-1", brakes=False, case="b-not", model="yolov2")
    write(cases / "c-killed" / "attempt-1", ended=False, case="c-killed")
    (cases / "d-bare" / "attempt-1").mkdir(parents=True)
    (cases / "e-nonsense" / "attempt-1").mkdir(parents=True)
    (cases / "e-nonsense" / "attempt-1" / "recording.rrd").write_bytes(b"nonsense")
    return folder


def test_rows_have_what_one_sorts_by_and_open_at_their_moment(tmp_path):
    catalogue = read_catalogue(campaign(tmp_path), "aeb")
    braked, calm, killed = catalogue.rows
    assert (braked.verdict, braked.passed, braked.model) == ("pass", True, "yolov3")
    assert (braked.weather, braked.hour) == ("clear", "05:00")
    assert braked.moment.sim_time_ns == 150_000_000
    assert calm.moment.sim_time_ns == 200_000_000
    assert (killed.verdict, killed.passed, killed.found.complete) == ("", False, False)
    first = json.loads(json.dumps(catalogue.as_json()))["cases"][0]
    assert (first["moment_s"], first["moment_tick"]) == (0.15, None)
    console = Console(width=180, record=True)
    console.print(table(catalogue))
    lines = console.export_text().splitlines()
    assert [line.split()[0] for line in lines] == ["case", "a-braked", "b-not", "c-killed"]
    assert lines[2].split()[1:4] == ["pass", "yes", "yolov2"]


def test_what_is_missing_is_told_in_a_line_each(tmp_path):
    catalogue = read_catalogue(campaign(tmp_path), "aeb")
    assert catalogue.missing == ["d-bare", "e-nonsense"]
    assert catalogue.remarks() == [
        "2 cases without a recording: d-bare, e-nonsense",
        "1 case recorded with gaps: c-killed",
    ]


def test_all_may_open_at_the_same_second(tmp_path):
    catalogue = read_catalogue(campaign(tmp_path), "0.1")
    assert {row.moment.sim_time_ns for row in catalogue.rows} == {100_000_000}


def test_nothing_to_show_is_one_line(tmp_path):
    (tmp_path / "cases" / "a" / "attempt-1").mkdir(parents=True)
    with pytest.raises(UsageError, match="no case was recorded; run the campaign with --view"):
        read_catalogue(tmp_path, "aeb")
    with pytest.raises(UsageError, match="not a campaign folder"):
        read_catalogue(tmp_path / "cases", "aeb")
    campaign(tmp_path)
    with pytest.raises(UsageError, match="expected aeb, closest, or seconds"):
        read_catalogue(tmp_path, "noon")


def test_what_was_not_kept_is_not_missing(tmp_path):
    campaign(tmp_path)
    for case in ("f-fine", "g-fine"):
        write(tmp_path / "cases" / case / "attempt-1", case=case, keep="failed")
    catalogue = read_catalogue(tmp_path, "aeb")
    assert len(catalogue.rows) == 3
    assert catalogue.as_json()["not_kept"] == ["f-fine", "g-fine"]
    assert catalogue.remarks()[:2] == [
        "2 cases without a recording: d-bare, e-nonsense",
        "2 cases passed and not kept: f-fine, g-fine",
    ]
    with pytest.raises(UsageError, match="'f-fine' passed, and its recording was not kept"):
        find_recording(tmp_path, "f-fine")


def test_where_everything_passed_there_is_nothing_to_see(tmp_path):
    write(tmp_path / "cases" / "a" / "attempt-1", case="a", keep="failed")
    with pytest.raises(UsageError, match=r"all recorded cases passed.*recording.keep: failed"):
        read_catalogue(tmp_path, "aeb")


def test_cases_that_had_ended_by_then_open_at_their_end(tmp_path):
    rows = read_catalogue(campaign(tmp_path), "2.0").rows
    assert {(row.moment.sim_time_ns, row.moment.label) for row in rows} == {
        (250_000_000, "end at 0.25 s")
    }
