"""What a campaign with a matrix has never tried together."""

from __future__ import annotations

from pathlib import Path

import msgspec
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of

from conductor.report.reading.dossier import open_dossier
from conductor.report.searching.grid_coverage import grid_coverage

FOG = {"weather": "heavy_fog", "time_of_day": "05:00"}


def test_a_whole_matrix_has_tried_every_pair(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    assert grid_coverage(open_dossier(tmp_path)) is None
    assert 'id="tried"' not in page_of(tmp_path)


def test_what_a_matrix_leaves_out_is_listed_and_drawn(tmp_path: Path) -> None:
    make_campaign(tmp_path, campaign_data(exclude=[FOG]))
    found = grid_coverage(open_dossier(tmp_path))
    assert found is not None
    assert found.cases == 6
    assert [(cell.parameters, cell.cells, cell.weight) for cell in found.untried] == [
        (["time_of_day", "weather"], ["05:00", "heavy_fog"], 0.25)
    ]
    page = page_of(tmp_path)
    assert "What was never tried together" in page
    assert "time_of_day 05:00, weather heavy_fog; share of the pairs 0.25" in page
    assert '<div id="covered">' in page


def test_cases_without_a_verdict_have_tried_nothing(tmp_path: Path) -> None:
    def change(case, end):
        if case.variation.weather == "clear" and case.variation.time_of_day_min == 300:
            return msgspec.structs.replace(end, outcome="unresolved", verdict="", kpi_sha256="")
        return end

    make_campaign(tmp_path, change=change)
    found = grid_coverage(open_dossier(tmp_path))
    assert found is not None
    assert [cell.cells for cell in found.untried] == [["05:00", "clear"]]
    assert [pair.tried for pair in found.pairs] == [3, 4, 4]
