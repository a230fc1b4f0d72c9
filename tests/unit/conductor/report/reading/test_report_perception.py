"""What perception cost, in the report: sums by model and runtime, and nothing where none is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of

from conductor.report import report_json
from conductor.report.reading.systems import perception_text
from schemas.messages import PerceptionCost
from schemas.plan import expand, parse_campaign


def change(case, end):
    """yolov3: 2 ms of 10 per frame; yolov2-tiny: two runtimes."""
    if case.variation.model == "yolov3":
        cost = PerceptionCost("opencv cpu", 100, 0.2)
        return msgspec.structs.replace(end, perception=cost, rig_wall_s=1.0)
    if case.variation.weather == "clear":
        cost = PerceptionCost("onnxruntime cuda", 50, 0.005)
        return msgspec.structs.replace(end, perception=cost, rig_wall_s=0.5)
    return msgspec.structs.replace(end, perception=PerceptionCost("opencv cpu", 0, 0.0))


def lines(folder: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(json.dumps(report_json(folder)["perception"]))
    return found


def test_costs_are_summed_by_model_and_runtime(tmp_path):
    make_campaign(tmp_path, change=change)
    keys = ("model", "runtime", "cases", "frames", "frame_ms", "rig_share")
    assert [tuple(line[key] for key in keys) for line in lines(tmp_path)] == [
        ("yolov3", "opencv cpu", 4, 400, pytest.approx(2.0), pytest.approx(0.16)),
        ("yolov2-tiny", "onnxruntime cuda", 2, 100, pytest.approx(0.1), pytest.approx(0.002)),
        ("yolov2-tiny", "opencv cpu", 2, 0, None, 0.0),
    ]
    page = page_of(tmp_path)
    table = page.split('id="perception-costs"')[1].split("</table>")[0]
    assert table.count("<tr>") == 4
    assert '<td class="n">400</td>' in table
    assert "16.0 %" in table


def test_stages_and_what_limited_the_sensors_are_shown(tmp_path):
    def told(case, end):
        limited = {"camera blind by fog": 3.0} if case.variation.weather == "clear" else {}
        cost = PerceptionCost("opencv cpu", 100, 0.2, {"<tracks>": 0.05}, limited)
        return msgspec.structs.replace(end, perception=cost, rig_wall_s=1.0)

    make_campaign(tmp_path, change=told)
    line = lines(tmp_path)[0]
    assert line["stages_ms"] == {"<tracks>": pytest.approx(0.5)}
    assert line["limited_s"] == {"camera blind by fog": pytest.approx(1.5)}
    page = page_of(tmp_path)
    assert "&lt;tracks&gt; 0.50" in page
    assert "camera blind by fog 1.50" in page


def test_a_stack_that_does_not_measure_has_no_table(tmp_path):
    make_campaign(tmp_path)
    assert lines(tmp_path) == []
    assert "perception-costs" not in page_of(tmp_path)


def test_a_network_is_named_with_its_file():
    network = {
        "type": "network",
        "model": "/far/away/a.onnx",
        "confidence_min": 0.3,
        "across_classes": True,
    }
    data = campaign_data(autonomy={"perception": {"yolov3": network}}, matrix={"repeat": [1]})
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    text = perception_text(expand(campaign)[0])
    assert text == "network, model a.onnx, confidence_min 0.3, across_classes"
