"""Pictures in the report: strips of lost cases from their recordings, and plots as files."""

from __future__ import annotations

import base64
import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from search_bench import KPI, searched, section, trace
from unit.conductor.report.reading.test_report_leases import one_after_the_other
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign
from unit.viewer.recorded_case import write

from conductor.report import make_report
from conductor.report.pages.content import Content, read_content
from conductor.report.plots import files as plots
from conductor.report.plots import kpis as plot_kpis
from conductor.report.reading import recorded
from conductor.report.reading.dossier import open_dossier
from schemas.campaign import WEATHERS
from schemas.files.search_result import SearchFile
from viewer.playback.strip import WIDTH_PX

replace = msgspec.structs.replace
CASE = "yolov3-1300-heavy_fog"


def lost(case: Any, end: Any) -> Any:
    """One recorded case and one that was not recorded collide; all others pass."""
    hit = case.id in (CASE, "yolov2-tiny-0500-clear")
    scalars = {**end.scalars, "aeb_time_s": 0.15}
    return replace(end, verdict="collision" if hit else "pass", scalars=scalars)


def record(folder: Path) -> Path:
    return Path(write(folder / "cases" / CASE / "attempt-1", campaign="synthetic", case=CASE))


def strips(page: str) -> list[str]:
    return re.findall(r'<img src="data:image/jpeg;base64,([^"]+)"', page)


@pytest.mark.slow
def test_a_recorded_failure_has_a_strip_that_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_campaign(tmp_path, change=lost)
    recording = record(tmp_path)
    asked: list[str] = []
    make = recorded.make_strips

    def counted(dossier: Any, rows: Any) -> Any:
        asked.extend(row.case.id for row, _ in rows)
        return make(dossier, rows)

    monkeypatch.setattr(recorded, "make_strips", counted)
    page = make_report(tmp_path, plots=False).page.read_text()
    (strip,) = strips(page)
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(strip), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[1] % WIDTH_PX == 0, "one picture: the recording is shorter than the steps"
    assert f"viewer replay {tmp_path.name} {CASE}" in page
    assert "the case was not recorded; run it again as below to see it" in page
    assert asked == [CASE]
    assert strips(make_report(tmp_path, plots=False).page.read_text()) == [strip]
    assert asked == [CASE], "the second report has it from the first"
    recording.write_bytes(b"no recording any more")
    page = make_report(tmp_path, plots=False).page.read_text()
    assert not strips(page)
    assert re.search(r"No pictures: .*recording\.rrd: damaged", page)


def test_strips_that_fail_leave_the_others_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_campaign(tmp_path, change=lost)
    record(tmp_path)
    other = tmp_path / "cases" / "yolov2-tiny-0500-clear" / "attempt-1" / "recording.rrd"
    other.write_bytes(b"torn")
    monkeypatch.setattr(recorded, "VIEWER_MAX_S", 1e-3)
    slow = {f.row.case.id: f for f in recorded.failures(open_dossier(tmp_path))}
    assert {f.missing for f in slow.values()} == {"viewer strips took longer than 0.001 s"}
    monkeypatch.undo()
    found = {f.row.case.id: f for f in recorded.failures(open_dossier(tmp_path))}
    assert found[CASE].strip
    assert not found[CASE].missing
    assert "damaged" in found["yolov2-tiny-0500-clear"].missing


@pytest.mark.slow
def test_plots_are_files_of_both_kinds(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="install the package 'matplotlib'")
    # A dollar would begin a formula.
    data = campaign_data(
        matrix={"model": ["yolov3"], "scenario.scene": ["downtown", "/a/$x^.yaml"]}
    )
    make_campaign(tmp_path, data)
    one_after_the_other(tmp_path)
    made = make_report(tmp_path)
    assert made.plots_missing == ""
    names = {"outcomes", "heat", "kpis", "effects", "leases"}
    assert {path.name for path in made.plots} == {f"{n}.{s}" for n in names for s in ("png", "svg")}
    for path in made.plots:
        if path.suffix == ".png":
            picture = cv2.imread(str(path))
            assert min(picture.shape[:2]) > 100
            assert picture.std() > 5, "not a blank sheet"
        else:
            assert "<svg" in path.read_text()
    first = {path: path.read_bytes() for path in made.plots}
    for path in make_report(tmp_path).plots:
        assert path.read_bytes() == first[path], path


def _content(folder: Path, data: dict[str, Any], change: Any = None) -> Content:
    make_campaign(folder, data, change)
    one_after_the_other(folder)
    return read_content(open_dossier(folder))


def _every_kind(case: Any, end: Any) -> Any:
    place = sum(map(ord, case.id)) % 6
    verdict = ("pass", "collision", "false_braking", "time_up", "", "")[place]
    outcome = {4: "unresolved", 5: "failed"}.get(place, "verdict")
    return replace(end, outcome=outcome, verdict=verdict, passed=verdict == "pass")


def _large() -> dict[str, Any]:
    """256 cases of four systems."""
    hours = [f"{hour:02}:00" for hour in range(5, 21, 2)]
    names = ["yolov2-w25", "yolov2-tiny-w25", "yolov3-w25", "a-rather-long-name-of-a-network-w25"]
    return campaign_data(
        autonomy={"perception": {name: {"type": "ground_truth"} for name in names}},
        matrix={"model": names, "weather": list(WEATHERS), "time_of_day": hours},
    )


def _own_stack() -> dict[str, Any]:
    stack = {"stack": "my_rather_long_package.and_its_module:CautiousStack"}
    return campaign_data(autonomy=stack, matrix={"weather": list(WEATHERS)})


@pytest.fixture(scope="module", params=[_large, _own_stack, campaign_data])
def drawn_sheets(request: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Every plot of a campaign by name: the figure, and every text that is drawn with its box."""
    figure = pytest.importorskip("matplotlib.figure", reason="install the package 'matplotlib'")
    agg = pytest.importorskip("matplotlib.backends.backend_agg")
    matplotlib = pytest.importorskip("matplotlib")
    content = _content(tmp_path_factory.mktemp("plots"), request.param(), _every_kind)
    search = section(objective={"kpi": KPI, "fails_below": 0.8}, budget={"cases": 30})
    trial = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    content = dataclasses.replace(content, search=trial)
    sheets = {}
    for name, draw in plots.PLOTS.items():
        with matplotlib.rc_context(plots.STYLE):
            sheet = figure.Figure(layout="constrained")
            assert draw(content, sheet), name
            agg.FigureCanvasAgg(sheet)
            sheets[name] = sheet, _drawn_texts(sheet)
    return sheets


def _drawn_texts(sheet: Any) -> list[tuple[str, Any]]:
    """Every text that is drawn, with its box; ticks outside of the limits are not."""
    text_type = sys.modules["matplotlib.text"].Text
    drawn: list[Any] = []
    real = text_type.draw
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(text_type, "draw", lambda text, to: [drawn.append(text), real(text, to)])
        sheet.canvas.draw()
    shown = [text for text in drawn if text.get_visible() and text.get_text().strip()]
    return [(text.get_text(), text.get_window_extent()) for text in shown]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(plots.PLOTS))
def test_labels_of_plots_are_apart_and_whole(drawn_sheets: dict[str, Any], name: str) -> None:
    sheet, texts = drawn_sheets[name]
    assert len(texts) > 4
    whole = sheet.bbox.padded(1)
    cut = [said for said, box in texts if not _inside(box, whole)]
    assert cut == []
    pairs = [
        (one, two)
        for i, (one, a) in enumerate(texts)
        for two, b in texts[:i]
        if a.padded(-1).overlaps(b.padded(-1))
    ]
    assert pairs == []


def _inside(box: Any, whole: Any) -> bool:
    return bool(
        whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
    )


def test_cells_of_maps_have_borders_and_legible_text(drawn_sheets: dict[str, Any]) -> None:
    for axes in drawn_sheets["heat"][0].axes:
        if axes.axison:
            (mesh,) = axes.collections
            assert mesh.get_linewidth()[0] >= 1
            assert mesh.get_edgecolor()[0].tolist() == [1, 1, 1, 1]
            assert {text.get_color() for text in axes.texts} == {"#FFFFFF", "#16191D"}


def test_nothing_that_cannot_be_negative_is_drawn_below_zero(
    drawn_sheets: dict[str, Any],
) -> None:
    for axes in drawn_sheets["kpis"][0].axes:
        assert axes.get_ylim()[0] == 0
        ticks = [float(label.get_text()) for label in axes.get_yticklabels() if label.get_text()]
        assert all(tick >= 0 for tick in ticks)


def test_many_cases_are_plotted_as_distributions(drawn_sheets: dict[str, Any]) -> None:
    sheet, _ = drawn_sheets["kpis"]
    many = len(sheet.axes) == 4 * 5
    kinds = [[type(part).__name__ for part in axes.collections] for axes in sheet.axes[:5]]
    lines, share = ["LineCollection"], ["FillBetweenPolyCollection"]
    bands = share * 2
    assert kinds == ([share, lines, share, bands, bands] if many else [lines] * 5)


@pytest.mark.slow
def test_plots_that_have_nothing_to_show_are_removed(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="install the package 'matplotlib'")
    make_campaign(tmp_path)
    one_after_the_other(tmp_path)
    assert len(make_report(tmp_path).plots) == 10
    make_campaign(tmp_path, change=lambda c, e: msgspec.convert({"outcome": ""}, type(e)))
    assert {path.stem for path in make_report(tmp_path).plots} == {"outcomes", "heat", "leases"}
    assert not (tmp_path / "plots" / "kpis.png").exists()


def test_without_matplotlib_the_report_says_what_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    make_campaign(tmp_path)
    made = make_report(tmp_path)
    assert made.plots == []
    assert made.plots_missing.startswith("plots are left out: matplotlib is not installed")
    assert not (tmp_path / "plots").exists()
    assert made.page.exists()


MANY = [f"m{n}" for n in range(6)]


def many_models(**matrix: Any) -> dict[str, Any]:
    return campaign_data(
        autonomy={"perception": {name: {"type": "ground_truth"} for name in MANY}},
        matrix={"model": MANY, **matrix},
    )


def test_of_many_models_each_has_a_strip_before_one_has_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = many_models(weather=["clear", "heavy_fog"], time_of_day=["05:00", "09:00", "13:00"])
    make_campaign(tmp_path, data, lambda c, e: replace(e, verdict="collision"))
    monkeypatch.setattr(recorded, "STRIPS_MAX", 12)
    models = [
        failure.row.case.variation.model for failure in recorded.failures(open_dossier(tmp_path))
    ]
    assert models == [name for name in MANY for _ in range(2)]


@pytest.mark.slow
def test_curves_are_shared_between_models_and_wide_maps_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="install the package 'matplotlib'")
    make_campaign(tmp_path, many_models(weather=["clear", "heavy_fog"]))
    monkeypatch.setattr(plot_kpis, "LINES_MAX", 6)
    monkeypatch.setattr(plots, "HEAT_MAX", 1)
    made = make_report(tmp_path)
    assert "has 2 values and a map at most 1" in made.plots_missing
    assert {path.stem for path in made.plots} == {"outcomes", "kpis", "effects"}
    assert (tmp_path / "plots" / "kpis.svg").read_text().count("1 of 2 cases") == len(MANY)
