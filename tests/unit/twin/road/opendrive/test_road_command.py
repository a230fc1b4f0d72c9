"""``twin validate road``: what it prints, draws and refuses; its page."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import crossing, xodr

from twin.road.opendrive.reading.vocabulary import as_markdown
from twin.validate.command import app

PAGE = Path(__file__).parents[5] / "docs" / "roads.md"


def test_it_prints_figures_and_draws_the_roads(tmp_path: Path) -> None:
    path = tmp_path / "crossing.xodr"
    path.write_bytes(crossing())
    done = CliRunner().invoke(
        app, ["road", str(path), "--out", str(tmp_path / "out"), "--output", "json"]
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert [road["length_m"] for road in told["roads"]] == [50.0, 50.0, 20.0]
    assert told["gaps"] == []
    picture = cv2.imread(str(tmp_path / "out" / "roads.png"))
    assert picture is not None
    assert picture.std() > 5.0, "there is something to see"


def test_a_broken_file_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "old.xodr"
    path.write_bytes(xodr(version=(1, 2)))
    done = CliRunner().invoke(app, ["road", str(path)])
    assert done.exit_code != 0
    assert "old.xodr:3: " in str(done.exception)


def test_the_table_of_the_page_is_that_of_the_reader() -> None:
    assert PAGE.read_text().endswith(as_markdown())
