"""Films in the report: made of recordings, linked from the page, and made once."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner
from unit.conductor.report.rulebook.test_rulebook_report import campaign, ended, speed_of
from unit.conductor.report.synthetic_campaign import make_campaign
from unit.viewer.recorded_case import write

from conductor.cli import app
from conductor.report import make_report, write_result_page
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.films import film_addresses
from conductor.report.rulebook.results import rulebook_result
from conductor.report.rulebook.shown import rulebook_shown
from twin.base.errors import EXIT_FAILED

SLOW, FAST = (f"standing-ego.speed_kmh_60-r{repeat}" for repeat in (0, 1))
"""Two failed runs of one cell."""
PLATE = "plate"
LINK = re.compile(r'<a class="film" href="([^"]+)"')


def lost(case: Any, end: Any) -> Any:
    """Both runs at 60 km/h fail, the second with the faster impact; so does the plate."""
    impact_kmh = {SLOW: 20.0, FAST: 30.0}.get(case.id)
    failed = impact_kmh is not None or case.id.startswith(PLATE)
    return ended("fail" if failed else "pass", speed_of(case), impact_kmh, end)


def made_run(folder: Path, *recorded: str) -> None:
    make_campaign(folder, campaign(), lost)
    for case in recorded:
        write(folder / "cases" / case / "attempt-1", campaign="yard", case=case)


def test_a_cell_leads_to_its_worst_run(tmp_path: Path) -> None:
    made_run(tmp_path)
    dossier = open_dossier(tmp_path)
    shown = rulebook_shown(dossier, rulebook_result(dossier))
    assert shown is not None
    assert shown.worst_lost == [FAST, next(r.case.id for r in dossier.rows if PLATE in r.case.id)]


@pytest.mark.slow
def test_films_are_made_of_what_was_recorded_and_linked(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="install the package 'av'")
    made_run(tmp_path, SLOW, FAST)
    page = make_report(tmp_path, plots=False).page.read_text()
    assert not LINK.findall(page)
    assert f"conductor report {tmp_path.name} --films failures" in page
    done = CliRunner().invoke(app, ["report", str(tmp_path), "--films", "failures"])
    assert done.exit_code == EXIT_FAILED
    assert f"{tmp_path}/films" in done.output
    assert "no film of 1 case that did not pass: not recorded" in done.output
    page = (tmp_path / "report.html").read_text()
    cell = re.search(r'data-pick="([^"]+)"[^\n]*▶</a></td>', page)
    assert cell is not None
    assert cell[1] == FAST
    assert set(LINK.findall(page)) >= {f"films/{FAST}.mp4"}
    film = tmp_path / "films" / f"{FAST}.mp4"
    assert film.read_bytes()[4:8] == b"ftyp"
    before = film.stat().st_mtime_ns
    make_report(tmp_path, plots=False, films=True)
    assert film.stat().st_mtime_ns == before, "it was there already"


@pytest.mark.slow
def test_a_result_page_has_the_end_of_a_film(tmp_path: Path) -> None:
    made_run(tmp_path / "run", FAST)
    page, beside = tmp_path / "a.md", tmp_path / "a"
    write_result_page(tmp_path / "run", page, films=True)
    assert f"the end of its film](a/film-{FAST}.webp)" in page.read_text()
    assert (beside / f"film-{FAST}.webp").read_bytes()[8:12] == b"WEBP"
    write_result_page(tmp_path / "run", page)
    assert "film" not in page.read_text()
    assert not list(beside.glob("film-*")), "an earlier page's"


def test_a_film_that_is_older_than_its_recording_is_not_linked(tmp_path: Path) -> None:
    made_run(tmp_path, FAST)
    film = tmp_path / "films" / f"{FAST}.mp4"
    film.parent.mkdir()
    film.write_bytes(b"film")
    (film.parent / "of nothing.mp4").write_bytes(b"film")
    dossier = open_dossier(tmp_path)
    assert film_addresses(dossier) == {FAST: f"films/{FAST}.mp4"}
    recording = tmp_path / "cases" / FAST / "attempt-1" / "recording.rrd"
    now_ns = film.stat().st_mtime_ns
    os.utime(recording, ns=(now_ns + 1, now_ns + 1))
    assert film_addresses(dossier) == {}


def test_a_recording_that_is_damaged_is_told_and_the_page_is_made(tmp_path: Path) -> None:
    made_run(tmp_path)
    (tmp_path / "cases" / FAST / "attempt-1" / "recording.rrd").write_bytes(b"torn")
    made = make_report(tmp_path, plots=False, films=True)
    assert made.films == []
    assert any(re.match(rf"no film of {FAST}: .*damaged", line) for line in made.films_missing)
    assert not LINK.findall(made.page.read_text())
