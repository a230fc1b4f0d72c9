"""The report in a real browser, opened from the file system without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.report.synthetic_campaign import make_campaign
from unit.report.test_report_resources import sample, write_parts

from conductor.report import write_report

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
# The page's security policy forbids eval, so wait with `expect`, not with `wait_for_function`.
expect = sync_api.expect

CHROMIUM = Path("/usr/bin/chromium")

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM),
            args=["--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking"],
        )
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Any, tmp_path: Path) -> Iterator[Any]:
    """The report of a campaign with a case of each kind; the page may not complain or call out."""
    replace = msgspec.structs.replace

    def change(case, end):
        if case.id == "yolov3-0500-clear":
            return replace(
                end, outcome="unresolved", verdict="", passed=False, scalars={}, kpi_sha256=""
            )
        if case.id == "yolov2-tiny-0500-clear":
            return replace(end, reasons=["<script>window.hacked = 1</script>"])
        return end

    make_campaign(tmp_path, change=change)
    write_parts(tmp_path, *(sample(moment, host=host) for moment in (1, 2) for host in ("a", "b")))
    path = write_report(tmp_path)
    complaints: list[str] = []
    requests: list[str] = []
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.on("console", lambda m: complaints.append(m.text) if m.type != "log" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("#curves .scatterlayer .trace")
    yield page
    assert page.evaluate("window.hacked") is None
    page.close()
    assert complaints == []
    assert requests == [path.as_uri()]


def _ids(page: Any) -> list[str]:
    found: list[str] = page.eval_on_selector_all(
        "#cases tbody tr", "rows => rows.filter(r => !r.hidden).map(r => r.dataset.case)"
    )
    return found


def test_plots_are_drawn(page: Any) -> None:
    assert page.locator("#heat .js-plotly-plot .main-svg").count() >= 2
    assert page.locator("#curves .subplot").count() == 6
    assert "factor of safety 1 m" in page.locator("#curves").inner_text()
    # Nothing that would send results away.
    titles = page.eval_on_selector_all(".modebar-btn", "all => all.map(b => b.dataset.title)")
    assert titles
    assert not [t for t in titles if "hare" in t or "loud" in t]


def test_the_table_sorts_with_missing_values_last(page: Any) -> None:
    before = _ids(page)
    button = page.locator("#cases th button", has_text="Min DTC")
    button.click()
    values = page.eval_on_selector_all(
        "#cases tbody tr", "rows => rows.map(r => r.querySelectorAll('td')[5].dataset.sort)"
    )
    numbers = [float(value) for value in values if value]
    assert numbers == sorted(numbers)
    assert len(numbers) == 7
    assert _ids(page)[-1] == "yolov3-0500-clear"
    button.click()
    assert _ids(page)[-1] == "yolov3-0500-clear"
    assert page.locator("#cases th[aria-sort=descending]").count() == 1
    assert sorted(_ids(page)) == sorted(before)


def test_the_table_can_be_searched(page: Any) -> None:
    page.fill("#find", "heavy fog")
    assert len(_ids(page)) == 4
    assert page.locator("#found").inner_text() == "4 of 8 cases"


def test_a_click_on_a_row_highlights_the_case(page: Any) -> None:
    traces = page.evaluate("document.getElementById('curves').data.length")
    page.locator("tr[data-case=yolov3-1300-heavy_fog]").click()
    assert page.input_value("#pick-case") == "yolov3-1300-heavy_fog"
    assert page.evaluate("document.getElementById('curves').data.length") == traces + 6
    assert page.locator("tr[aria-selected=true]").count() == 1
    page.locator("tr[data-case=yolov3-1300-heavy_fog]").click()
    assert page.input_value("#pick-case") == ""


def test_a_case_without_rows_says_so(page: Any) -> None:
    page.select_option("#pick-case", "yolov3-0500-clear")
    assert "no KPI rows were recorded" in page.locator("#picked").inner_text()


def test_a_click_on_a_heat_map_cell_highlights_the_case(page: Any) -> None:
    plot = page.locator("#heat .nsewdrag").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    x, y = box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"]
    page.mouse.move(x, y)
    page.wait_for_selector("#heat .hoverlayer .hovertext")
    page.mouse.click(x, y)
    expect(page.locator("#pick-case")).to_have_value("yolov3-1300-clear")


def test_one_system_and_another_colour(page: Any) -> None:
    page.select_option("#pick-model", "yolov2-tiny")
    assert page.locator("#picked").inner_text().startswith("4 cases")
    page.select_option("#pick-group", label="Outcome")
    names = page.evaluate("document.getElementById('curves').data.map(t => t.name)")
    assert any(name.startswith("collision (") for name in names)
    page.check("#near")
    assert page.evaluate("document.getElementById('curves').layout.yaxis2.range") == [0, 10]


def test_resources_are_drawn(page: Any) -> None:
    plot = page.locator("#resources")
    assert plot.locator(".subplot").count() == 2, "CPU and RAM; no GPU was measured"
    assert plot.locator(".scatterlayer .trace").count() == 4
    assert page.locator("#resource-nodes tbody tr").count() == 3


def test_dark_mode_and_print(page: Any) -> None:
    page.emulate_media(color_scheme="dark")
    expect(page.locator("body")).to_have_css("background-color", "rgb(20, 23, 27)")
    title = page.locator("#curves text", has_text="Sim time [s]")
    expect(title).to_have_css("fill", "rgb(232, 234, 237)")
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")
