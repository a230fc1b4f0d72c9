"""``report.html`` and ``report_json``: what they say, and what they do not hide."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.report.synthetic_campaign import campaign_data, make_campaign

from conductor.fingerprint import fingerprint
from conductor.outcomes import Late
from conductor.report import content, report_json, write_report
from twin.fabric.errors import UsageError

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
    path = write_report(tmp_path)
    assert path == tmp_path / "report.html"
    assert (tmp_path / "summary.parquet").exists()
    page = path.read_text()
    text = without_scripts(page)
    found = report_json(tmp_path)
    assert f"<strong>{found['passed']}</strong> of 8 cases passed" in text
    assert "yolov3</b>" in text
    assert "ground_truth stand-in, contrast_min 0.05" in text
    assert fingerprint(tmp_path).sha256 in text
    assert 'id="alarms"' not in text
    assert 'id="incomplete"' not in text
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)
    data = page_data(page)
    assert len(data["cases"]) == 8
    assert [m["title"] for m in data["heat"]] == ["yolov3", "yolov2-tiny"]
    assert {m["data"][0]["type"] for m in data["heat"]} == {"heatmap"}
    assert data["groups"][0]["axis"] == "weather"


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
    page = write_report(tmp_path).read_text()
    assert "Steered by hand</dt><dd>1 attempt, without a verdict" in page
    assert "attempt 1: 3 changes &lt;b&gt;" in page
    make_campaign(tmp_path / "untouched")
    assert "Steered by hand" not in write_report(tmp_path / "untouched").read_text()


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    def change(case, end):
        return replace(end, outcome="failed", verdict=HOSTILE, reasons=[HOSTILE], worker=HOSTILE)

    make_campaign(tmp_path, campaign_data(description=HOSTILE), change)
    page = write_report(tmp_path).read_text()
    assert "alert(1)" in page
    for mark in ("<script>alert", "<img src=x", "</SCRIPT>"):
        assert mark not in page
    hover = page_data(page)["heat"][0]["data"][0]["hovertext"][0][0]
    assert "<script" not in hover
    assert "&lt;script&gt;" in hover


def test_an_unknown_verdict_is_shown_as_it_is(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda c, e: replace(e, verdict="lane_left", passed=False))
    assert report_json(tmp_path)["systems"][-1]["counts"]["lane_left"] == 8
    assert "lane left" in write_report(tmp_path).read_text()


def test_lane_keeping_has_numbers_of_its_own(tmp_path: Path) -> None:
    def change(case, end):
        left = case.weather == "heavy_fog"
        own = {"distance_m": 40.0 if left else 100.0, "lateral_error_max_m": 0.125}
        own["lateral_error_rms_m"] = 0.302 if left else 0.062
        verdict = "lane_departure" if left else "pass"
        return replace(end, verdict=verdict, passed=not left, scalars={**end.scalars, **own})

    data = campaign_data(scenario={"type": "lane_keeping", "distance_m": 100, "duration_s": 20})
    make_campaign(tmp_path, data, change)
    page = write_report(tmp_path).read_text()
    text = without_scripts(page)
    assert "drove the whole distance" in text
    assert "did not collide" not in text
    assert "lane departure</span> <b>4</b>" in text
    assert "0.062 / 0.182 / 0.302" in text  # least, median and most of all decided cases
    assert "Closest approach" not in text
    assert "AEB TTC" not in text
    assert '<td class="n" data-sort="0.302">0.302</td>' in text
    assert page_data(page)["curves"][0] == "lateral_error_m"
    assert page_data(page)["heat"][0]["data"][0]["text"][0] == ["✓ 0.06", "✓ 0.06"]
    total = report_json(tmp_path)["systems"][-1]
    assert total["lateral_rms_m"] == pytest.approx((0.062, 0.182, 0.302))
    assert total["counts"]["lane_departure"] == 4


def test_a_jump_scare_shows_nothing_of_lanes(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    page = write_report(tmp_path).read_text()
    assert "Lateral error" not in without_scripts(page)
    assert "lateral_error_m" not in page_data(page)["curves"]
    assert report_json(tmp_path)["systems"][-1]["lateral_rms_m"] is None


def test_an_incomplete_campaign_says_so(tmp_path: Path) -> None:
    def change(case, end):
        if case.weather == "clear":
            return end
        return msgspec.convert({"outcome": ""}, type(end))

    make_campaign(tmp_path, change=change)
    page = without_scripts(write_report(tmp_path).read_text())
    assert "Incomplete: 4 of 8 cases have not ended" in page
    assert "of 8 cases passed so far" in page
    assert page.count("at least ") == 3  # a rate per system under test and of all
    found = report_json(tmp_path)
    assert found["fingerprint"] is None
    assert found["alarms"] == []
    assert found["not_ended"] == 4
    (tmp_path / "conductor.json").write_text("{}")
    assert "Still running: 4 of 8" in without_scripts(write_report(tmp_path).read_text())


def test_missing_numbers_are_dashes_and_gaps(tmp_path: Path) -> None:
    make_campaign(tmp_path, change=lambda c, e: replace(e, scalars={}))
    page = write_report(tmp_path).read_text()
    rows = re.findall(r"<tr data-case=.*?</tr>", page, re.S)
    assert len(rows) == 8
    assert all(row.count('data-sort="">–') == 8 for row in rows)


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
    page = write_report(tmp_path).read_text()
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
    page = without_scripts(write_report(tmp_path).read_text())
    assert "Do not trust these results yet: 1 alarm<" in page


def test_a_changed_campaign_file_raises_the_alarm(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    path = tmp_path / "campaign.yaml"
    path.write_text(path.read_text().replace("seed: 7", "seed: 8"))
    assert "digest" in report_json(tmp_path)["alarms"][0]


def test_noop_is_refused(tmp_path: Path) -> None:
    make_campaign(tmp_path, campaign_data(simulator="noop"))
    with pytest.raises(UsageError, match="noop"):
        write_report(tmp_path)
    with pytest.raises(UsageError, match="noop"):
        report_json(tmp_path)


@pytest.mark.parametrize(
    ("matrix", "titles", "axes"),
    [
        ({"model": ["yolov3"], "repeat": [0, 1]}, ["yolov3"], ("Repeat", "Time of day [HH:MM]")),
        ({"model": ["yolov3", "yolov2-tiny"]}, ["All models"], ("Perception model", "Time of")),
        (
            {
                "model": ["yolov3"],
                "scenario.ego_start_m": [40, 50, 60],
                "weather": ["clear", "cloudy"],
            },
            ["yolov3"],
            ("Ego start [m]", "Weather"),
        ),
    ],
)
def test_heat_maps_fall_back_to_other_axes(
    tmp_path: Path, matrix: dict[str, Any], titles: list[str], axes: tuple[str, str]
) -> None:
    make_campaign(tmp_path, campaign_data(matrix=matrix))
    heat = page_data(write_report(tmp_path).read_text())["heat"]
    assert [m["title"] for m in heat] == titles
    layout = heat[0]["layout"]
    assert layout["xaxis"]["title"]["text"].startswith(axes[0])
    assert layout["yaxis"]["title"]["text"].startswith(axes[1])


def test_a_cell_of_several_cases_shows_the_worst(tmp_path: Path) -> None:
    data = campaign_data(
        matrix={"model": ["yolov3"], "weather": ["clear", "cloudy"], "repeat": [0, 1]}
    )
    data["matrix"]["time_of_day"] = ["05:00", "13:00"]

    def change(case, end):
        if case.repeat or case.weather == "cloudy":
            return end
        return replace(end, verdict="collision", passed=False)

    make_campaign(tmp_path, data, change)
    heat = page_data(write_report(tmp_path).read_text())["heat"][0]["data"][0]
    assert heat["text"] == [["✕ 1/2", "✕ 1/2"], ["✓ 2/2", "✓ 2/2"]]


def test_a_huge_campaign_shows_its_worst_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(content, "CASES_MAX", 3)
    make_campaign(
        tmp_path,
        change=lambda c, e: (
            replace(e, verdict="collision", passed=False)
            if c.id == "yolov2-tiny-1300-heavy_fog"
            else replace(e, verdict="pass", passed=True)
        ),
    )
    page = write_report(tmp_path).read_text()
    shown = [c["id"] for c in page_data(page)["cases"]]
    assert len(shown) == 3
    assert "yolov2-tiny-1300-heavy_fog" in shown
    assert "3 of 8 cases are shown" in without_scripts(page)
    assert len(report_json(tmp_path)["cases"]) == 8
