"""The report in a real browser, opened from the file system without a network."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from browser_pages import PATIENCE_MS
from unit.conductor.report.reading.test_report_leases import one_after_the_other
from unit.conductor.report.reading.test_report_resources import sample, write_parts
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of
from waiting import wait_for

from conductor.bench.report_campaign import plan_of, write_files, write_outcomes
from conductor.report import make_report
from schemas.campaign import WEATHERS

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
# The page's security policy forbids eval, so wait with `expect`, not with `wait_for_function`.
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

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


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a campaign with a case of each kind."""
    folder = tmp_path_factory.mktemp("campaign")
    replace = msgspec.structs.replace

    def change(case, end):
        if case.id == "yolov3-0500-clear":
            return replace(end, outcome="unresolved", verdict="", scalars={}, kpi_sha256="")
        if case.id == "yolov2-tiny-0500-clear":
            return replace(end, reasons=["<script>window.hacked = 1</script>"])
        return end

    make_campaign(folder, change=change)
    one_after_the_other(folder)
    write_parts(folder, *(sample(moment, host=host) for moment in (1, 2) for host in ("a", "b")))
    return make_report(folder).page


@pytest.fixture
def page(browser: Any, report: Path) -> Iterator[Any]:
    """The report, freshly opened."""
    with looked_at(browser, report) as page:
        await_drawn(page, "#curves", "#heat", "#effects", "#interactions", "#leases", "#resources")
        yield page
        assert page.evaluate("window.hacked") is None


def await_drawn(page: Any, *places: str) -> None:
    """Until something of each plot stands there."""
    for place in places:
        drawn = ".main-svg" if place == "#heat" else ".trace"
        page.locator(f"{place} {drawn}").first.wait_for(state="attached")


def await_hovered(page: Any, place: str, x: float, y: float) -> None:
    """Stay there with the mouse until the plot says what is below it; a plot that has just been
    drawn may miss a move."""

    def look() -> bool:
        for off in (1, 0):
            page.mouse.move(x + off, y)
        page.wait_for_timeout(200)
        return bool(page.locator(f"{place} .hoverlayer .hovertext").count())

    wait_for(look, f"words at the mouse in {place}")


@contextlib.contextmanager
def looked_at(browser: Any, path: Path, width: int = 1280) -> Iterator[Any]:
    """An open page, ``width`` pixels wide; it may not complain or call out."""
    complaints: list[str] = []
    requests: list[str] = []
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    page.on("console", lambda m: complaints.append(m.text) if m.type != "log" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri())
    yield page
    page.close()
    assert complaints == []
    assert [url for url in requests if not url.startswith("data:")] == [path.as_uri()]


def _ids(page: Any) -> list[str]:
    found: list[str] = page.eval_on_selector_all(
        "#cases tbody tr", "rows => rows.filter(r => !r.hidden).map(r => r.dataset.case)"
    )
    return found


def test_plots_are_drawn(page: Any) -> None:
    assert page.locator("#heat .js-plotly-plot .main-svg").count() >= 2
    assert page.locator("#curves .subplot").count() == 2 * 5, "a row per system, a column per KPI"
    assert page.locator("#effects .subplot").count() == 3
    assert page.locator("#interactions .scatterlayer .trace").count() == 2
    assert page.locator("#leases .scatterlayer .trace").count() >= 2
    assert page.locator("#leases .barlayer .point").count() > 0
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
        "#cases tbody tr", "rows => rows.map(r => r.querySelectorAll('td')[6].dataset.sort)"
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
    assert page.evaluate("document.getElementById('curves').data.length") == traces + 5
    assert page.locator("tr[aria-selected=true]").count() == 1
    page.locator("tr[data-case=yolov3-1300-heavy_fog]").click()
    assert page.input_value("#pick-case") == ""


def test_hovering_over_a_curve_names_its_case(page: Any) -> None:
    panel = page.locator("#curves .nsewdrag[data-subplot=x2y2]")
    panel.scroll_into_view_if_needed()
    box = panel.bounding_box()
    x, y = box["x"] + 0.3 * box["width"], box["y"] + 0.3 * box["height"]
    await_hovered(page, "#curves", x, y)
    assert "yolov3-" in page.locator("#curves .hoverlayer").text_content()


def test_zooming_into_one_plot_moves_the_time_of_all(page: Any) -> None:
    panel = page.locator("#curves .nsewdrag[data-subplot=x2y2]")
    panel.scroll_into_view_if_needed()
    box = panel.bounding_box()
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.2 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.8 * box["height"], steps=4)
    page.mouse.up()
    ranges = "['xaxis2', 'xaxis10'].map(a => document.getElementById('curves').layout[a].range)"

    def zoomed() -> Any:
        first, last = page.evaluate(ranges)
        return first if first == last and 0 < first[0] < first[1] < 12 else None

    assert wait_for(zoomed, "the same time in the plots of the first row and the last")


def test_the_maps_take_any_two_axes(page: Any) -> None:
    assert page.locator("#heat h3").all_inner_texts() == ["yolov3", "yolov2-tiny"]
    page.select_option("#heat-x", "model")
    page.select_option("#heat-per", "")
    assert page.locator("#heat h3").all_inner_texts() == ["All cases"]
    texts = "document.querySelector('#heat .js-plotly-plot').data[0].text"
    # The worst case of a cell shows, and how many of its two passed.
    assert page.evaluate(texts) == [["? 1/2", "✓ 2/2"], ["✓ 2/2", "✕ 0/2"]]


def test_interactions_of_any_two_axes_and_numbers(page: Any) -> None:
    values = "document.getElementById('interactions').data.map(t => [t.name, t.y])"
    assert page.evaluate(values) == [["yolov3", [100, 100]], ["yolov2-tiny", [100, 0]]]
    page.select_option("#effect-by", "")
    page.select_option("#effect-x", "time_of_day")
    assert page.evaluate(values)[0][0] == "all cases"
    page.select_option("#effect-measure", label="Min DTC [m]")
    assert page.locator("#interactions").inner_text().count("Min DTC [m], median") == 1


def test_one_axis_and_one_system_are_drawn_from_the_start(browser: Any, tmp_path: Path) -> None:
    data = campaign_data()
    data["matrix"] = {"model": ["yolov3"], "time_of_day": ["13:00"], "weather": ["clear", "cloudy"]}
    make_campaign(tmp_path, data)
    with looked_at(browser, make_report(tmp_path, plots=False).page) as page:
        await_drawn(page, "#curves", "#heat", "#interactions")
        assert page.input_value("#effect-x") == "weather"
        assert page.input_value("#effect-by") == ""
        assert page.input_value("#pick-model") == "yolov3"
        assert page.locator("#curves .subplot").count() == 6


def test_buttons_of_cases_lead_to_their_curves(page: Any) -> None:
    page.locator("#highlights button.case").first.click()
    assert page.input_value("#pick-case")
    expect(page.locator("#curve-section")).to_be_in_viewport()


def test_a_case_without_rows_says_so(page: Any) -> None:
    page.select_option("#pick-case", "yolov3-0500-clear")
    assert "no KPI rows were recorded" in page.locator("#picked").inner_text()


def test_a_click_on_a_heat_map_cell_highlights_the_case(page: Any) -> None:
    plot = page.locator("#heat .nsewdrag").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    x, y = box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"]
    await_hovered(page, "#heat", x, y)
    page.mouse.click(x, y)
    expect(page.locator("#pick-case")).to_have_value("yolov3-1300-clear")


def test_one_system_and_another_colour(page: Any) -> None:
    page.select_option("#pick-model", "yolov2-tiny")
    assert page.locator("#curves .subplot").count() == 6
    assert page.locator("#picked").inner_text().startswith("4 cases")
    page.select_option("#pick-group", label="Outcome")
    names = page.evaluate("document.getElementById('curves').data.map(t => t.name)")
    assert "collision" in names
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
    title = page.locator("#curves text", has_text="Sim time [s]").first
    expect(title).to_have_css("fill", "rgb(232, 234, 237)")
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")


@pytest.mark.parametrize("kind", ["none ended", "one case"])
def test_odd_campaigns_are_drawn_without_complaints(
    browser: Any, tmp_path: Path, kind: str
) -> None:
    def change(case, end):
        return msgspec.convert({"outcome": ""}, type(end)) if kind == "none ended" else end

    matrix = {"model": ["yolov3"]} if kind == "one case" else campaign_data()["matrix"]
    make_campaign(tmp_path, campaign_data(matrix=matrix), change)
    with looked_at(browser, make_report(tmp_path).page) as page:
        page.wait_for_selector("#heat .main-svg")
        assert page.locator("#curves").is_visible() == (kind == "one case")


def test_the_paper_s_256_cases(browser: Any, tmp_path: Path) -> None:
    plan = plan_of(256)
    ends = write_files(tmp_path, plan)
    write_outcomes(tmp_path, plan.campaign, ends, left=0)
    path = make_report(tmp_path).page
    assert path.stat().st_size < 10_000_000
    with looked_at(browser, path) as page:
        await_drawn(page, "#curves", "#heat", "#leases")
        assert page.locator("#curves .subplot").count() == 4 * 5
        assert page.locator("#heat .js-plotly-plot").count() == 4
        assert page.locator("#cases tbody tr").count() == 256
        assert page.locator("#leases .main-svg").count() >= 1


# --- widths -------------------------------------------------------------------------------------

COLLIDING_LABELS = """plot => {
  const quads = [...plot.querySelectorAll('svg text')].filter(t => t.textContent.trim()).map(t => {
    const [box, to] = [t.getBBox(), t.getScreenCTM()];
    const [x0, y0, x1, y1] = [box.x + 1, box.y + 2, box.x + box.width - 1, box.y + box.height - 2];
    const corner = (x, y) => [to.a * x + to.c * y + to.e, to.b * x + to.d * y + to.f];
    return [t.textContent, [corner(x0, y0), corner(x1, y0), corner(x1, y1), corner(x0, y1)]];
  }).filter(([, q]) => Math.hypot(q[0][0] - q[2][0], q[0][1] - q[2][1]) > 4);
  const axes = quad => quad.slice(0, 2).map(
    (p, i) => [quad[i + 1][1] - p[1], p[0] - quad[i + 1][0]]);
  const span = (quad, [x, y]) => {
    const along = quad.map(p => p[0] * x + p[1] * y);
    return [Math.min(...along), Math.max(...along)];
  };
  const apart = (one, two) => [...axes(one), ...axes(two)].some(axis => {
    const [a, b] = [span(one, axis), span(two, axis)];
    return a[1] < b[0] || b[1] < a[0];
  });
  const found = [];
  quads.forEach(([said, quad], i) => quads.slice(0, i).forEach(([other, with_]) => {
    if (!apart(quad, with_)) found.push(`${said} / ${other}`);
  }));
  return found;
}"""
"""Pairs of texts in a figure that overlap, whatever way they are turned."""


def _folder(kind: str, folder: Path) -> Path:
    """A campaign folder: eight cases, one system with 64, or four with 64 each."""
    if kind == "256 cases":
        plan = plan_of(256)
        write_outcomes(folder, plan.campaign, write_files(folder, plan), left=0)
    elif kind == "64 cases":
        hours = [f"{hour:02}:00" for hour in range(5, 21, 2)]
        matrix = {"weather": list(WEATHERS), "time_of_day": hours}
        stack = {"stack": "my_rather_long_package.module:CautiousStack"}
        make_campaign(folder, campaign_data(autonomy=stack, matrix=matrix), every_kind)
    else:
        make_campaign(folder, change=every_kind)
    return folder


def every_kind(case: Any, end: Any) -> Any:
    """A case of every verdict and outcome, with reasons as long as real ones."""
    place = sum(map(ord, case.id)) % 7
    verdict = ("pass", "collision", "false_braking", "time_up", "", "", "pass")[place]
    outcome = {4: "unresolved", 5: "failed"}.get(place, "verdict")
    said = "came to rest 52.80 m from the obstacle; further than 30 m is false braking, and told so"
    return msgspec.structs.replace(
        end, outcome=outcome, verdict=verdict, passed=verdict == "pass", reasons=[said, said]
    )


@pytest.fixture(scope="module", params=["8 cases", "64 cases", "256 cases"])
def any_report(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = _folder(request.param, tmp_path_factory.mktemp("any"))
    write_parts(folder, *(sample(moment, host=host) for moment in (1, 2) for host in ("a", "b")))
    page = folder / "report.html"
    page.write_text(page_of(folder))
    return request.param, page


@pytest.mark.parametrize("width", [420, 1280])
def test_no_page_scrolls_sideways(browser: Any, any_report: tuple[str, Path], width: int) -> None:
    with looked_at(browser, any_report[1], width) as page:
        page.wait_for_selector("#curves .scatterlayer .trace")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        page.select_option("#pick-model", "")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("width", [420, 1280])
def test_labels_of_figures_are_apart(
    browser: Any, any_report: tuple[str, Path], width: int
) -> None:
    with looked_at(browser, any_report[1], width) as page:
        page.wait_for_selector("#curves .scatterlayer .trace")
        for model in ["", *page.evaluate("Object.keys(JSON.parse(data.textContent).names)")][:2]:
            page.select_option("#pick-model", model)
            plots = page.locator(".js-plotly-plot")
            assert plots.count() >= 4
            assert [plots.nth(i).evaluate(COLLIDING_LABELS) for i in range(plots.count())] == [
                [] for _ in range(plots.count())
            ]


def test_the_case_table_keeps_its_reasons(browser: Any, any_report: tuple[str, Path]) -> None:
    with looked_at(browser, any_report[1]) as page:
        head = page.locator("#cases th", has_text="Reasons")
        place = head.evaluate("head => head.cellIndex")
        seen = page.evaluate(
            """place => {
              const edge = document.querySelector('.tall').getBoundingClientRect().right;
              return [...document.querySelectorAll('#cases tbody tr')].map(row => {
                const cell = row.cells[place], box = cell.getBoundingClientRect();
                const whole = cell.scrollWidth <= cell.clientWidth + 1;
                return [box.right <= edge, box.width >= 180, whole];
              });
            }""",
            place,
        )
        assert len(seen) == page.locator("#cases tbody tr").count() > 0
        assert all(all(row) for row in seen)


def test_many_cases_are_drawn_as_distributions(browser: Any, any_report: tuple[str, Path]) -> None:
    kind, path = any_report
    with looked_at(browser, path) as page:
        page.wait_for_selector("#curves .scatterlayer .trace")
        columns = page.evaluate(
            """() => {
              const found = {};
              for (const trace of document.getElementById('curves').data) {
                if (trace.yaxis && Number(trace.yaxis.slice(1) || 1) <= 5 && trace.mode === 'lines')
                  (found[trace.yaxis] ??= []).push(trace.fill ?? 'none');
              }
              return found;
            }"""
        )
        if kind == "8 cases":
            assert {fill for fills in columns.values() for fill in fills} == {"none"}
            return
        assert columns["y"] == columns["y3"] == ["tozeroy"], "AEB, collisions: a share each"
        bands = ["none", "tonexty", "none", "tonexty", "none"]
        assert columns["y4"] == columns["y5"] == bands, "throttle, brake: 90 %, 50 %, median"
        assert "none" in columns["y2"], "distances are lines still"
        assert "AEB trigger, share of cases" in page.locator("#curves").inner_text()
        case = page.locator("#cases tbody tr").first
        case.click()
        name = case.get_attribute("data-case")
        lit = f"document.getElementById('curves').data.filter(t => t.name === '{name}').length"
        assert page.evaluate(lit) in (0, 5, 6), "a case that is picked is drawn in every panel"
