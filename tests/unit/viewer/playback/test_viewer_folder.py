"""Finding recordings and moments, and what is said when there are none."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner
from unit.viewer.recorded_case import write

from schemas.files.kpi import KPI_COLUMNS
from twin.base.errors import UsageError
from twin.base.gpu.vulkan import has_vulkan
from twin.records.kpi_file import kpi_table, write_kpi
from viewer.cli import app
from viewer.playback import native
from viewer.playback.catalogue import read_catalogue
from viewer.playback.folder import find_moment, find_recording
from viewer.playback.outputs import check_out
from viewer.playback.shot import parse_size


def attempt(folder, case="clear-1", number=1, aeb=(), recorded=True, complete=True):
    """An attempt folder with three KPI rows, closest at the second."""
    path = folder / "cases" / case / f"attempt-{number}"
    path.mkdir(parents=True)
    rows = 3
    empty = {"int32": 0, "int64": 0, "name": None}
    columns = {c.name: [empty.get(c.type, 0.0)] * rows for c in KPI_COLUMNS}
    columns["sim_time_ns"] = [0, 50_000_000, 100_000_000]
    columns["tick"] = [0, 1, 2]
    columns["dtc_m"] = [9.0, 3.0, 4.0]
    columns["aeb"] = [row in aeb for row in range(rows)]
    columns["detections"] = [[]] * rows
    write_kpi(kpi_table(columns), path / "kpi.parquet")
    if recorded:
        (path / "recording.rrd").write_bytes(b"RRF2")
        (path / "recording.json").write_text(json.dumps({"complete": complete}))
    return path


def test_the_committed_attempt_is_preferred(tmp_path):
    for number in (1, 2, 10):
        attempt(tmp_path, number=number)
    assert find_recording(tmp_path, "clear-1").path.parent.name == "attempt-10"
    row = {"attempt_dir": "cases/clear-1/attempt-2"}
    (tmp_path / "outcomes.json").write_text(json.dumps({"cases": {"clear-1": row}}))
    assert find_recording(tmp_path, "clear-1").path.parent.name == "attempt-2"


def test_an_attempt_without_recording_is_passed_over(tmp_path):
    attempt(tmp_path, number=1)
    attempt(tmp_path, number=2, recorded=False)
    found = find_recording(tmp_path, "clear-1")
    assert found.path.parent.name == "attempt-1"
    assert found.remarks() == []
    row = {"attempt_dir": "cases/clear-1/attempt-2"}
    (tmp_path / "outcomes.json").write_text(json.dumps({"cases": {"clear-1": row}}))
    [line] = find_recording(tmp_path, "clear-1").remarks()
    assert line == "clear-1: the committed attempt-2 was not recorded; attempt-1 is shown"


@pytest.mark.parametrize("note", [None, "", "[]", '{"complete": false}'])
def test_whatever_is_not_said_to_be_complete_is_not(tmp_path, note):
    path = attempt(tmp_path) / "recording.json"
    path.unlink() if note is None else path.write_text(note)
    assert not find_recording(tmp_path, "clear-1").complete


def test_moments(tmp_path):
    attempt(tmp_path, "braked", aeb=(1, 2))
    attempt(tmp_path, "not", aeb=())
    found = find_recording(tmp_path, "braked")
    braked = find_moment(found, "aeb")
    assert (braked.sim_time_ns, braked.tick) == (50_000_000, 1)
    assert braked.label == "AEB trigger at 0.05 s (tick 1)"
    given = find_moment(found, "0.1")
    assert (given.sim_time_ns, given.tick, given.label) == (100_000_000, None, "0.1 s")
    moment = find_moment(find_recording(tmp_path, "not"), "aeb")
    assert moment.sim_time_ns == 50_000_000
    assert moment.label == "no AEB trigger; closest approach at 0.05 s (tick 1)"
    assert find_moment(found, "closest").label == "closest approach at 0.05 s (tick 1)"


def test_a_moment_after_the_end_is_refused(tmp_path):
    attempt(tmp_path)
    with pytest.raises(UsageError) as error:
        find_moment(find_recording(tmp_path, "clear-1"), "99")
    assert str(error.value) == (
        "--at 99: case 'clear-1' ends at 0.1 s of sim time; give 0 to 0.1, aeb or closest"
    )


def test_rows_of_an_older_version_are_read(tmp_path):
    path = attempt(tmp_path, aeb=(1,)) / "kpi.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["lateral_error_m"]), path)
    assert find_moment(find_recording(tmp_path, "clear-1"), "aeb").sim_time_ns == 50_000_000


@pytest.mark.parametrize("how", ["damaged", "without a column", "of another type"])
def test_where_rows_cannot_be_read_the_recording_says_it(tmp_path, how):
    folder = tmp_path / "cases" / "clear-1" / "attempt-1"
    write(folder)
    table = pa.table({"sim_time_ns": [0], "aeb": ["yes"], "dtc_m": [1.0], "tick": [0]})
    if how == "without a column":
        table = table.drop_columns(["aeb"])
    pq.write_table(table, folder / "kpi.parquet")
    if how == "damaged":
        (folder / "kpi.parquet").write_bytes(b"PAR1")
    moment = find_moment(find_recording(tmp_path, "clear-1"), "aeb")
    assert (moment.sim_time_ns, moment.tick) == (150_000_000, None)
    assert moment.label == "AEB trigger at 0.15 s"
    [row] = read_catalogue(tmp_path, "closest").rows
    assert row.moment.sim_time_ns == 200_000_000


def test_errors_are_one_line_and_say_what_to_do(tmp_path):
    attempt(tmp_path)
    attempt(tmp_path, "bare", recorded=False)
    found = find_recording(tmp_path, "clear-1")
    found.kpi.unlink()
    for call, words in [
        (lambda: find_recording(tmp_path / "no", "x"), "not a campaign folder"),
        (lambda: find_recording(tmp_path, "clear-2"), "did you mean 'clear-1'?"),
        (lambda: find_recording(tmp_path, "../clear-1"), "no case"),
        (lambda: find_recording(tmp_path, "bare"), "--view record"),
        (lambda: find_moment(found, "noon"), "expected aeb, closest, or seconds"),
        (lambda: find_moment(found, "-1"), "expected aeb, closest, or seconds"),
        (lambda: find_moment(found, "nan"), "expected aeb, closest, or seconds"),
        (lambda: find_moment(found, "aeb"), "not the recording of a case"),
        (lambda: parse_size("12"), "expected WIDTHxHEIGHT"),
        (lambda: parse_size("9000x10"), "expected WIDTHxHEIGHT"),
        (lambda: check_out(tmp_path / "a.jpg", ".png"), "ends in .png"),
    ]:
        with pytest.raises(UsageError) as error:
            call()
        assert words in str(error.value)
        assert len(str(error.value).splitlines()) == 1
    assert parse_size("1280x720") == (1280, 720)


def test_no_vulkan_driver_is_seen(monkeypatch, tmp_path):
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    assert not has_vulkan()


def test_windows_are_opened_where_there_is_no_x_server(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert native.binary().name == "rerun"
    for platform, shown in (("linux", False), ("darwin", True), ("win32", True)):
        monkeypatch.setattr(native.sys, "platform", platform)
        assert native.has_display() is shown


def test_a_recorded_case_is_no_option(tmp_path):
    attempt(tmp_path)
    done = CliRunner().invoke(app, ["web", str(tmp_path), "--case", "clear-1"])
    assert isinstance(done.exception, UsageError)
    assert "--case is for running cases" in str(done.exception)


def test_commands_for_a_laptop(tmp_path):
    ssh, rerun = native.tunnel_commands(4321)
    assert ssh.startswith("ssh -N -L 9876:127.0.0.1:4321 ")
    assert rerun == "rerun --connect rerun+http://127.0.0.1:9876/proxy"
    scp, _ = native.fetch_commands(tmp_path / "recording.rrd")
    assert f":{tmp_path}/recording.rrd ." in scp
