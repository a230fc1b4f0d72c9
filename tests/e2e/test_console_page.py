"""The console's page in a real browser, from files: every view, its addresses, keys and looks."""

from __future__ import annotations

import csv
import os
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser_pages import (
    CHROMIUM,
    PATIENCE_MS,
    OpenedPages,
    axe_source,
    chromium,
    file_server,
    findings,
)
from console_findings import read, write, write_findings

from viewer.bench.console_site import (
    AXES,
    HOSTILE,
    PER_STRIP,
    made_case,
    name_of,
    write_site,
)

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")
# The page's security policy forbids eval, so wait with `expect`, not with `wait_for_function`.
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)

COUNT = 320
GOLDEN = Path(__file__).parents[1] / "golden" / "console"
UPDATE = os.environ.get("UPDATE_GOLDEN") == "1"
RUN = "made-up"
COLLISIONS = sorted(
    (case for case in map(made_case, range(COUNT)) if case.verdict == "collision"),
    key=lambda case: -(case.impact_mps or 0),
)
WORST = COLLISIONS[0].name
SHOWN_BRIEFLY = COLLISIONS[-1]
"""A case without a film and without rows."""
MORE = [
    {"id": "later", "name": "later", "state": "waiting", "cases": 4, "done": 0, "verdicts": {}}
    | dict.fromkeys(("started_s", "elapsed_s", "eta_s", "per_minute", "workers", "gpus"))
    | {"device_hours": None, "error": None},
    {"id": "broken", "name": "broken", "state": "damaged", "cases": 0, "done": 0, "verdicts": {}}
    | dict.fromkeys(("started_s", "elapsed_s", "eta_s", "per_minute", "workers", "gpus"))
    | {"device_hours": None, "error": f"outcomes.json: damaged: {HOSTILE}"},
]
"""Campaigns beside the one that has data: one that waits, one that cannot be read."""
VIEWS = {
    "runs": "#/",
    "run": f"#/run/{RUN}",
    "wall": f"#/run/{RUN}/wall?at={WORST}&sel=1,2",
    "heat": f"#/run/{RUN}/wall?group=weather,model",
    "rows": f"#/run/{RUN}/wall?as=rows&at={WORST}",
    "case": f"#/run/{RUN}/case/{WORST}?t=5",
    "beside": f"#/run/{RUN}/case/{WORST}/beside/{RUN}/{COLLISIONS[1].name}",
    "several": f"#/run/{RUN}/case/{WORST}/beside/"
    + "/".join(f"{RUN}/{case.name}" for case in (*COLLISIONS[1:7], SHOWN_BRIEFLY)),
    "workers": f"#/run/{RUN}/workers",
    "search": f"#/run/{RUN}/search",
    "rulebook": f"#/run/{RUN}/rulebook",
    "compare": f"#/compare/{RUN}/later",
    "lost": "#/nowhere",
}


@pytest.fixture(scope="module")
def browser():
    with chromium(sync_api) as browser:
        yield browser


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("console") / "site"
    write_site(folder, COUNT)
    runs = read(folder / "data", "runs.json")
    write(folder / "data", "runs.json", {**runs, "runs": [*runs["runs"], *MORE]})
    write_findings(folder, RUN, "later", [case.name for case in COLLISIONS])
    return folder


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A console of one campaign, as a newcomer opens it."""
    folder = tmp_path_factory.mktemp("one") / "site"
    write_site(folder, COUNT, dossiers=4)
    return folder


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    return axe_source(tmp_path_factory.mktemp("axe"))


@pytest.fixture
def pages(browser: Any, tmp_path_factory: pytest.TempPathFactory):
    """Pages from the disk; they may ask nobody and say nothing."""
    pages = OpenedPages(browser)
    yield pages
    pages.check(tmp_path_factory.getbasetemp().as_uri())


def address(site: Path, hash_: str) -> str:
    return f"{(site / 'index.html').as_uri()}{hash_}"


def coarse(picture: np.ndarray) -> np.ndarray:
    """A tenth of a picture's width and height."""
    height, width = picture.shape[:2]
    return cv2.resize(picture, (width // 10, height // 10), interpolation=cv2.INTER_AREA)


def ready(page: Any, view: str) -> None:
    """Wait until a view shows what it has."""
    heads = {
        "runs": "Campaigns",
        "run": RUN,
        "beside": "Side by side",
        "several": "Side by side",
        "workers": "Workers",
        "search": "Bayesian search",
        "rulebook": "FMVSS 127",
        "compare": "later",
        "lost": "No such view",
    }
    if view in heads:
        expect(page.locator("main h1")).to_contain_text(heads[view])
    if view in ("wall", "heat"):
        expect(page.locator(".frame canvas")).to_have_attribute("data-tiles", re.compile(r"[1-9]"))
    if view == "rows":
        expect(page.locator(".rows tbody th").first).to_have_text(WORST)
    if view in ("case", "beside", "several", "workers", "search"):
        expect(page.locator(".plot .main-svg").first).to_be_attached()
    if view in ("case", "beside", "several"):
        film = page.locator(".film canvas").first
        expect(film).to_have_attribute("data-frame", re.compile(r"\d"))


def test_a_newcomer_finds_the_worst_case_why_it_failed_and_the_command(pages, one):
    """Two clicks, by what stands on the page alone."""
    page = pages.open(address(one, ""))
    expect(page.get_by_role("heading", name="The worst case", exact=True)).to_be_visible()
    reason = f"collided with the van at {COLLISIONS[0].impact_mps} m/s"
    expect(page.get_by_text(reason)).to_be_visible()
    expect(page.get_by_alt_text(f"What the camera of {WORST} saw")).to_be_visible()
    page.get_by_text("See why, and repeat it").click()
    expect(page.get_by_role("heading", name=WORST)).to_be_in_viewport()
    expect(page.get_by_text(reason).first).to_be_in_viewport()
    film = page.get_by_role("img", name="Camera film")
    expect(film).to_be_in_viewport()
    expect(film).to_have_attribute("data-frame", re.compile(r"\d"))
    expect(page.get_by_text("Repeat it")).to_be_in_viewport()
    command = f"conductor run {RUN} --case {WORST} --view record --out again"
    expect(page.get_by_text(command)).to_be_in_viewport()
    page.get_by_text("Copy", exact=True).click()
    expect(page.get_by_text("Copied")).to_be_visible()
    page.evaluate("document.body.appendChild(document.createElement('textarea')).focus()")
    page.keyboard.press("Control+V")
    expect(page.locator("body > textarea")).to_have_value(command)


def test_the_wall_leads_to_the_worst_case_by_keys(pages, site):
    page = pages.open(address(site, "#/"))
    page.get_by_role("link", name=f"Open the wall of {RUN}").click()
    expect(page.get_by_text("Click a case to see why it ended so.")).to_be_visible()
    expect(page.get_by_label("Sort")).to_have_value("worst")
    wall = page.get_by_role("listbox")
    wall.focus()
    page.keyboard.press("ArrowRight")  # the first tile: the wall stands worst first
    details = page.get_by_role("complementary")
    expect(details).to_contain_text(WORST)
    expect(details).to_contain_text(f"collided with the van at {COLLISIONS[0].impact_mps} m/s")
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text(WORST)
    expect(page.get_by_label("Traceback of the stack")).to_contain_text("stack.py")


def test_a_damaged_campaign_is_said_and_the_others_are_shown(pages, site):
    page = pages.open(address(site, "#/"))
    damaged = page.get_by_role("listitem").filter(has_text="broken")
    expect(damaged).to_contain_text("damaged")
    expect(damaged).to_contain_text(HOSTILE)
    assert damaged.get_by_role("link").count() == 0
    choices = page.locator("form select").first.locator("option").all_text_contents()
    assert set(choices) == {RUN, "later"}
    page.goto(address(site, "#/run/broken"))
    expect(page.locator("main")).to_contain_text(HOSTILE)
    for link in page.get_by_role("navigation").get_by_role("link").all():
        expect(link).to_have_text("Campaigns")


def test_what_a_search_a_rulebook_and_a_comparison_found_leads_to_cases(pages, site):
    page = pages.open(address(site, "#/"))
    page.get_by_role("link", name=f"Summary of {RUN}").click()
    page.get_by_role("link", name="Search", exact=True).click()
    ready(page, "search")
    expect(page.locator("main")).to_contain_text("0 of 16 proposed cases failed")
    plots = page.get_by_role("img", name=re.compile(" over "))
    expect(plots).to_have_count(4)  # one per parameter
    expect(page.get_by_role("region", name="Which parameters matter")).to_contain_text("0.500 to")
    page.get_by_role("link", name=WORST).click()
    expect(page.locator("h1")).to_have_text(WORST)
    page.get_by_role("link", name="Rulebook", exact=True).click()
    row = page.get_by_role("region", name="Stationary lead vehicle, lead-stationary")
    expect(row).to_contain_text("ego speed 80 km/h")
    expect(row).to_contain_text("contact at 55.5 km/h relative to the target")
    expect(row.get_by_role("link", name="lead-stationary-ego.speed_kmh_80: fail")).to_be_visible()
    page.goto(address(site, VIEWS["compare"]))
    expect(page.get_by_text("Regression: 7 cases have become worse")).to_be_visible()
    assert page.get_by_text("only the campaign differs").count() == 1
    changed = page.get_by_role("region", name="Cases that changed")
    expect(changed.get_by_role("link", name="yolov2-w25-1300-clear")).to_have_attribute(
        "href", f"#/run/{RUN}/case/yolov2-w25-1300-clear/beside/later/yolov2-w25-1300-clear"
    )


def test_cases_of_a_search_that_fail_are_crosses_in_another_colour(pages, site, tmp_path):
    """Numbered from 0, as their names and the report do; of equal values the fastest is worst."""
    copy = tmp_path / "site"
    shutil.copytree(site, copy)
    slow, fast = sorted(COLLISIONS[:2], key=lambda case: case.impact_mps or 0)
    found = read(copy / "data", f"runs/{RUN}/search.json")
    generation = found["generations"][0]
    generation["cases"][1:3] = [slow.name, fast.name]
    generation["results"][1:3] = [0.0, 0.0]
    write(copy / "data", f"runs/{RUN}/search.json", found)
    page = pages.open(address(copy, VIEWS["search"]))
    ready(page, "search")
    worst = page.get_by_role("region", name="The worst cases").get_by_role("link")
    expect(worst.first).to_have_text(fast.name)
    expect(worst.nth(1)).to_have_text(slow.name)
    trace = page.locator(".plot > div").first.evaluate("""plot => {
        const { x, marker } = plot.data[0];
        return { x, symbol: marker.symbol, colors: new Set(marker.color).size };
    }""")
    assert trace["x"] == list(range(16))
    assert [at for at, symbol in enumerate(trace["symbol"]) if symbol == "x"] == [1, 2]
    assert trace["colors"] == 2


def test_the_wall_of_a_run_that_was_not_recorded_says_so(pages, site, axe, tmp_path):
    says = "No pictures: this run was not recorded. Run it with --view record."
    page = pages.open(address(site, VIEWS["heat"]))
    ready(page, "heat")
    expect(page.locator(".frame")).to_have_attribute("data-loading", "0")
    expect(page.get_by_text(says)).to_have_count(0)
    copy = tmp_path / "site"
    shutil.copytree(site, copy)
    atlas = read(copy / "data", f"runs/{RUN}/pictures/atlas.json")
    nothing = {**atlas, "has": [False] * COUNT}
    write(copy / "data", f"runs/{RUN}/pictures/atlas.json", nothing)
    page = pages.open(address(copy, f"#/run/{RUN}/wall?zoom=70"))
    ready(page, "wall")
    expect(page.get_by_text(says)).to_be_visible()
    assert findings(page, axe) == []


def test_a_report_is_shown_in_a_frame_that_reaches_nothing(browser, site):
    pages = OpenedPages(browser)
    with file_server(site) as url:
        page = pages.open(f"{url}#/run/{RUN}")
        page.get_by_role("link", name="Report", exact=True).click()
        report = page.frame_locator("iframe.report")
        expect(report.get_by_role("heading", name="What came of it")).to_be_visible()
        expect(report.locator("#reach")).to_have_text("kept apart")
        expect(page.get_by_role("link", name="Open it alone")).to_be_visible()
        pages.check(url)


def test_neighbours_have_the_signs_of_their_verdicts(pages, site):
    page = pages.open(address(site, VIEWS["case"]))
    ready(page, "case")
    row = page.locator(".neighbours").filter(has=page.get_by_role("heading", name="Weather"))
    place = AXES["weather"].index(COLLISIONS[0].axes["weather"])
    beside = [
        AXES["weather"][at] for at in (place - 1, place + 1) if 0 <= at < len(AXES["weather"])
    ]
    made = {case.name: case for case in map(made_case, range(COUNT))}
    assert beside
    for value in beside:
        other = made[name_of({**COLLISIONS[0].axes, "weather": value})]
        item = row.get_by_role("listitem").filter(has_text=value.replace("_", " "))
        expect(item).to_contain_text(f"{other.verdict.replace('_', ' ')}:")
        expect(item.locator(".icon")).to_be_visible()
    expect(row.get_by_text("(this case)")).to_be_attached()


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("view", VIEWS)
def test_axe_finds_nothing(pages, site, axe, view, theme):
    page = pages.open(address(site, VIEWS[view]), theme=theme)
    ready(page, view)
    assert page.locator("html").get_attribute("data-theme") == theme
    assert findings(page, axe) == []


@pytest.mark.parametrize("view", VIEWS)
def test_a_phone_shows_every_view_without_scrolling_sideways(pages, site, axe, view):
    page = pages.open(address(site, VIEWS[view]), width=420, height=860)
    ready(page, view)
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert findings(page, axe) == []


def test_texts_of_stacks_stay_texts(pages, site):
    page = pages.open(address(site, VIEWS["case"]))
    ready(page, "case")
    expect(page.locator(".events li").first).to_contain_text(HOSTILE)
    expect(page.get_by_label("Traceback of the stack")).to_contain_text(HOSTILE)
    assert page.locator("main b:not(.icon), main img[src=x]").count() == 0


def test_a_filter_a_sort_and_a_group_stand_in_the_address(pages, site):
    page = pages.open(address(site, f"#/run/{RUN}/wall"))
    ready(page, "wall")
    says = page.locator("#filter-says")
    box = page.get_by_role("searchbox")
    box.fill("weather=heavy_fog impact_speed_mps>6 -tiny")
    wanted = [
        case
        for case in COLLISIONS
        if case.axes["weather"] == "heavy_fog" and case.impact_mps > 6 and "tiny" not in case.name
    ]
    assert wanted
    expect(says).to_have_text(f"{len(wanted)} of {COUNT} cases")
    page.get_by_label("Sort").select_option("impact_speed_mps")
    page.get_by_role("button", name="↑ rising").click()
    page.get_by_label("Across").select_option("model")
    expect(page.get_by_label("Down")).to_be_visible()
    page.get_by_role("listbox").focus()
    page.keyboard.press("Home")
    first = page.evaluate("location.hash")
    assert "sort=-impact_speed_mps" in first
    assert "group=model" in first
    copy = pages.open(address(site, first))
    ready(copy, "wall")
    expect(copy.locator("#filter-says")).to_have_text(f"{len(wanted)} of {COUNT} cases")
    leftmost = min(wanted, key=lambda case: AXES["model"].index(case.axes["model"]))
    expect(copy.get_by_role("complementary")).to_contain_text(leftmost.name)
    box.fill("speed>3")
    expect(says).to_contain_text("There is no column “speed”")
    box.fill("impact_speed_mps>fast")
    expect(says).to_contain_text("wants a number")
    box.fill("nothing-has-this-name")
    expect(page.get_by_text("No case passes the filter.")).to_be_visible()


def test_columns_that_are_named_as_what_every_object_has_are_none(pages, site):
    page = pages.open(address(site, f"#/run/{RUN}/wall?filter=constructor%3Dx"))
    expect(page.locator("#filter-says")).to_contain_text("There is no column “constructor”")


def test_what_is_selected_is_exported_and_compared(pages, site, tmp_path):
    page = pages.open(address(site, f"#/run/{RUN}/wall"))
    ready(page, "wall")
    page.get_by_role("listbox").focus()
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    page.keyboard.press("Shift+ArrowRight")
    bar = page.get_by_role("group", name="Selected cases")
    expect(bar).to_contain_text("2 cases selected")
    with page.expect_download() as saved:
        bar.get_by_role("button", name="Save as CSV").click()
    saved.value.save_as(tmp_path / "cases.csv")
    with (tmp_path / "cases.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["case"] for row in rows} == {case.name for case in COLLISIONS[:2]}
    by_name = {case.name: case for case in COLLISIONS}
    for row in rows:
        assert row["verdict"] == "collision"
        assert float(row["impact_speed_mps"]) == by_name[row["case"]].impact_mps
    with page.expect_download() as saved:
        bar.get_by_role("button", name="Save case ids").click()
    assert set(Path(saved.value.path()).read_text().split()) == {row["case"] for row in rows}
    bar.get_by_role("link", name="Compare side by side").click()
    expect(page.locator(".box.notice")).to_contain_text("They differ first at")


def test_up_to_eight_cases_are_compared_and_exported(pages, site, tmp_path):
    """What is selected on the wall stands beside each other at one time, and is saved as tables."""
    page = pages.open(address(site, f"#/run/{RUN}/wall"))
    ready(page, "wall")
    page.get_by_role("listbox").focus()
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    for _ in range(4):
        page.keyboard.press("Shift+ArrowRight")
    bar = page.get_by_role("group", name="Selected cases")
    expect(bar).to_contain_text("5 cases selected")
    bar.get_by_role("link", name="Compare side by side").click()
    ready(page, "several")
    expect(page.locator(".sides section h2")).to_have_count(5)
    films = page.locator(".film canvas")
    expect(films).to_have_count(5)
    page.get_by_role("slider", name="Sim time").fill("5")
    for film in films.all():
        expect(film).to_have_attribute("data-frame", "25")
    kpis = page.get_by_role("region", name="KPIs of all cases")
    impacts = kpis.get_by_role("row").filter(has_text="impact_speed_mps").get_by_role("cell")
    expect(impacts).to_have_text([f"{case.impact_mps:.2f} m/s" for case in COLLISIONS[:5]])
    rows = _saved(page, "Save KPIs as CSV", tmp_path)
    assert [row["case"] for row in rows] == [case.name for case in COLLISIONS[:5]]
    assert [float(row["impact_speed_mps"]) for row in rows] == [
        case.impact_mps for case in COLLISIONS[:5]
    ]
    assert {row["run"] for row in rows} == {RUN}
    assert [row["weather"] for row in rows] == [case.axes["weather"] for case in COLLISIONS[:5]]
    ticks = _saved(page, "Save rows over time as CSV", tmp_path)
    drive = read(site / "data", f"runs/{RUN}/cases/{WORST}/series.json")
    mine = [row for row in ticks if row["case"] == WORST]
    assert [float(row["sim_time_s"]) for row in mine] == drive["t"]
    assert [float(row["speed"]) for row in mine] == drive["series"]["speed"]["v"]
    assert [float(row["x_m"]) for row in mine] == drive["actors"][0]["x"]
    assert {row["case"] for row in ticks} == {case.name for case in COLLISIONS[:5]}
    page.get_by_role("link", name=f"Leave out {COLLISIONS[1].name}").click()
    expect(page.locator(".sides section h2")).to_have_count(4)
    assert COLLISIONS[1].name not in page.url


def test_what_a_compared_case_lacks_is_said_and_the_others_stand(pages, site):
    """One without rows, one that is not there, and more than are compared."""
    page = pages.open(address(site, VIEWS["several"]))
    ready(page, "several")
    expect(page.locator(".sides section")).to_have_count(8)
    bare = page.get_by_role("region", name="Case 8")
    expect(bare).to_contain_text("No film")
    expect(page.locator(".sides .film canvas")).to_have_count(7)
    expect(page.get_by_text("1 of the drives has no rows")).to_be_visible()
    pages.allowed.append("ERR_FILE_NOT_FOUND")
    three = f"#/run/{RUN}/case/{WORST}/beside/{RUN}/nobody/{RUN}/{COLLISIONS[1].name}"
    page.goto(address(site, three))
    expect(page.get_by_text("Case nobody:")).to_be_visible()
    expect(page.locator(".sides section")).to_have_count(2)
    page.goto(address(site, f"{VIEWS['several']}/{RUN}/{COLLISIONS[8].name}"))
    expect(page.locator("main h1")).to_have_text("No such view")
    chosen = ",".join(map(str, range(9)))
    page.goto(address(site, f"#/run/{RUN}/wall?sel={chosen}"))
    bar = page.get_by_role("group", name="Selected cases")
    expect(bar).to_contain_text("At most 8 are compared side by side.")
    expect(bar.get_by_role("link")).to_have_count(0)


def _saved(page: Any, button: str, folder: Path) -> list[dict[str, str]]:
    """Rows of the table that a button saves."""
    with page.expect_download() as saved:
        page.get_by_role("button", name=button).click()
    saved.value.save_as(folder / saved.value.suggested_filename)
    with (folder / saved.value.suggested_filename).open(newline="") as file:
        return list(csv.DictReader(file))


def test_zoom_leads_from_dots_to_pictures(pages, site):
    page = pages.open(address(site, f"#/run/{RUN}/wall?zoom=0"))
    ready(page, "wall")
    canvas = page.locator(".frame canvas")
    expect(canvas).to_have_attribute("data-tiles", str(COUNT))
    page.get_by_label("Size").fill("90")
    expect(canvas).to_have_attribute("data-tiles", re.compile(r"^\d$|^1\d$"))
    page.get_by_role("button", name="Fit").click()
    expect(canvas).to_have_attribute("data-tiles", str(COUNT))


@pytest.mark.parametrize("width", [420, 1280])
def test_a_wall_that_nobody_has_moved_stands_at_its_begin(pages, site, width):
    page = pages.open(address(site, VIEWS["heat"]), width=width, height=860)
    ready(page, "heat")
    frame = page.locator(".frame")
    expect(frame).to_have_attribute("data-loading", "0")
    assert frame.evaluate("box => [box.scrollLeft, box.scrollTop]") == [0, 0]


def test_film_events_and_top_view_follow_one_time(pages, site):
    page = pages.open(address(site, VIEWS["case"]))
    ready(page, "case")
    film = page.locator(".film canvas")
    expect(film).to_have_attribute("data-frame", "25")
    expect(page.locator(".player output")).to_have_text("5.00 s")
    page.get_by_role("button", name="1.00 s").click()
    expect(film).to_have_attribute("data-frame", "5")
    expect(page.locator(".events li.past")).to_have_count(1)
    page.locator("h1").click()
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".player output")).to_have_text("2.05 s")
    expect(page.get_by_role("img", name=re.compile("from above.*At 2"))).to_be_visible()
    page.keyboard.press("End")
    last = str(49)
    assert int(last) // PER_STRIP == 3
    expect(film).to_have_attribute("data-frame", last)
    page.keyboard.press("Home")
    page.get_by_label("Playing speed").select_option("0.1")  # it must not end by itself
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    expect(film).not_to_have_attribute("data-frame", "0")
    page.get_by_role("button", name="Pause").click()
    expect(page).to_have_url(re.compile(r"t=\d"))


def test_the_first_tick_that_differs_is_marked_and_both_stand_there(pages, site):
    page = pages.open(address(site, VIEWS["beside"]))
    ready(page, "beside")
    words = page.locator(".box.notice").inner_text()
    moment = re.search(r"They differ first at ([\d.]+) s", words)
    assert moment, words
    page.get_by_role("button", name="To the impact").click()
    page.get_by_role("button", name="To first difference").click()
    expect(page.locator(".player output")).to_have_text(f"{moment[1]} s")
    frames = {film.get_attribute("data-frame") for film in page.locator(".film canvas").all()}
    assert len(frames) == 1
    same = pages.open(address(site, f"#/run/{RUN}/case/{WORST}/beside/{RUN}/{WORST}"))
    expect(same.locator(".box.notice")).to_have_text("Both drives are the same, at every tick.")


def test_what_is_not_there_is_said_and_nothing_else_breaks(pages, site):
    pages.allowed.append("ERR_FILE_NOT_FOUND")
    page = pages.open(address(site, f"#/run/{RUN}/case/no-such-case"))
    expect(page.get_by_text("is not part of this console")).to_be_visible()
    page.goto(address(site, "#/run/nobody/wall"))
    expect(page.get_by_text("is not part of this console").first).to_be_visible()
    page.get_by_role("link", name="Campaigns", exact=True).click()
    expect(page.locator("h1")).to_have_text("Campaigns")


def test_light_and_dark_can_be_chosen_and_stay(pages, site):
    page = pages.open(address(site, "#/"), theme="dark")
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
    page.get_by_label("Colours").select_option("light")
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    page.reload()
    expect(page.locator("html")).to_have_attribute("data-theme", "light")


def test_any_web_server_gives_the_same_page(browser, site):
    pages = OpenedPages(browser)
    with file_server(site) as url:
        page = pages.open(f"{url}{VIEWS['case']}")
        ready(page, "case")
        refused = "fetch('http://outside.example/').catch(() => 'refused')"
        pages.allowed += ["Content Security Policy", "outside.example"]
        assert page.evaluate(refused) == "refused"
        pages.asked = [one for one in pages.asked if "outside.example" not in one]
        pages.check(url)


@pytest.mark.parametrize("width", [420, 1280, 1920])
@pytest.mark.parametrize("view", ["run", "wall", "case"])
def test_pictures_of_views_are_as_they_were_looked_at(pages, site, view, width, tmp_path):
    """Goldens are small and coarse: fonts differ between machines, where things stand does not."""
    theme = "dark" if view == "wall" else "light"
    height = {420: 860, 1280: 800, 1920: 1080}[width]
    page = pages.open(address(site, VIEWS[view]), width=width, height=height, theme=theme)
    ready(page, view)
    if view == "wall":
        expect(page.locator(".moment")).to_have_js_property("complete", True)
        expect(page.locator(".frame")).to_have_attribute("data-loading", "0")
    page.screenshot(path=str(tmp_path / "now.png"))
    now = coarse(cv2.imread(str(tmp_path / "now.png")))
    golden = GOLDEN / f"{view}-{width}.png"
    if UPDATE:
        golden.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(golden), now)
    before = cv2.imread(str(golden))
    assert before is not None, f"{golden}: run with UPDATE_GOLDEN=1"
    assert before.shape == now.shape
    away = np.abs(before.astype(int) - now.astype(int))
    assert float(away.mean()) < 6, "the view looks another way: UPDATE_GOLDEN=1 after a look"
    assert float((away.max(axis=2) > 60).mean()) < 0.03
