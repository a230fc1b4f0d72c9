"""The console's page in numbers: exact limits of its targets, and made-up data that are as real
ones."""

from __future__ import annotations

import json

import pytest
from unit.viewer.console.console_runs import a_run

from viewer.bench.console_site import VERDICTS, made_case, write_site
from viewer.bench.in_browser import lines, misses
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite


def figures(**more):
    found = {
        "cases": 10_240,
        "paint_ms": 1500.0,
        "memory_mb": 400.0,
        "heap_mb": 9.0,
        "longest_task_ms": {"sort": 100.0},
        "longest_task_cpu_ms": {"sort": 7.0},
    }
    return {**found, **more}


def test_what_reaches_a_target_misses_none():
    assert misses(figures()) == []


@pytest.mark.parametrize(
    ("worse", "words"),
    [
        ({"paint_ms": 1500.6}, "page: drawn after 1501 ms, at most 1500"),
        ({"memory_mb": 400.6}, "page: 401 MB, at most 400"),
        ({"longest_task_ms": {"sort": 100.6}}, "page: sort: a task of 101 ms, at most 100"),
    ],
)
def test_each_target_that_is_missed_is_a_line(worse, words):
    assert misses(figures(**worse)) == [words]


def test_people_read_both_clocks():
    assert "sort 100 (7)" in lines(figures())[1]


def test_made_up_data_follow_from_their_number(tmp_path):
    for folder in ("one", "two"):
        write_site(tmp_path / folder, 70, dossiers=1)
    files = sorted(path for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert len(files) > 150
    for path in files:
        other = tmp_path / "two" / path.relative_to(tmp_path / "one")
        assert path.read_bytes() == other.read_bytes(), path.name
    assert {made_case(index).verdict for index in range(640)} == {v["name"] for v in VERDICTS}


def test_made_up_data_have_the_form_of_real_ones(tmp_path):
    """What the page is tested with says nothing that the server would not say."""
    real = ConsoleSite(find_runs(a_run(tmp_path / "demo")), keep=False)
    write_site(tmp_path / "made", 8, run="demo", static=False, dossiers=8)
    name = made_case(0).name

    def there(path):
        return json.loads(real.answer(path).data)

    def here(path):
        return json.loads((tmp_path / "made" / "data" / path).read_text())

    for path in (
        "runs.json",
        "runs/demo/run.json",
        "runs/demo/table.json",
        "runs/demo/workers.json",
    ):
        assert set(here(path)) <= set(there(path)), path
    assert set(here("runs.json")["runs"][0]) <= set(there("runs.json")["runs"][0])
    columns = there("runs/demo/run.json")["columns"]
    assert set(here("runs/demo/run.json")["columns"][0]) == set(columns[0])
    for page in ("case", "series"):
        made, given = (
            look(f"runs/demo/cases/{case}/{page}.json")
            for look, case in ((here, name), (there, "a-1300-clear"))
        )
        assert set(made) <= set(given), page
        for part in ("film", "links", "attempts", "log", "road"):
            if made.get(part) and given.get(part):
                assert set(made[part]) <= set(given[part]), part
    assert set(made["actors"][0]) | {"center"} >= set(given["actors"][0])
