"""``report.html`` and ``report_json``: what they say, and what they do not hide."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of, rested

from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import Late
from conductor.report import make_report, report_json
from conductor.report.pages import content
from conductor.report.plots.cells import cell_number, cells_of, worst
from conductor.report.reading.dossier import open_dossier
from twin.base.errors import UsageError

replace = msgspec.structs.replace
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\u2028</SCRIPT>"


def page_data(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def without_scripts(page: str) -> str:
    return re.sub(r"<script.*?</script>", "", page, flags=re.S)


def test_the_page_tells_the_result_and_stands_alone(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    path = make_report(tmp_path, plots=False).page
    assert path == tmp_path / "report.html"
    assert (tmp_path / "summary.parquet").exists()
    page = path.read_text()
    text = without_scripts(page)
    found = report_json(tmp_path)
    assert f"<strong>{found['passed']}</strong> of 8 cases passed" in text
    assert "yolov3</b>" in text
    assert "ground_truth: the simulator&#39;s boxes, no network, contrast_min 0.05" in text
    assert fingerprint(tmp_path).sha256 in text
    assert 'id="alarms"' not in text
    assert 'id="incomplete"' not in text
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)
    data = page_data(page)
    assert len(data["cases"]) == 8
    assert data["heat"] == {"x": "time_of_day", "y": "weather", "per": "model"}
    assert data["all"]["axes"]["model"]["values"] == ["yolov3", "yolov2-tiny"]
    assert [c["id"] for c in data["cases"]] == data["all"]["ids"]
    assert data["groups"][0]["axis"] == "weather"


def table_heads(page: str) -> list[str]:
    """Titles of the columns of the case table."""
    head = page.split('<table id="cases">')[1].split("</thead>")[0]
    return re.findall(r"<button[^>]*>(.*?)</button>", head)


def test_the_case_table_begins_with_what_varies_and_leaves_out_what_nothing_is_in(
    tmp_path: Path,
) -> None:
    data = campaign_data(scenario={"duration_s": 20})
    data["matrix"] = {"model": ["yolov3"], "weather": ["clear"], "time_of_day": ["13:00"]}
    data["matrix"]["scenario.ego_start_m"] = [60, 70]

    def change(case, end):
        return replace(end, reasons=[], scalars={**end.scalars, "aeb_ttc_s": None})

    make_campaign(tmp_path / "one", data, change)
    page = page_of(tmp_path / "one")
    heads = table_heads(page)
    order = ["Case", "Ego start [m]", "Model", "Weather", "Time of day", "Outcome", "Min DTC [m]"]
    assert heads[: len(order)] == order
    assert not [head for head in heads if head in ("Reasons", "AEB TTC [s]")]
    rows = page.split('<table id="cases">')[1].split("</table>")[0].split("<tr ")[1:]
    assert [row.count("</td>") for row in rows] == [len(heads)] * 2

    # One case has a reason and a number: both columns are there, in all rows.
    def one_of_two(case, end):
        return replace(end, reasons=["late"]) if case.id.endswith("60") else change(case, end)

    make_campaign(tmp_path / "other", data, one_of_two)
    assert {"Reasons", "AEB TTC [s]"} <= set(table_heads(page_of(tmp_path / "other")))


def test_json_holds_the_tables(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    found = json.loads(json.dumps(report_json(tmp_path)))
    assert found["complete"] is True
    assert found["alarms"] == []
    assert found["fingerprint"] == fingerprint(tmp_path).sha256
    assert [line["model"] for line in found["systems"]] == ["yolov3", "yolov2-tiny", "All"]
    total = found["systems"][-1]
    assert total["passed"] == found["passed"] == sum(c["passed"] for c in found["cases"])
    assert sum(total["counts"].values()) == total["total"] == 8


def test_attempts_that_a_hand_has_steered_are_counted(tmp_path: Path) -> None:
    def change(case, end):
        steered = ["attempt 1: 3 changes <b>"] if case.id == "yolov3-0500-clear" else []
        return replace(end, steered=steered)

    make_campaign(tmp_path, campaign_data(), change)
    page = page_of(tmp_path)
    assert "Steered by hand</dt><dd>1 attempt, without a verdict" in page
    assert "attempt 1: 3 changes &lt;b&gt;" in page
    make_campaign(tmp_path / "untouched")
    assert "Steered by hand" not in page_of(tmp_path / "untouched")


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    def change(case, end):
        return replace(end, outcome="failed", verdict=HOSTILE, reasons=[HOSTILE], worker=HOSTILE)

    make_campaign(tmp_path, campaign_data(description=HOSTILE), change)
    page = make_report(tmp_path, plots=False).page.read_text()
    assert "alert(1)" in page
    for mark in ("<script>alert", "<img src=x", "</SCRIPT>"):
        assert mark not in page
    hover = page_data(page)["all"]["hover"][0]
    assert "<script" not in hover
    assert "&lt;script&gt;" in hover


def test_a_text_of_ten_megabytes_leaves_the_page_intact(tmp_path: Path) -> None:
    huge = "<b>" + "x" * 10_000_000

    def change(case, end):
        if case.variation.weather == "clear":
            return end
        log = tmp_path / end.attempt_dir / "log.txt"
        if case.id == "yolov3-0500-heavy_fog":
            log.write_text(f"{huge}\nthe last <i>line</i>\n")
        return replace(end, outcome="failed", verdict="nan", reasons=[huge], charges=[huge])

    make_campaign(tmp_path, change=change)
    small = len(make_report(tmp_path, plots=False).page.read_text())
    page = (tmp_path / "report.html").read_text()
    assert small < 6_000_000
    assert "(10000003 characters)" in page
    assert "the last &lt;i&gt;line&lt;/i&gt;" in page
    assert "<b>xxx" not in page


def test_markup_in_the_value_of_an_axis_stays_text(tmp_path: Path) -> None:
    scene = "/tmp/<img src=x onerror=alert(1)>.yaml"
    data = campaign_data(matrix={"model": ["yolov3"], "scenario.scene": ["downtown", scene]})
    make_campaign(tmp_path, data)
    page = make_report(tmp_path, plots=False).page.read_text()
    assert "<img src=x" not in page
    assert "&lt;img src=x onerror=alert(1)&gt;.yaml" in page


def test_the_effects_of_the_axes(tmp_path: Path) -> None:
    def change(case, end):
        if case.id == "yolov3-0500-clear":
            return replace(end, outcome="unresolved", verdict="", kpi_sha256="", scalars={})
        hit = case.variation.weather == "heavy_fog" and case.variation.model == "yolov2-tiny"
        return replace(end, verdict="collision" if hit else "pass")

    make_campaign(tmp_path, change=change)
    effects = {e["axis"]: e["levels"] for e in report_json(tmp_path)["effects"]}
    assert list(effects) == ["model", "time_of_day", "weather"]
    clear, fog = effects["weather"]
    assert (clear["value"], clear["passed"], clear["total"], clear["missing"]) == ("clear", 3, 3, 1)
    assert (fog["passed"], fog["total"], fog["missing"]) == (2, 4, 0)
    assert (fog["low"], fog["high"]) == pytest.approx((0.1500, 0.8500), abs=1e-4)
    assert len(page_data(page_of(tmp_path))["effects"]["data"]) == 3


def test_false_braking_and_single_cases_have_tables(tmp_path: Path) -> None:
    def change(case, end):
        if case.variation.time_of_day_min == 5 * 60:
            return end
        return replace(rested(tmp_path, end, 40.0 + len(case.variation.weather)), wall_s=9.25)

    make_campaign(tmp_path, change=change)
    text = without_scripts(page_of(tmp_path))
    table = re.search(r'<section id="false-braking">.*?</section>', text, re.S)
    assert table
    assert "False braking: 4 cases" in table[0]
    rest = re.findall(r'<td class="n">(\d+\.\d+)</td></tr>', table[0])
    assert rest == ["49.00", "49.00", "45.00", "45.00"], "furthest first"
    assert table[0].count("2 of 2") == 2, "by time of day, both models at 13:00"
    slowest = re.search(r'id="slowest">.*?</table>', text, re.S)
    assert slowest
    assert slowest[0].count("9.2") == 4


def test_failures_come_with_the_command_that_shows_them(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda c, e: replace(e, verdict="collision", reasons=["hit"]))
    text = without_scripts(page_of(tmp_path))
    assert text.count('<article class="failure">') == 8
    name, case = tmp_path.name, "yolov3-0500-clear"
    command = f"conductor run {name}/campaign.yaml --case {case} --view record --out again-{case}"
    assert f"{command}\nviewer replay again-{case} {case}\n" in f"{text}\n".replace("<", "\n<")
    assert f"To reproduce, in the folder that holds <code>{name}</code>; equal" in text
    assert f"The commands are for the folder that holds <code>{name}</code>." in text
    assert "the case was not recorded" in text


@pytest.mark.parametrize("kind", ["none ended", "all failed", "one case"])
def test_odd_campaigns_make_a_page(tmp_path: Path, kind: str) -> None:
    def change(case, end):
        if kind == "none ended":
            return msgspec.convert({"outcome": ""}, type(end))
        if kind == "all failed":
            return replace(end, outcome="failed", verdict="nan", kpi_sha256="", scalars={})
        return end

    matrix = {"model": ["yolov3"]} if kind == "one case" else campaign_data()["matrix"]
    make_campaign(tmp_path, campaign_data(matrix=matrix), change)
    page = make_report(tmp_path, plots=False).page.read_text()
    data, text = page_data(page), without_scripts(page)
    assert len(data["all"]["axes"]) >= 2
    if kind == "one case":
        assert "<strong>1</strong> of 1 cases passed" in text
        assert data["effects"] is None
    else:
        assert 'id="no-curves"' in text
        assert data["effects"] is None
    assert ("8 cases ended without a verdict" in text) == (kind == "all failed")
    assert ("8 of 8 cases have not ended" in text) == (kind == "none ended")


def test_an_unknown_verdict_is_shown_as_it_is(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda c, e: replace(e, verdict="lane_left"))
    assert report_json(tmp_path)["systems"][-1]["counts"]["lane_left"] == 8
    assert "lane left" in make_report(tmp_path, plots=False).page.read_text()


def test_lane_keeping_has_numbers_of_its_own(tmp_path: Path) -> None:
    def change(case, end):
        left = case.variation.weather == "heavy_fog"
        own = {"distance_m": 40.0 if left else 100.0, "lateral_error_max_m": 0.125}
        own["lateral_error_rms_m"] = 0.302 if left else 0.062
        verdict = "lane_departure" if left else "pass"
        return replace(end, verdict=verdict, scalars={**end.scalars, **own})

    data = campaign_data(scenario={"type": "lane_keeping", "distance_m": 100, "duration_s": 20})
    make_campaign(tmp_path, data, change)
    page = make_report(tmp_path, plots=False).page.read_text()
    text = without_scripts(page)
    assert "drove the whole distance" in text
    assert "AutoDRIVE paper" not in text
    assert "lane departure</span> <b>4</b>" in text
    assert "0.062 / 0.182 / 0.302" in text  # least, median and most of all decided cases
    assert "Closest approach" not in text
    assert "AEB TTC" not in text
    assert '<td class="n" data-sort="0.302">0.302</td>' in text
    assert page_data(page)["curves"][0] == "lateral_error_m"
    assert page_data(page)["all"]["number"] == ["0.06", "0.06", "0.30", "0.30"] * 2
    total = report_json(tmp_path)["systems"][-1]
    assert total["lateral_rms_m"] == pytest.approx((0.062, 0.182, 0.302))
    assert total["counts"]["lane_departure"] == 4


def test_a_jump_scare_shows_nothing_of_lanes(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    page = page_of(tmp_path)
    assert "Lateral error" not in without_scripts(page)
    assert "lateral_error_m" not in page_data(page)["curves"]
    assert report_json(tmp_path)["systems"][-1]["lateral_rms_m"] is None


def test_an_incomplete_campaign_says_so(tmp_path: Path) -> None:
    def change(case, end):
        if case.variation.weather == "clear":
            return end
        return msgspec.convert({"outcome": ""}, type(end))

    make_campaign(tmp_path, change=change)
    page = without_scripts(page_of(tmp_path))
    assert "Incomplete: 4 of 8 cases have not ended" in page
    assert "of 8 cases passed so far" in page
    assert page.count("at least ") == 3  # a rate per system under test and of all
    assert page.count("Findings so far") == 1
    # Intervals are of the cases that have ended: one system passed 2 of 2, the other one too.
    assert page.count("34.2 to 100.0 %") == 2
    found = report_json(tmp_path)
    assert found["fingerprint"] is None
    assert found["alarms"] == []
    assert found["not_ended"] == 4
    (tmp_path / "conductor.json").write_text("{}")
    assert "Still running: 4 of 8" in without_scripts(page_of(tmp_path))


def test_missing_numbers_are_dashes_and_gaps(tmp_path: Path) -> None:
    only = "yolov3-0500-clear"
    make_campaign(tmp_path, change=lambda c, e: e if c.id == only else replace(e, scalars={}))
    page = make_report(tmp_path, plots=False).page.read_text()
    rows = re.findall(r"<tr data-case=.*?</tr>", page, re.S)
    assert len(rows) == 8
    head = page.split('<table id="cases">')[1].split("</thead>")[0]
    numbers = head.count('class="n"')
    assert numbers > 3
    bare = [row for row in rows if only not in row]
    assert [row.count('data-sort="">–') for row in bare] == [numbers] * 7


@pytest.mark.parametrize("damage", ["corrupt", "missing", "other values", "outside"])
def test_a_damaged_kpi_file_raises_the_alarm(tmp_path: Path, damage: str) -> None:
    name = "yolov3-0500-clear"
    wrong = {"other values": {"kpi_sha256": "a" * 64}, "outside": {"attempt_dir": "../elsewhere"}}

    def change(case, end):
        return replace(end, **wrong.get(damage, {})) if case.id == name else end

    make_campaign(tmp_path, change=change)
    path = tmp_path / "cases" / name / "attempt-1" / "kpi.parquet"
    if damage == "corrupt":
        path.write_bytes(b"PAR1 not really")
    if damage == "missing":
        path.unlink()
    page = page_of(tmp_path)
    assert 'class="box alarm"' in page
    assert [c["id"] for c in page_data(page)["cases"] if c["time_s"] is None] == [name]
    found = report_json(tmp_path)
    assert len(found["alarms"]) == 1
    assert name in found["alarms"][0]
    assert found["fingerprint"] is None


def test_disagreeing_attempts_raise_the_alarm(tmp_path: Path) -> None:
    def change(case, end):
        late = Late(
            token=9,
            worker="w2",
            outcome="verdict",
            verdict="collision",
            kpi_sha256="b" * 64,
            attempt_dir="cases/x/attempt-2",
            agrees=case.id != "yolov3-0500-clear",
        )
        return replace(end, late=[late])

    make_campaign(tmp_path, change=change)
    found = report_json(tmp_path)
    assert (found["audits"], found["disagreements"]) == (8, 1)
    assert "two attempts of this case disagree" in found["alarms"][0]
    page = without_scripts(page_of(tmp_path))
    assert "Do not trust these results yet: 1 alarm<" in page


def test_a_finished_folder_of_an_older_version_is_read_without_alarm(tmp_path: Path) -> None:
    """Its digest was taken over other things, so it says nothing about the file."""
    make_campaign(tmp_path)
    path = tmp_path / "outcomes.json"
    old = json.loads(path.read_text())
    del old["digests"]
    path.write_text(json.dumps({**old, "digest": "0" * 64}))
    assert report_json(tmp_path)["alarms"] == []


def test_a_changed_campaign_file_raises_the_alarm(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    path = tmp_path / "campaign.yaml"
    path.write_text(path.read_text().replace("seed: 7", "seed: 8"))
    assert "digest" in report_json(tmp_path)["alarms"][0]


def test_noop_is_refused(tmp_path: Path) -> None:
    make_campaign(tmp_path, campaign_data(simulator="noop"))
    with pytest.raises(UsageError, match="noop"):
        make_report(tmp_path, plots=False)
    with pytest.raises(UsageError, match="noop"):
        report_json(tmp_path)


@pytest.mark.parametrize(
    ("matrix", "x", "y", "per"),
    [
        ({"model": ["yolov3"], "repeat": [0, 1]}, "repeat", "time_of_day", ""),
        ({"model": ["yolov3", "yolov2-tiny"]}, "model", "time_of_day", ""),
        (
            {
                "model": ["yolov3", "yolov2-tiny"],
                "scenario.ego_start_m": [40, 50, 60],
                "weather": ["clear", "cloudy"],
            },
            "scenario.ego_start_m",
            "weather",
            "model",
        ),
    ],
)
def test_heat_maps_fall_back_to_other_axes(
    tmp_path: Path, matrix: dict[str, Any], x: str, y: str, per: str
) -> None:
    make_campaign(tmp_path, campaign_data(matrix=matrix))
    data = page_data(page_of(tmp_path))
    assert data["heat"] == {"x": x, "y": y, "per": per}
    assert {x, y} <= set(data["all"]["axes"])
    for axis in data["all"]["axes"].values():
        assert len(axis["of"]) == len(data["all"]["ids"])
        assert set(axis["of"]) == set(range(len(axis["values"])))


def test_a_cell_of_several_cases_shows_the_worst(tmp_path: Path) -> None:
    data = campaign_data(
        matrix={"model": ["yolov3"], "weather": ["clear", "cloudy"], "repeat": [0, 1]}
    )

    def change(case, end):
        if case.variation.repeat or case.variation.weather == "cloudy":
            return end
        return replace(end, verdict="collision")

    make_campaign(tmp_path, data, change)
    dossier = open_dossier(tmp_path)
    (clear, cloudy) = cells_of(dossier, dossier.rows, "model", "weather").rows
    assert (worst(clear[0]).status, cell_number(clear[0])) == ("collision", "1/2")
    assert (worst(cloudy[0]).status, cell_number(cloudy[0])) == ("pass", "2/2")
    severity = page_data(page_of(tmp_path))["all"]["severity"]
    assert severity[0] == min(severity) < severity[1]


def test_a_huge_campaign_shows_its_worst_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(content, "CASES_MAX", 3)
    make_campaign(
        tmp_path,
        change=lambda c, e: (
            replace(e, verdict="collision")
            if c.id == "yolov2-tiny-1300-heavy_fog"
            else replace(e, verdict="pass")
        ),
    )
    page = make_report(tmp_path, plots=False).page.read_text()
    shown = [c["id"] for c in page_data(page)["cases"]]
    assert len(shown) == 3
    assert "yolov2-tiny-1300-heavy_fog" in shown
    assert "3 of 8 cases are shown" in without_scripts(page)
    assert len(report_json(tmp_path)["cases"]) == 8
