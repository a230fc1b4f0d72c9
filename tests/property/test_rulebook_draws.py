"""What a repetition draws depends on seed, row, point and repetition alone."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from rulebooks import BRAKING, CROSSING, rulebook_data

from schemas.plan import parse_plan


def drawn(data: dict[str, Any]) -> dict[tuple[float, int], float]:
    """What is added to each speed of the row, by speed and repetition."""
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    axis, name = "storyboard.ego.speed_kmh", "ego.speed_kmh"
    added = {}
    for point, case in zip(plan.points, plan.cases, strict=True):
        if point.row == BRAKING["row"]:
            speed, number = point.values[axis], case.variation.scenario.numbers[name]
            added[speed, point.repeat] = number - speed
    return added


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**63 - 1),
    speeds=st.lists(st.integers(10, 99), min_size=1, max_size=4, unique=True),
    repetitions=st.integers(1, 4),
    low=st.floats(-5, 0),
    high=st.floats(0, 5),
    before=st.booleans(),
)
def test_neither_order_nor_neighbours_decide_what_is_drawn(
    seed: int, speeds: list[int], repetitions: int, low: float, high: float, before: bool
) -> None:
    row = {
        **BRAKING,
        "values": {"ego.speed_kmh": [*speeds, 120], "actors.lead.ahead_m": 30},
        "repetitions": 5,
        "varied": {"ego.speed_kmh": [low, high]},
    }
    every = drawn(rulebook_data(*((CROSSING, row) if before else (row,)), seed=seed))
    values = {"ego.speed_kmh": speeds[::-1], "actors.lead.ahead_m": 30}
    some = drawn(rulebook_data({**row, "values": values, "repetitions": repetitions}, seed=seed))
    assert len(some) == len(speeds) * repetitions
    assert some.items() <= every.items()
    for (_, repeat), added in every.items():
        assert low - 1e-6 <= added <= high + 1e-6
        assert repeat or not added, "the first run is as written"
