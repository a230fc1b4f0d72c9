"""The result page: what it says, what it shows, and that nothing written into it is lost."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import msgspec
import pytest
from search_bench import KPI, searched, section, trace
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.records.fingerprint import fingerprint
from conductor.report import write_result_page
from conductor.report.analysis.losses import EXAMPLES_MAX, examples, extremes, kind_of, lost_lines
from conductor.report.analysis.statistics import wilson
from conductor.report.pages.prose import block
from conductor.report.pages.result_page import escaped, fenced
from conductor.report.pages.tables import KNOWN_STATUSES
from conductor.report.plots.heat_picture import _MARKS
from conductor.report.plots.palette import status_color
from conductor.report.reading.dossier import open_dossier
from schemas.files.assets import file_digest
from schemas.files.search_result import FILE_NAME, SearchFile
from schemas.kinds.scenario import passing_words
from schemas.messages import PerceptionCost
from twin.base.errors import UsageError
from twin.base.software import software_digest

replace = msgspec.structs.replace
HOSTILE = "a | b\n# c <img src=x> [d](e) `f` *g* <!-- end of text summary -->"


def collided(case: Any, end: Any) -> Any:
    scalars = {**end.scalars, "impact_speed_mps": 5.0, "aeb_time_s": None, "aeb_dtc_m": None}
    return replace(end, verdict="collision", scalars=scalars)


def passed(case: Any, end: Any) -> Any:
    scalars = {**end.scalars, "impact_speed_mps": None}
    return replace(end, verdict="pass", scalars=scalars)


def tables(page: str) -> list[list[list[str]]]:
    """The page's tables as cells; a bar that is escaped is none."""
    found = []
    for part in re.findall(r"(?:^\|.*\n)+", page, re.M):
        lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in part.splitlines()]
        found.append([[cell.strip() for cell in line] for line in lines])
    return found


def table(page: str, first: str) -> list[list[str]]:
    return next(t for t in tables(page) if t[0][0] == first)


def test_the_page_tells_the_result(tmp_path: Path) -> None:
    run, page = tmp_path / "run", tmp_path / "docs" / "a.md"
    _, outcomes = make_campaign(run)
    assert write_result_page(run, page) == page
    text = page.read_text()
    assert fingerprint(run).sha256 in text
    assert outcomes.digest in text
    assert outcomes.software in text
    assert "contrast_min: 0.16" in text  # thresholds as they were run
    lines = {line[0]: line for line in table(text, "model")[2:]}
    total = sum(end.passed for end in outcomes.cases.values())
    assert lines["All"][2] == "8"
    assert lines["All"][3].startswith(f"{total} (")
    own = [end for name, end in outcomes.cases.items() if name.startswith("yolov2-tiny")]
    hits = sum(end.passed for end in own)
    low, high = (100 * share for share in wilson(hits, 4))
    assert lines["yolov2-tiny"][3] == f"{hits} ({25.0 * hits:.1f} %, {low:.1f} to {high:.1f})"
    for one in tables(text):
        assert len({len(line) for line in one}) == 1, one
    for target in re.findall(r"\]\((a/[^)]+)\)", text):
        assert (page.parent / target).is_file(), target
    assert (page.parent / "a" / "campaign.yaml").read_bytes() == (
        run / "campaign.yaml"
    ).read_bytes()
    write_result_page(run, page)
    assert page.read_text() == text


def test_the_heat_map_shows_every_cell(tmp_path: Path) -> None:
    make_campaign(
        tmp_path / "run",
        change=lambda c, e: collided(c, e) if c.variation.weather == "heavy_fog" else passed(c, e),
    )
    write_result_page(tmp_path / "run", tmp_path / "a.md")
    picture = cv2.imread(str(tmp_path / "a" / "heat.png"))
    counts = []
    for status in ("pass", "collision"):
        red, green, blue = bytes.fromhex(status_color(status)[1:])
        mask = (picture == (blue, green, red)).all(axis=-1).astype("uint8")
        _, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        counts.append(int((stats[1:, cv2.CC_STAT_AREA] > 800).sum()))
    assert counts == [4, 4]  # two models, two hours


def test_a_search_has_its_answer_its_clusters_and_a_plot(tmp_path: Path) -> None:
    data = campaign_data()
    data["matrix"] = {"model": ["yolov3"], "time_of_day": ["05:00", "07:00", "09:00"]}
    make_campaign(tmp_path / "run", data, collided)
    search = section(objective={"kpi": KPI, "fails_below": 0.8}, budget={"cases": 30})
    found = msgspec.json.decode(trace(searched(search).state), type=SearchFile)
    (tmp_path / "run" / FILE_NAME).write_bytes(msgspec.json.encode(found))
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert found.answer is not None
    assert f"A case fails if {escaped(KPI)} is below 0.8 m." in text
    assert f"{found.answer.failures} of 30" in text
    lines = table(text, "mildest")[2:]
    assert [line[0] for line in lines] == [cluster.mildest for cluster in found.clusters]
    assert sum(int(line[1]) for line in lines) == found.answer.failures
    assert cv2.imread(str(tmp_path / "a" / "search.png")).shape[1] > 500
    assert text.count("(a/search.png)") == 1
    (tmp_path / "run" / FILE_NAME).unlink()
    assert "## Search" not in write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert not (tmp_path / "a" / "search.png").exists(), "an earlier page's"


def test_a_map_of_one_cell_is_left_out(tmp_path: Path) -> None:
    data = campaign_data()
    data["matrix"] = {"model": ["yolov3", "yolov2-tiny"]}
    make_campaign(tmp_path / "run", data, collided)
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert "heat.png" not in text
    assert "Cells that it loses" not in text
    assert text.count("**collision without AEB**") == 2
    assert not (tmp_path / "a" / "heat.png").exists()


def test_all_passed(tmp_path: Path) -> None:
    make_campaign(tmp_path / "run", change=passed)
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert text.count("It loses no cell.") == 2
    assert "No case braked falsely." in text
    assert "Hardest impacts" not in text
    assert "(100.0 %, 67.6 to 100.0)" in text


def test_all_lost_shows_kinds_in_turn_and_names_every_cell(tmp_path: Path) -> None:
    def change(case: Any, end: Any) -> Any:
        if case.variation.time_of_day_min == 300:
            return replace(end, verdict="false_braking")
        return collided(case, end)

    hours = ["05:00", "07:00", "09:00", "13:00"]
    data = campaign_data()
    data["matrix"]["time_of_day"] = hours
    make_campaign(tmp_path / "run", data, change)
    dossier = open_dossier(tmp_path / "run")
    own = [row for row in dossier.rows if row.case.variation.model == "yolov3"]
    assert [line.cells for line in lost_lines(dossier, own)] == [
        {"false_braking": ["05:00"], "collision": hours[1:]}
    ] * 2
    shown = examples(dossier, own)
    assert len(shown) == EXAMPLES_MAX
    kinds = [kind_of(row) for row in shown]
    assert kinds[:4] == ["collision without AEB", "false braking"] * 2
    assert [row.case.variation.weather for row in shown[::2]][:2] == ["clear", "heavy_fog"]
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert text.count("(No picture: the case was not recorded.)") == 2 * EXAMPLES_MAX
    assert table(text, "Time of day \\[HH:MM\\]")[2] == ["05:00", "2 of 2", "2 of 2"]
    hardest = extremes(dossier.rows, "impact_speed_mps", largest=True)
    assert [row.case.id for row in hardest] == [
        row.case.id for row in dossier.rows if row.status == "collision"
    ][:5]


def test_cases_that_have_not_ended_are_no_losses_and_no_passes(tmp_path: Path) -> None:
    def change(case: Any, end: Any) -> Any:
        return msgspec.convert({"outcome": ""}, type(end))

    make_campaign(tmp_path / "run", change=change)
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert "Incomplete: 8 of 8 cases have not ended" in text
    assert text.count("It loses no cell.") == 0
    assert text.count("No case of it has ended.") == 2
    assert "| 0 (0.0 %, 0.0 to 49.0) |" in text


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    def change(case: Any, end: Any) -> Any:
        return replace(end, outcome="failed", verdict="", reasons=[HOSTILE])

    make_campaign(tmp_path / "run", campaign_data(description=HOSTILE), change)
    text = write_result_page(tmp_path / "run", tmp_path / "a.md").read_text()
    assert "<img" not in re.sub(r"\\<img", "", text)
    assert "](e)" not in re.sub(r"\\\]\(e\)", "", text)
    assert "\n# c" not in text
    for one in tables(text):
        assert len({len(line) for line in one}) == 1, one
    assert write_result_page(tmp_path / "run", tmp_path / "a.md").read_text() == text


def test_escaping() -> None:
    assert escaped("a_b *c*\n<d>|") == "a\\_b \\*c\\* \\<d\\>\\|"
    assert fenced("x", "yaml") == "```yaml\nx\n```"
    assert fenced("```\nx", "") == "````\n```\nx\n````"


def test_what_people_wrote_stays(tmp_path: Path) -> None:
    run, page = tmp_path / "run", tmp_path / "a.md"
    make_campaign(run)
    text = write_result_page(run, page).read_text()
    said = "It sees **little** in fog.\n\n| a | b |\n| --- | --- |\n\nTwo paragraphs."
    said += "\n\n```\na\n\n\n\nb\n```"
    empty = block("model yolov3", "")
    assert text.count(empty) == 1
    page.write_text(text.replace(empty, block("model yolov3", said)))
    make_campaign(run, change=collided)
    again = write_result_page(run, page).read_text()
    assert again.count(said) == 1
    assert block("model yolov3", said) in again
    assert again.replace(said, "") != text.replace(said, "")  # the numbers are the new ones


def test_nothing_is_overwritten_that_is_not_ours(tmp_path: Path) -> None:
    run, page = tmp_path / "run", tmp_path / "a.md"
    make_campaign(run)
    page.write_text("# My notes\n")
    with pytest.raises(UsageError, match="was not made by this command"):
        write_result_page(run, page)
    assert page.read_text() == "# My notes\n"
    page.unlink()
    text = write_result_page(run, page).read_text()
    damaged = text.replace("<!-- end of text model yolov3 -->", "")
    page.write_text(damaged)
    with pytest.raises(UsageError, match=r"line [0-9]+: the text 'model yolov3' has no line"):
        write_result_page(run, page)
    assert page.read_text() == damaged
    foreign = text.replace(block("model yolov3", ""), block("model yolov9", "Dear reader"))
    page.write_text(foreign)
    with pytest.raises(UsageError, match="'model yolov9', and this campaign has no place"):
        write_result_page(run, page)
    assert page.read_text() == foreign
    with pytest.raises(UsageError, match=r"ends in \.md"):
        write_result_page(run, tmp_path / "a.txt")


def test_lane_keeping_tells_of_lanes(tmp_path: Path) -> None:
    def change(case: Any, end: Any) -> Any:
        left = case.variation.weather == "heavy_fog"
        own = {"distance_m": 40.0 if left else 100.0, "lateral_error_max_m": 0.8 if left else 0.125}
        own["lateral_error_rms_m"] = 0.302 if left else 0.062
        verdict = "lane_departure" if left else "pass"
        scalars = {**end.scalars, **own, "impact_speed_mps": None}
        return replace(end, verdict=verdict, scalars=scalars, reasons=["drove on"])

    scenario = {"type": "lane_keeping", "distance_m": 100, "lateral_limit_m": 0.7}
    make_campaign(tmp_path / "run", campaign_data(scenario=scenario), change)
    text = _page(tmp_path)
    assert "drove the whole 100 m along its lane, its rear axle at most 0.7 m from" in text
    for wrong in ("AutoDRIVE paper", "obstacle", "braked falsely", "stop [m]", "Nearest stops"):
        assert wrong not in text, wrong
    assert "A number is the lateral error RMS [m], of a collision" in text
    lines = {line[0]: line for line in table(text, "model")[2:]}
    assert lines["All"][-1] == "0.062, 0.182, 0.302"
    assert ["heavy fog", "2 of 2", "2 of 2"] in table(text, "Weather")
    assert "No case came to rest on the free lane." in text
    farthest = table(text[text.index("Farthest from the lane") :], "case")
    assert farthest[2][1:] == ["lane departure", "0.800", "0.302", "40.00"]


def test_every_verdict_that_is_no_pass_has_a_mark_in_the_map() -> None:
    known = {*KNOWN_STATUSES[: KNOWN_STATUSES.index("cancelled")]}
    assert known == {*passing_words(), *_MARKS}


def test_a_name_with_a_blank_can_be_run_and_followed(tmp_path: Path) -> None:
    make_campaign(tmp_path / "run", change=passed)
    text = write_result_page(tmp_path / "run", tmp_path / "lane page (1).md").read_text()
    command = next(line for line in text.splitlines() if line.startswith("conductor run"))
    assert shlex.split(command)[2] == "lane page (1)/campaign.yaml"
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(links) == text.count("](") >= 2
    for link in links:
        assert (tmp_path / unquote(link)).is_file(), link


def test_files_and_shipped_models_are_named_with_their_digests(tmp_path: Path) -> None:
    data = campaign_data(files={"/home/someone/net.onnx": "a" * 64, "scenes/mine.yaml": "b" * 64})
    data["autonomy"]["perception"] = {
        "yolov3": {"type": "network", "model": "yolov3-w25"},
        "yolov2-tiny": {"type": "network", "model": "/home/someone/net.onnx"},
    }
    make_campaign(tmp_path / "run", data)
    path = tmp_path / "run" / "outcomes.json"
    path.write_text(path.read_text().replace("5" * 64, software_digest()))
    rows = {row[0]: row[1] for row in table(_page(tmp_path), "")}
    assert rows["net.onnx"] == f"`{'a' * 64}`"
    assert rows["scenes/mine.yaml"] == f"`{'b' * 64}`"
    listed = [sys.executable, "-m", "devkit", "models", "--output", "json"]
    shipped = json.loads(subprocess.run(listed, capture_output=True, check=True).stdout)
    expected = {name: file_digest(Path(shipped[name])) for name in shipped if name == "yolov3-w25"}
    assert {k: v for k, v in rows.items() if k.startswith("model ")} == {
        f"model {name}": f"`{digest}`" for name, digest in expected.items()
    }


def test_what_perception_cost_is_told(tmp_path: Path) -> None:
    def change(case: Any, end: Any) -> Any:
        cost = PerceptionCost(runtime="opencv, 1 thread", frames=50, wall_s=0.8)
        return replace(end, perception=cost, rig_wall_s=4.0)

    make_campaign(tmp_path / "run", change=change)
    cost = next(t for t in tables(_page(tmp_path)) if "per frame \\[ms\\]" in t[0])
    assert cost[2] == ["yolov3", "opencv, 1 thread", "4", "200", "16.00", "10.0"]


def _page(folder: Path) -> str:
    return write_result_page(folder / "run", folder / "a.md").read_text()
