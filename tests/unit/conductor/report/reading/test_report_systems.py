"""What reports call the systems under test: nobody's stack is passed off as the shipped one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of

from conductor.report import report_json
from conductor.report.pages.result_page import write_result_page
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.systems import stack_name, system_names
from schemas.sections.foreign import Foreign


def campaign_of(autonomy: dict[str, Any], **matrix: list[str]) -> dict[str, Any]:
    return campaign_data(autonomy=autonomy, matrix={"weather": ["clear", "heavy_fog"], **matrix})


@pytest.mark.parametrize(
    ("autonomy", "name", "what"),
    [
        ({"stack": "my_module:Cautious"}, "my_module:Cautious", "own stack"),
        (
            {"command": ["python3", "-u", "scripts/opencav_aeb.py", "--fast"]},
            "opencav_aeb.py",
            "command python3 -u scripts/opencav_aeb.py --fast",
        ),
        ({"command": ["/opt/mystack/run", "--fast"]}, "run", "command /opt/mystack/run --fast"),
        ({}, "default", "ground_truth: the simulator's boxes, no network, contrast_min 0.05"),
    ],
)
def test_a_stack_is_called_by_its_own_name(
    tmp_path: Path, autonomy: dict[str, Any], name: str, what: str
) -> None:
    make_campaign(tmp_path, campaign_of(autonomy))
    first = report_json(tmp_path)["systems"][0]
    assert (first["model"], first["name"], first["perception"]) == ("default", name, what)
    page = page_of(tmp_path).partition('<script type="application/json"')[0]
    assert f"<b>{name}</b>" in page
    assert "stand-in" not in page
    if name != "default":
        assert "<td>default</td>" not in page
        assert "ground_truth" not in page
        assert "devkit.aeb:AebStack" not in page
        assert f"{name} passed 2 of 2 cases" in page
    text = write_result_page(tmp_path, tmp_path / "result.md").read_text()
    assert f"\n## {name.replace('_', chr(92) + '_')}\n" in text


def test_variants_of_a_stack_of_ones_own_are_told_apart(tmp_path: Path) -> None:
    variants = {name: {"type": "network", "model": f"{name}-w25"} for name in ("yolov2", "yolov3")}
    autonomy = {"stack": "my_module:Cautious", "perception": variants}
    make_campaign(tmp_path, campaign_of(autonomy, model=list(variants)))
    assert system_names(open_dossier(tmp_path)) == {
        "yolov2": "my_module:Cautious, yolov2",
        "yolov3": "my_module:Cautious, yolov3",
    }
    first = report_json(tmp_path)["systems"][0]
    assert first["perception"] == "own stack; it is offered network, model yolov2-w25"


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["./build/stack"], "stack"),
        (["python", "-m", "my.stack"], "my.stack"),
        (["/usr/bin/env", "python3", "a.py"], "a.py"),
        (["python3.12", "a/b.py"], "b.py"),
        (["bash"], "bash"),
    ],
)
def test_a_command_is_called_by_its_script(words: list[str], name: str) -> None:
    assert stack_name("", Foreign(command=words)) == name
