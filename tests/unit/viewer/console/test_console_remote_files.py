"""Log and KPI rows of a campaign whose folder is elsewhere, as a real conductor gives them."""

from __future__ import annotations

import os
import tempfile
import threading

import msgspec
import pytest
from committed_cases import COMMITTED, LEASED, LOG, one_committed
from unit.viewer.console.console_runs import kpi
from unit.viewer.console.test_console_watch import Heard
from waiting import PATIENCE_S

from schemas import SCHEMA_VERSION as V
from schemas.kinds.kpi import shipped
from schemas.wire.case_files import CaseFilePiece, CaseFileRequest
from twin.base.errors import UnreachableError
from twin.records import kpi_file
from viewer.console import remote_files
from viewer.console.case_page import LINE_CHARS_MAX
from viewer.console.recorded import LOG_BYTES_MAX
from viewer.console.remote_files import (
    BUSY_TRIES,
    READ_TRIES,
    RemoteAttempt,
    RemoteFiles,
    SilentError,
)
from viewer.recording.naming import KPI_FILE


class Far:
    """A console that hears of a campaign and asks a conductor, or somebody else, for its files."""

    def __init__(self, ask):
        self.asked: list[CaseFileRequest] = []
        self._ask, self.waited_s = ask, 0.0
        self.heard = Heard(files=RemoteFiles(self._told, self._wait))
        self.heard.status(out="/far/demo", running=[LEASED])
        self.heard.committed(
            COMMITTED, verdict="collision", attempt_dir=f"cases/{COMMITTED}/attempt-1"
        )

    def page(self, case=COMMITTED):
        return self.heard.read(f"runs/demo/cases/{case}/case.json")

    def series(self, case=COMMITTED):
        return self.heard.read(f"runs/demo/cases/{case}/series.json")

    def _told(self, request):
        self.asked.append(request)
        return self._ask(request)

    def _wait(self, time_s):
        self.waited_s += time_s


def attempt_of(files):
    """The committed attempt, without a page around it."""
    return RemoteAttempt(None, COMMITTED, "attempt-1", files=files, campaign="demo")


@pytest.fixture
def served(tmp_path, hub):
    with one_committed(tmp_path / "state", hub) as committed:
        yield committed


def test_a_case_has_its_log_and_rows_without_a_folder(served):
    far = Far(served.ask)
    page = far.page()
    shown = "\n".join(page["log"]["lines"])
    assert page["log"]["cut"]
    assert LOG.decode().endswith(shown + "\n")
    assert abs(len(shown) - LOG_BYTES_MAX) < 10
    assert page["moment"]["what"] == "closest"
    assert [event["detail"] for event in page["events"]] == ["AEB triggered"]
    assert page["film"] is None
    assert page["away"]["folder"] == "/far/demo"
    series = far.series()
    assert series["t"] == [0.0, 0.05, 0.1]
    assert series["series"]["dtc_m"]["v"] == [9.0, 5.0, 6.0]
    files = [request.file for request in far.asked]
    assert sorted(files) == ["kpi.parquet", "log.txt"], "each is asked for once"


def test_a_case_that_has_not_ended_is_not_asked_for(served):
    far = Far(served.ask)
    assert far.page(LEASED)["log"] is None
    assert far.series(LEASED)["t"] == []
    assert far.asked == []


def test_a_hostile_log_stays_text_of_some_length(served):
    evil = b"<script>alert(1)</script>\x1b[2J\xff\xfe\r\x00\n" + b"x" * 50_000 + b"\n"
    (served.attempt / "log.txt").write_bytes(evil)
    log = Far(served.ask).page()["log"]
    assert log["lines"][0].startswith("<script>alert(1)</script>\\x1b[2J")
    assert all(line.isprintable() for line in log["lines"])
    assert max(map(len, log["lines"])) <= LINE_CHARS_MAX + 1
    (served.attempt / "log.txt").unlink()
    os.mkfifo(served.attempt / "log.txt")
    assert Far(served.ask).page()["log"] is None


def test_rows_that_were_not_committed_are_none(served):
    """As when somebody writes into the folder after the verdict."""
    kpi(served.attempt, dtc_m=(9.0, 9.0, 9.0))
    far = Far(served.ask)
    assert far.series()["t"] == []
    assert far.page()["log"] is not None
    (served.attempt / "kpi.parquet").write_bytes(b"PAR1" + bytes(100) + b"PAR1")
    assert Far(served.ask).series()["t"] == []


def test_rows_that_are_too_many_or_too_large_are_not_shown(served, monkeypatch):
    monkeypatch.setattr(remote_files, "KPI_ROWS_MAX", 2)
    assert Far(served.ask).series()["t"] == []
    monkeypatch.setattr(remote_files, "KPI_ROWS_MAX", 3)
    assert len(Far(served.ask).series()["t"]) == 3
    with (served.attempt / "kpi.parquet").open("r+b") as file:
        file.truncate(remote_files.KPI_BYTES_MAX + 1)
    far = Far(served.ask)
    assert far.series()["t"] == []
    assert len(far.asked) == 1, "its length says enough"


def test_a_file_that_takes_too_long_to_read_is_tried_again_some_times(served, monkeypatch):
    far, slow = Far(served.ask), Far(served.ask)
    monkeypatch.setattr(remote_files, "READ_S", 0.001)
    assert far.series()["t"] == []
    for _ in range(READ_TRIES):
        assert slow.series()["t"] == []
    monkeypatch.undo()
    assert len(far.series()["t"]) == 3
    assert slow.series()["t"] == [], "it is too much for its reader"
    assert len(slow.asked) == READ_TRIES


def test_no_room_to_read_it_says_nothing_about_a_file(served, tmp_path, monkeypatch):
    far = Far(served.ask)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    for _ in range(READ_TRIES):
        assert far.series()["t"] == []
    monkeypatch.undo()
    assert len(far.series()["t"]) == 3


def test_files_that_are_still_on_their_way_are_shown_when_they_come(served):
    """As after a takeover, when a conductor fetches what its predecessor left in the store."""
    away = served.attempt.with_name("away")
    served.attempt.rename(away)
    far = Far(served.ask)
    assert far.page()["log"] is None
    assert far.series()["t"] == []
    away.rename(served.attempt)
    assert far.page()["log"] is not None
    assert len(far.series()["t"]) == 3


def test_detections_of_a_small_file_are_no_values_of_the_console(tmp_path, hub):
    """There may be a hundred thousand; the digest is that of all columns nevertheless."""
    count = 2_000
    seen = {"label": "car", **dict.fromkeys(kpi_file.DETECTION_FIELDS[1:], 1.0)}
    columns = {kind.name: [0] * count for kind in shipped("column") if not kind.nullable}
    columns |= {"tick": [*range(count)], "detections": [[seen] * 50] * count}
    table = kpi_file.kpi_table(columns)
    with one_committed(tmp_path / "state", hub, sha256=kpi_file.kpi_sha256(table)) as served:
        kpi_file.write_kpi(table, served.attempt / KPI_FILE)
        assert (served.attempt / KPI_FILE).stat().st_size < 100_000
        rows = attempt_of(RemoteFiles(served.ask)).rows
    assert rows is not None
    assert rows["tick"] == columns["tick"]
    assert [*rows] == [name for name in table.column_names if name != "detections"]


def test_a_log_does_not_wait_for_rows(served):
    reading, read = threading.Event(), threading.Event()
    in_time = []

    def ask(request):
        if request.file == "kpi.parquet":
            reading.set()
            in_time.append(read.wait(PATIENCE_S / 4))
        return served.ask(request)

    attempt = attempt_of(RemoteFiles(ask))
    rows = threading.Thread(target=lambda: attempt.rows)
    rows.start()
    assert reading.wait(PATIENCE_S)
    assert attempt.log() is not None
    read.set()
    rows.join(PATIENCE_S)
    assert in_time == [True]


def test_no_foreign_file_is_read_in_the_consoles_own_process(served, monkeypatch):
    """What comes over the fabric goes to the process apart; what that wrote is read."""
    read = []

    def read_kpi(path):
        read.append(path.name)
        return kpi_file.read_kpi(path)

    monkeypatch.setattr(remote_files, "read_kpi", read_kpi)
    assert len(Far(served.ask).series()["t"]) == 3
    assert read == ["read.parquet"]


def test_an_attempt_of_another_number_is_not_this_one(served):
    def older(request):
        return msgspec.structs.replace(served.ask(request), attempt=7)

    page = Far(older).page()
    assert (page["log"], page["events"]) == (None, [])


def test_a_conductor_that_gives_no_files_is_asked_once(served):
    """As one of an earlier release; a page does not wait for it again and again."""
    far = Far(lambda _: None)
    assert far.page()["log"] is None
    assert far.series()["t"] == []
    assert len(far.asked) == 1


def test_what_could_not_be_asked_is_asked_again(served):
    answers = []

    def ask(request):
        answers.append(request)
        if len(answers) == 1:
            raise UnreachableError("the conductor is silent")
        return served.ask(request)

    far = Far(ask)
    assert far.series()["t"] == []
    assert far.series()["t"] == [0.0, 0.05, 0.1]


def test_a_busy_conductor_is_waited_for_some_time(served):
    busy = CaseFilePiece(v=V, error="busy", retry=True)
    left = [busy] * 3
    far = Far(lambda request: left.pop() if left else served.ask(request))
    assert far.series()["t"] == [0.0, 0.05, 0.1]
    assert far.waited_s > 0
    far = Far(lambda _: busy)
    assert far.page()["log"] is None
    assert far.asked
    assert len(far.asked) % BUSY_TRIES == 0


@pytest.mark.parametrize(
    "changes", [{"data": b""}, {"attempt": 2}, {"size": 10}, {"first": 0}], ids=str
)
def test_pieces_that_are_not_of_one_file_are_no_file(changes):
    first = CaseFilePiece(v=V, data=b"abc", size=9, attempt=1)
    second = CaseFilePiece(v=V, data=b"def", first=3, size=9, attempt=1)
    pieces = iter([first, msgspec.structs.replace(second, **changes)])
    files = RemoteFiles(lambda _: next(pieces))
    with pytest.raises(SilentError):
        files.whole("demo", "c", "kpi.parquet", 100)


def test_a_campaign_that_begins_anew_has_new_files(served):
    """Of the same name, with an attempt of the same number."""
    far = Far(served.ask)
    assert len(far.series()["t"]) == 3
    far.heard.status(out="/far/other")
    far.heard.committed(COMMITTED, attempt_dir=f"cases/{COMMITTED}/attempt-1")
    before = len(far.asked)
    assert len(far.series()["t"]) == 3
    assert len(far.asked) > before
