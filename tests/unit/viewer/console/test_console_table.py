"""The table of all cases: what stands in its columns, and what changes."""

import math

import msgspec
import pytest
from unit.viewer.console.console_runs import ended

from viewer.console.case_page import neighbours
from viewer.console.run_folder import CaseEnding
from viewer.console.table import console_table, title_of, unit_of, verdict_words


def rows(*changes):
    return {f"c{i}": msgspec.convert(ended(**row), CaseEnding) for i, row in enumerate(changes)}


def axes(*values):
    return {
        f"c{i}": {"model": model, "weather": weather} for i, (model, weather) in enumerate(values)
    }


def test_missing_is_null_and_never_zero():
    endings = rows({}, {"scalars": {"dtc_min_m": math.inf, "impact_speed_mps": 3.0}})
    endings["c2"] = CaseEnding()
    table = console_table(endings, {}, frozenset({"c2"}))
    assert table.columns["state"] == ["ended", "ended", "running"]
    assert table.columns["verdict"] == ["pass", "pass", None]
    assert table.columns["dtc_min_m"] == [5.0, None, None]
    assert table.columns["impact_speed_mps"] == [None, 3.0, None]
    assert table.columns["wall_s"] == [2.0, 2.0, None], "only a committed attempt has one"
    assert table.columns["worker"] == ["w1", "w1", None]
    assert {head["name"] for head in table.heads} == set(table.columns)


def test_an_outcome_without_a_verdict_stands_in_its_place():
    table = console_table(rows({"outcome": "failed", "verdict": ""}), {})
    assert table.columns["verdict"] == ["failed"]
    assert {"failed", "unresolved", "cancelled", "pass"} <= {w["name"] for w in verdict_words()}
    assert not any(w["passes"] for w in verdict_words() if w["tone"] == "none")


def test_axes_stand_in_a_readers_order():
    table = console_table(
        rows({}, {}, {}), axes(("b", "heavy_fog"), ("a", "clear"), ("b", "clear"))
    )
    values = {axis["name"]: axis["values"] for axis in table.axes}
    assert values == {"model": ["b", "a"], "weather": ["clear", "heavy_fog"]}
    assert table.columns["weather"] == ["heavy_fog", "clear", "clear"]


def test_an_axis_never_hides_a_column_of_its_name():
    table = console_table(rows({}, {}), {"c0": {"verdict": 1}, "c1": {"verdict": 2}})
    assert table.columns["verdict"] == ["pass", "pass"]
    assert table.columns["axis.verdict"] == [1, 2]


def test_changes_are_cells():
    before = console_table(rows({}, {}), {})
    after = console_table(rows({}, {"verdict": "collision", "wall_s": 3.0}), {})
    assert after.changed_rows(before) == {"1": {"verdict": "collision", "wall_s": 3.0}}
    assert before.changed_rows(before) == {}
    longer = console_table(rows({}, {}, {}), {})
    assert set(longer.changed_rows(before)["2"]) >= {"state", "verdict"}


def test_neighbours_differ_on_one_axis():
    passed = {"state": "ended", "verdict": "pass"}
    waits = {"state": "waiting", "verdict": None}
    table = console_table(
        rows({"outcome": "verdict", "verdict": "pass"}, *[{"outcome": ""}] * 4),
        axes(
            ("a", "clear"), ("b", "clear"), ("a", "heavy_fog"), ("c", "clear"), ("c", "heavy_fog")
        ),
    )
    assert neighbours(table, 1) == {
        "model": {
            "before": {"case": "c0", "value": "a", "index": 0} | passed,
            "after": {"case": "c3", "value": "c", "index": 3} | waits,
        }
    }, "in heavy fog there is no b"
    before = neighbours(table, 2)["weather"]["before"]
    assert before == {"case": "c0", "value": "clear", "index": 0} | passed


@pytest.mark.parametrize(
    ("name", "title", "unit"),
    [
        ("scenario.ego_start_m", "Ego start", "m"),
        ("latency_ms", "Latency", "ms"),
        ("model", "Perception model", ""),
        ("nearest_ttc_s", "Nearest TTC", "s"),
        ("accel_mps2", "Accel", "m/s²"),
        ("storyboard.ego.speed_kmh", "Ego speed", "km/h"),
        ("_m", "_m", "m"),
    ],
)
def test_names_for_people(name, title, unit):
    assert (title_of(name), unit_of(name)) == (title, unit)
