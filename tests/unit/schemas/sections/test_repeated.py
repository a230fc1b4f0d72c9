"""Cases that repeat those of other campaigns: names, random numbers, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import UNSET

from schemas.case import Case
from schemas.identity import case_digest, case_stream, stack_name, stack_seed
from schemas.plan import examine
from schemas.sections.repeated import CaseOrigin, repeated_of


def _cases(seed: int = 0, tell: bool = False, **point: Any) -> list[Case]:
    data: dict[str, Any] = {"campaign": "kept", "seed": seed, "cases": [point]}
    if tell:
        data["autonomy"] = {"tell": ["case", "seed"]}
    plan, mistakes = examine(data)
    assert not mistakes
    assert plan is not None
    return plan.cases


def _original(tell: bool = False) -> Case:
    data: dict[str, Any] = {"campaign": "hunt", "seed": 7, "matrix": {"weather": ["light_snow"]}}
    if tell:
        data["autonomy"] = {"tell": ["case", "seed"]}
    plan, _ = examine(data)
    assert plan is not None
    return plan.cases[0]


@pytest.mark.parametrize("tell", [False, True])
def test_a_repeated_case_has_all_random_numbers_of_the_other(tell: bool) -> None:
    one = _original(tell)
    (two,) = _cases(99, tell, drawn_as=f"hunt/7/{one.id}", weather="light_snow")
    assert two.id == f"hunt-7-{one.id}"
    assert two.variation.origin == CaseOrigin(campaign="hunt", case=one.id)
    for stream in ("gnss", "latency", "stack"):
        assert case_stream(two, stream) == case_stream(one, stream)
    assert (stack_name(two), stack_seed(two)) == (stack_name(one), stack_seed(one))
    assert case_digest(two) != case_digest(one)


def test_other_cases_have_no_origin() -> None:
    (case,) = _cases(weather="light_snow")
    assert case.variation.origin is UNSET
    assert repeated_of({"weather": "light_snow"}) is UNSET


@pytest.mark.parametrize(
    "words",
    [
        *("", "hunt", "hunt/7", "hunt/07/a", "hunt/-1/a", "Hunt/7/a", "hunt-/7/a", "hunt/7/a/b"),
        *("hunt/7/a b", "hunt/7/a\n", f"hunt/{2**63}/a", 7),
    ],
)
def test_words_that_name_no_case_are_told(words: Any) -> None:
    data = {"campaign": "kept", "cases": [{"drawn_as": words}]}
    _, mistakes = examine(data)
    assert [mistake.line("f") for mistake in mistakes] == [
        "f: cases[0].drawn_as: allowed: CAMPAIGN/SEED/CASE, as rain/1/g0003-0017"
    ]


def test_one_case_is_repeated_once_and_only_in_the_list() -> None:
    point = {"drawn_as": "hunt/7/a", "weather": "light_snow"}
    _, mistakes = examine({"campaign": "kept", "cases": [point, point]})
    assert "case 'hunt-7-a' appears twice" in mistakes[0].message
    _, mistakes = examine({"campaign": "kept", "matrix": {"drawn_as": ["hunt/7/a"]}})
    assert "unknown axis" in mistakes[0].message
