"""A report reads what is new, and is the same as if it had read everything."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NoReturn

import msgspec
import pytest
from unit.conductor.report.plots.test_report_page_content import page_data
from unit.conductor.report.synthetic_campaign import make_campaign, page_of

from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import CaseOutcome
from conductor.report import make_report
from conductor.report.pages import content
from conductor.report.pages.content import Content, read_content, read_shown
from conductor.report.reading import kpi_files
from conductor.report.reading.cache import FOLDER
from conductor.report.reading.dossier import open_dossier
from twin.base.errors import InfrastructureError
from twin.records.kpi_file import read_kpi, write_kpi

replace = msgspec.structs.replace
CASE = "yolov3-0500-clear"


def read(folder: Path) -> Content:
    """As a report reads it, without the page."""
    return read_content(open_dossier(folder))


def kpi(folder: Path, case: str = CASE) -> Path:
    return folder / "cases" / case / "attempt-1" / "kpi.parquet"


def restore(stamps: dict[Path, os.stat_result]) -> None:
    """Files that were made again, byte for byte, get the times that they had."""
    for path, stat in stamps.items():
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def text_of(folder: Path) -> str:
    """The page without what may differ from report to report."""
    page = (folder / "report.html").read_text()
    return re.sub(r"<dt>(KPI files|Report made)</dt><dd>.*?</dd>", "", page)


def test_nothing_new_means_nothing_read_and_the_same_page(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    assert make_report(tmp_path, plots=False).content.read == 8
    first = text_of(tmp_path)
    second = make_report(tmp_path, plots=False)
    assert (second.content.read, second.content.unchanged) == (0, 8)
    assert text_of(tmp_path) == first
    assert second.content.evidence.fingerprint == fingerprint(tmp_path)
    assert make_report(tmp_path, anew=True, plots=False).content.read == 8
    assert text_of(tmp_path) == first


@pytest.mark.slow
def test_what_a_command_has_just_read_is_not_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_campaign(tmp_path)
    read = read_shown(open_dossier(tmp_path))
    opened: list[str] = []

    def read_case(_folder: Path, name: str, *_rest: object) -> NoReturn:
        opened.append(name)
        raise InfrastructureError(f"{name} was opened")

    with monkeypatch.context() as patch:
        patch.setattr(kpi_files, "read_case", read_case)
        make_report(tmp_path, anew=True, plots=False)
        assert len(opened) == 8
        opened.clear()
        told = make_report(tmp_path, read=read, plots=False)
    assert not opened
    assert told.content.evidence.fingerprint == fingerprint(tmp_path)
    text = text_of(tmp_path)
    make_report(tmp_path, anew=True, plots=False)
    assert text_of(tmp_path) == text


def test_only_cases_that_have_ended_since_are_read(tmp_path: Path) -> None:
    def half(case, end):
        return CaseOutcome(outcome="") if case.variation.weather == "clear" else end

    def most(case, end):
        return CaseOutcome(outcome="") if case.id == CASE else end

    make_campaign(tmp_path, change=half)
    assert read(tmp_path).read == 4
    stamps = {path: path.stat() for path in tmp_path.glob("cases/*/*/kpi.parquet")}
    make_campaign(tmp_path, change=most)
    restore(stamps)
    assert read(tmp_path).read == 3
    make_campaign(tmp_path)
    restore(stamps)
    found = read(tmp_path)
    assert found.read == 8, "a fingerprint takes every file, once"
    assert found.evidence.fingerprint == fingerprint(tmp_path)
    assert read(tmp_path).read == 0


@pytest.mark.parametrize("damage", ["other values", "removed", "corrupt"])
def test_a_file_that_was_changed_since_raises_the_alarm(tmp_path: Path, damage: str) -> None:
    make_campaign(tmp_path)
    assert not read(tmp_path).evidence.alarms
    path = kpi(tmp_path)
    if damage == "other values":
        write_kpi(read_kpi(path).slice(1), path)
    elif damage == "removed":
        path.unlink()
    else:
        path.write_bytes(b"PAR1")
    for _ in range(2):
        content = read(tmp_path)
        assert content.read + content.unchanged == 7
        found = content.evidence
        assert len(found.alarms) == 1
        assert CASE in found.alarms[0]
        assert found.fingerprint is None


def test_another_result_of_a_case_is_read(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    read(tmp_path)
    make_campaign(tmp_path, change=lambda c, e: replace(e, kpi_sha256="a" * 64))
    assert len(read(tmp_path).evidence.alarms) == 8


@pytest.mark.parametrize("content_of_cache", [b"", b"\xc1", b"\x80", b"\x81\xa7version\xa1x"])
def test_a_cache_that_cannot_be_used_is_made_anew(tmp_path: Path, content_of_cache: bytes) -> None:
    make_campaign(tmp_path)
    read(tmp_path)
    (tmp_path / FOLDER / "read.msgpack").write_bytes(content_of_cache)
    assert read(tmp_path).read == 8
    assert read(tmp_path).read == 0


def test_a_case_that_comes_onto_the_page_gets_its_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_campaign(tmp_path)
    monkeypatch.setattr(content, "CASES_MAX", 1)
    assert len(page_data(page_of(tmp_path))["cases"]) == 1
    monkeypatch.setattr(content, "CASES_MAX", 8)
    cases = page_data(page_of(tmp_path))["cases"]
    assert len(cases) == 8
    assert all(case["time_s"] for case in cases)


def test_without_a_place_for_the_cache_reports_are_made_all_the_same(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    (tmp_path / FOLDER).write_text("a file is in the way")
    assert make_report(tmp_path, plots=False).content.read == 8
    assert read(tmp_path).read == 8
