"""Every verdict and outcome has a colour, a symbol, legible text and a place of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from unit.conductor.report.reading.test_report_leases import one_after_the_other
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.report.pages.tables import KNOWN_STATUSES
from conductor.report.plots.cells import severity
from conductor.report.plots.heat_picture import heat_picture
from conductor.report.plots.leases_figure import leases_figure
from conductor.report.plots.palette import status_color, status_ink, status_symbol
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.leases import read_leases
from schemas.campaign import WEATHERS
from viewer.recording.scenery import VERDICT_COLORS

SHIPPED = ("pass", "false_braking", "collision", "lane_departure", "time_up")
TRIALS = ("avoided", "mitigated", "not_mitigated", "fail", "false_reaction", "inconclusive")
VERDICTS = SHIPPED + TRIALS


def _luminance(color: str) -> float:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_statuses_are_told_apart() -> None:
    assert len({status_color(status) for status in KNOWN_STATUSES}) == len(KNOWN_STATUSES)
    assert len({status_symbol(status) for status in KNOWN_STATUSES}) == len(KNOWN_STATUSES)
    assert set(VERDICTS) == set(VERDICT_COLORS), "the viewer's colours"


@pytest.mark.parametrize("status", [*KNOWN_STATUSES, "a verdict of a plug-in"])
def test_text_on_a_status_can_be_read(status: str) -> None:
    light, dark = sorted(map(_luminance, (status_color(status), status_ink(status))), reverse=True)
    assert (light + 0.05) / (dark + 0.05) >= 3.5


def test_a_cell_shows_the_worst_of_its_cases(tmp_path: Path) -> None:
    order = ["collision", "failed", "unresolved", "time_up", "false_braking", "pass"]

    def change(case: Any, end: Any) -> Any:
        status = order[(*WEATHERS,).index(case.variation.weather)]
        outcome = status if status in ("failed", "unresolved") else "verdict"
        verdict = status if outcome == "verdict" else ""
        return msgspec.structs.replace(
            end, outcome=outcome, verdict=verdict, passed=status in ("pass", "false_braking")
        )

    matrix = {"model": ["yolov3"], "weather": list(WEATHERS)[: len(order)]}
    make_campaign(tmp_path, campaign_data(matrix=matrix), change)
    one_after_the_other(tmp_path)
    dossier = open_dossier(tmp_path)
    assert [row.status for row in sorted(dossier.rows, key=severity)] == order
    figure = leases_figure(dossier, read_leases(tmp_path))
    assert figure is not None
    names = [trace["name"].rpartition(" (")[0] for trace in figure["data"] if "name" in trace]
    wanted = [status.replace("_", " ") for status in KNOWN_STATUSES if status in order]
    assert [name for name in names if name in wanted] == wanted, "a legend in the report's order"


def test_the_legend_of_the_picture_of_maps_holds_every_status(tmp_path: Path) -> None:
    outcomes = ("failed", "unresolved", "cancelled")
    every = [*VERDICTS, *outcomes, ""]

    def change(case: Any, end: Any) -> Any:
        status = every[int(case.variation.repeat)]
        outcome = status if status in ("", *outcomes) else "verdict"
        verdict = status if outcome == "verdict" else ""
        return msgspec.structs.replace(end, outcome=outcome, verdict=verdict)

    data = campaign_data(matrix={"model": ["yolov3"], "repeat": list(range(len(every)))})
    make_campaign(tmp_path, data, change)
    dossier = open_dossier(tmp_path)
    picture = cv2.imdecode(np.frombuffer(heat_picture(dossier), np.uint8), cv2.IMREAD_COLOR)
    for status in KNOWN_STATUSES:
        red, green, blue = bytes.fromhex(status_color(status)[1:])
        mask = (picture == (blue, green, red)).all(axis=-1).astype("uint8")
        _, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        boxes = [part[2:4].tolist() for part in stats[1:] if part[4] > 150]
        assert [15, 15] in boxes, status
    assert (picture[:, -4:] == 255).all(), "nothing is cut at the right"
