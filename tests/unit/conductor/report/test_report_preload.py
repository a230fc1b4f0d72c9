"""A report whose files were read while the campaign ran is the report."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from unit.conductor.report.pages.test_report_cache import CASE, kpi, restore, text_of
from unit.conductor.report.synthetic_campaign import make_campaign
from waiting import wait_for

from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import CaseOutcome
from conductor.report import make_report
from conductor.report.reading import kpi_files as reading
from conductor.run import report_preload as report_ahead
from conductor.run.report_preload import ReportPreload
from twin.base.errors import InfrastructureError, UsageError
from twin.records.kpi_file import read_kpi, write_kpi


def half(case, end):
    """As long as the campaign runs."""
    return CaseOutcome(outcome="") if case.variation.weather == "clear" else end


@pytest.fixture
def files(monkeypatch) -> list[str]:
    """Names of the cases whose files are read, as they are."""
    names: list[str] = []
    read = reading.read_case

    def noted(folder, name, end, points):
        names.append(name)
        return read(folder, name, end, points)

    monkeypatch.setattr(reading, "read_case", noted)
    return names


def test_every_file_is_read_once_and_the_report_is_the_same(tmp_path: Path, files) -> None:
    other = tmp_path / "other" / "run"  # of the same name, which commands of the page have in them
    make_campaign(other)
    make_report(other, plots=False)
    files.clear()
    run = tmp_path / "run"
    ahead = ReportPreload(run)
    make_campaign(run, change=half)
    ahead.look()
    ahead.look()
    assert len(files) == len(set(files)) == 4
    stamps = {path: path.stat() for path in run.glob("cases/*/*/kpi.parquet")}
    make_campaign(run)
    restore(stamps)
    ahead.finish()
    assert len(files) == len(set(files)) == 8
    content = make_report(run).content
    assert (content.read, content.unchanged, len(files)) == (0, 8, 8)
    assert content.evidence.fingerprint == fingerprint(run)
    assert text_of(run) == text_of(other)


def test_a_file_that_changes_afterwards_is_looked_at_again(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    ahead = ReportPreload(tmp_path)
    ahead.look()
    path = kpi(tmp_path)
    table = read_kpi(path)
    write_kpi(table.slice(1), path)
    ahead.finish()
    content = make_report(tmp_path, plots=False).content
    assert content.damaged == 1
    assert any(CASE in alarm for alarm in content.evidence.alarms)


def test_what_is_held_is_limited(tmp_path: Path, files, monkeypatch) -> None:
    monkeypatch.setattr(report_ahead, "ROWS_BYTES_MAX", 1)
    make_campaign(tmp_path)
    ahead = ReportPreload(tmp_path)
    ahead.look()
    ahead.look()
    assert len(files) == 1
    ahead.finish()
    assert len(files) == len(set(files)) == 8


def test_a_thread_reads_while_the_campaign_runs(tmp_path: Path, files, monkeypatch) -> None:
    monkeypatch.setattr(report_ahead, "LOOK_PERIOD_S", 0.01)
    before = {*threading.enumerate()}
    ahead = ReportPreload(tmp_path)
    ahead.begin()
    ahead.begin()
    assert len({*threading.enumerate()} - before) == 1
    make_campaign(tmp_path)
    wait_for(lambda: len(files) == 8, "all files are read")
    ahead.finish()
    assert {*threading.enumerate()} <= before
    assert len(files) == 8


@pytest.mark.parametrize("outcomes", [None, "", "{}", '{"campaign": 3}'])
def test_a_folder_that_cannot_be_read_is_left_to_the_report(tmp_path: Path, outcomes) -> None:
    if outcomes is not None:
        (tmp_path / "outcomes.json").write_text(outcomes)
    ahead = ReportPreload(tmp_path)
    ahead.look()
    ahead.finish()
    with pytest.raises(UsageError if outcomes is None else InfrastructureError) as error:
        make_report(tmp_path, plots=False)
    assert str(tmp_path) in str(error.value)


def test_a_damaged_file_is_left_to_the_report(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    kpi(tmp_path).write_bytes(b"no parquet")
    ahead = ReportPreload(tmp_path)
    ahead.look()
    ahead.finish()
    content = make_report(tmp_path, plots=False).content
    assert (content.damaged, content.read + content.unchanged) == (1, 7)
