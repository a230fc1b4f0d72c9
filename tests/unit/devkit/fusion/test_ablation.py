"""The table of what each sensor brings."""

from __future__ import annotations

from pathlib import Path

import pytest

from devkit.fusion.ablation import BEGIN, END, AblationCase, main, table, with_table

CASES = [
    AblationCase("camera", "clear", True, "pass", 5.0),
    AblationCase("camera", "clear", False, "false_braking", 40.0),
    AblationCase("camera", "heavy_fog", False, "collision", None),
    AblationCase("all", "clear", True, "pass", 6.0),
    AblationCase("all", "heavy_fog", True, "pass", 4.0),
]
PAGE = Path(__file__).parents[4] / "docs/ablation.md"


def test_cells_say_what_came_of_their_cases() -> None:
    assert table(CASES) == [
        "| weather | camera | all |",
        "|---|---|---|",
        "| clear | 1 of 2, 1 false braking, 22.5 m | 1 of 1, 6.0 m |",
        "| heavy fog | 0 of 1, 1 collision | 1 of 1, 4.0 m |",
        "| all | 1 of 3, 1 collision, 1 false braking, 22.5 m | 2 of 2, 5.0 m |",
    ]


def test_the_table_stands_between_the_markers_of_the_page() -> None:
    page = with_table(PAGE.read_text(), table(CASES))
    assert page.count(BEGIN) == page.count(END) == 1
    assert with_table(page, table(CASES)) == page
    with pytest.raises(ValueError, match="the page has no"):
        with_table("nothing", [])


def test_no_run_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path)])
    assert ended.value.code == 2
    assert "No such file" in capsys.readouterr().err
