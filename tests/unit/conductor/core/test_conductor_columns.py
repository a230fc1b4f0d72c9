"""Cases as columns, the backlog's lanes, and the histogram of durations."""

from __future__ import annotations

import random

import msgspec
import pytest

from conductor.core.backlog import LOOK_MAX, Backlog
from conductor.core.case_table import CaseTable, pack, unpack
from conductor.core.durations import BUCKET_MAX, Durations
from schemas.case import Case
from schemas.plan import parse_plan
from schemas.sections.fork import Fork


def _cases(**fields: object) -> list[Case]:
    plan, mistakes = parse_plan({"campaign": "c", **fields})
    assert plan is not None, mistakes
    return plan.cases


def test_a_table_written_before_a_field_existed():
    """Journals of an older version: what it did not know has its default."""
    cases = _cases(matrix={"repeat": [0, 1]})
    table = pack(cases)
    columns = {name: column for name, column in table.columns.items() if name != "sensors"}
    assert unpack(CaseTable(table.count, columns)) == cases
    without_seed = {name: column for name, column in columns.items() if name != "seed"}
    with pytest.raises(KeyError, match="seed"):
        unpack(CaseTable(table.count, without_seed))


@pytest.mark.parametrize(
    "fields",
    [
        {"matrix": {"repeat": [0]}},
        {"matrix": {"repeat": list(range(50))}, "batch": {"size": 7}},
        {
            "matrix": {
                "scenario.ego_speed_mps": [1.0, 2.5],
                "camera.noise": [True, False],
                "weather": ["clear", "heavy_fog"],
                "model": ["a", "b"],
            },
            "autonomy": {
                "perception": {
                    "a": {"type": "ground_truth"},
                    "b": {"type": "ground_truth", "contrast_min": 0.5},
                },
                "parameters": {"one": 1, "two": 2.0, "three": True, "four": "x"},
            },
        },
    ],
)
def test_a_table_gives_the_same_cases_back(fields: dict[str, object]) -> None:
    cases = _cases(**fields)
    table = pack(cases)
    data = msgspec.msgpack.encode(table)
    back = unpack(msgspec.msgpack.decode(data, type=CaseTable))
    assert back == cases
    assert msgspec.json.encode(back) == msgspec.json.encode(cases)


def test_equal_sections_are_kept_once() -> None:
    cases = unpack(pack(_cases(matrix={"repeat": list(range(100))})))
    assert len({id(case.variation.scenario) for case in cases}) == 1
    assert len(msgspec.msgpack.encode(pack(cases))) < 100 * 40


def test_a_table_of_another_length_is_refused() -> None:
    table = pack(_cases(matrix={"repeat": [0, 1, 2]}))
    with pytest.raises(AssertionError, match="column id: 3 of 4 cases"):
        unpack(msgspec.structs.replace(table, count=4))


def test_the_backlog_against_a_set() -> None:
    rng = random.Random(3)
    backlog = Backlog()
    waiting: set[tuple[int, int, str]] = set()
    for _ in range(5000):
        entry = (rng.randrange(300), rng.choice([-1, 0, 0, 0, 5]), rng.choice("ab"))
        if entry in waiting:
            backlog.remove(entry[2], entry[0], entry[1])
            waiting.discard(entry)
        elif not any(other[0] == entry[0] for other in waiting):
            backlog.add(entry[2], entry[0], entry[1])
            waiting.add(entry)
        assert len(backlog) == len(waiting)
        first = min(waiting, default=None)
        assert backlog.first(None, lambda _: True) == (first[:2] if first else None)
        first = min((e for e in waiting if e[2] == "a"), default=None)
        assert backlog.first("a", lambda _: True) == (first[:2] if first else None)
        odd = min((e for e in waiting if e[0] % 2), default=None)
        assert backlog.first(None, lambda order: order % 2 == 1) == (odd[:2] if odd else None)
    again = Backlog()
    for order, group, rig in sorted(waiting, key=lambda _: rng.random()):
        again.add(rig, order, group)
    assert again == backlog


def test_a_stale_heap_does_not_grow() -> None:
    backlog = Backlog()
    backlog.add("a", 0, 0)
    for _ in range(10 * LOOK_MAX):
        backlog.add("b", 1, 0)
        backlog.remove("b", 1, 0)
    assert len(backlog._heads) <= LOOK_MAX + 4


def test_what_does_not_wait_cannot_be_removed() -> None:
    backlog = Backlog()
    backlog.extend("a", [1, 2, 3], 0)
    for rig, order, group in (("a", 4, 0), ("a", 1, 1), ("b", 1, 0)):
        with pytest.raises(AssertionError, match="is not waiting"):
            backlog.remove(rig, order, group)
    with pytest.raises(AssertionError, match="case 3 is not behind lane 0 of rig a"):
        backlog.extend("a", [3, 9], 0)


def test_what_comes_later_waits_behind() -> None:
    backlog = Backlog()
    backlog.extend("a", [1, 2], 0)
    backlog.remove("a", 1, 0)
    backlog.extend("a", [5, 6], 0)
    backlog.extend("b", [7], 0)
    assert list(backlog.take("a", 0)) == [2, 5, 6]
    assert backlog.first(None, lambda order: order > 2) == (5, 0)
    assert len(backlog) == 4


@pytest.mark.parametrize(("slow", "p95_s"), [(5, 0.001), (6, 1.024)])
def test_ninety_five_of_a_hundred(slow: int, p95_s: float) -> None:
    durations = Durations()
    assert durations.p95_s() is None
    for _ in range(100 - slow):
        durations.add(0.0)
    for _ in range(slow):
        durations.add(0.001 * 2**10)
    assert durations.p95_s() == p95_s


@pytest.mark.parametrize("wall_s", [0.0011, 0.5, 3.0, 59.0, 86_000.0])
def test_an_estimate_is_never_short_and_at_most_a_fifth_long(wall_s: float) -> None:
    durations = Durations()
    durations.add(wall_s)
    estimate_s = durations.p95_s()
    assert estimate_s is not None
    assert wall_s <= estimate_s <= 1.19 * wall_s


@pytest.mark.parametrize("wall_s", [-1.0, 0.0, float("nan")])
def test_what_is_no_time_counts_as_none(wall_s: float) -> None:
    durations = Durations()
    durations.add(wall_s)
    assert durations.counts == {0: 1}


def test_the_longest_times_share_a_bucket() -> None:
    durations = Durations()
    durations.add(1e12)
    durations.add(float("inf"))
    assert durations.counts == {BUCKET_MAX: 2}


def test_a_field_that_some_cases_lack_is_null_and_without_a_column_where_all_do() -> None:
    plain = _cases(matrix={"repeat": [0, 1, 2]})
    assert "forks" not in pack(plain).columns
    forked = [
        msgspec.structs.replace(
            case, variation=msgspec.structs.replace(case.variation, forks=[Fork(case=case.id)])
        )
        for case in plain
    ]
    for cases in (forked, [plain[0], forked[1], plain[2]], [forked[0], *plain[1:]]):
        data = msgspec.msgpack.encode(pack(cases))
        assert unpack(msgspec.msgpack.decode(data, type=CaseTable)) == cases
