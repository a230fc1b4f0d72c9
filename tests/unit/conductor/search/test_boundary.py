"""Boundaries of closed forms: every bracket holds the truth, every part is there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from search_bench import Crew, Unchecked, four_branches, section, submission

from conductor.core.state import Config
from conductor.records.search import search_file
from conductor.search.contour import Contour
from conductor.search.driver import Closed, first, follow
from conductor.search.traced import boundary_of
from schemas.files.search_result import SearchAnswer, SearchBoundary
from schemas.sections.search import Search

Form = Callable[[list[float]], float]


def circle(values: list[float]) -> float:
    """Failures outside of a circle around (0.5, 0.5)."""
    return 0.3 - math.hypot(values[0] - 0.5, values[1] - 0.5)


def two_parts(values: list[float]) -> float:
    """Failures in two discs that are apart."""
    x, y = values[:2]
    return min(math.hypot(x - 0.25, y - 0.3) - 0.15, math.hypot(x - 0.7, y - 0.7) - 0.2)


def steps(values: list[float]) -> float:
    """The same with margins that say no more than which side it is."""
    return math.copysign(1.0, two_parts(values))


UNIT = {"distribution": "uniform", "low": 0.0, "high": 1.0}
NORMAL = {"distribution": "normal", "mean": 0.0, "sd": 1.0}


def _section(distribution: dict[str, Any], count: int = 2, **changes: Any) -> dict[str, Any]:
    names = [f"objects.o{index}.start_s" for index in range(count)]
    budget = {"cases": 1000, "generation": 25, **changes.pop("budget", {})}
    parameters = dict.fromkeys(names, distribution)
    return section("boundary", parameters=parameters, budget=budget, **changes)


def _trace(search: dict[str, Any], form: Form) -> tuple[SearchBoundary | None, SearchAnswer, str]:
    made = msgspec.convert(search, Search)
    proposal = first(made, "traced", 0)
    u, results = [], list[list[float | None]]()
    while True:
        u.append(proposal.u)
        results.append([form([float(value) for value in row]) for row in proposal.values])
        step = follow(made, "traced", 0, Closed(u, results))
        if step.proposal is None:
            return boundary_of(made, Closed(u, results)), step.answer, step.ended
        proposal = step.proposal


@pytest.mark.parametrize(
    ("form", "distribution", "parts"),
    [(circle, UNIT, 1), (two_parts, UNIT, 2), (steps, UNIT, 2), (four_branches, NORMAL, 4)],
)
def test_every_bracket_holds_the_truth(
    form: Form, distribution: dict[str, Any], parts: int
) -> None:
    search = _section(distribution, options={"grid": 12, "width": 0.01})
    boundary, answer, ended = _trace(search, form)
    assert boundary is not None
    assert ended == "the sampler has its answer"
    assert "known to 0.0" in answer.method
    assert len(boundary.points) >= 8
    for point in boundary.points:
        assert form(point.holds_at) >= 0 > form(point.fails_at)
        assert point.width <= 0.01
        assert point.holds_at[0] == point.fails_at[0] or point.holds_at[1] == point.fails_at[1]
        for axis in (0, 1):
            ends = sorted((point.holds_at[axis], point.fails_at[axis]))
            assert ends[0] <= point.at[axis] <= ends[1]
    assert len(boundary.lines) == parts
    assert sorted({n for line in boundary.lines for n in line}) == [*range(len(boundary.points))]


def test_a_closed_part_ends_where_it_began() -> None:
    boundary, _, _ = _trace(_section(UNIT, options={"width": 0.005}), circle)
    assert boundary is not None
    (line,) = boundary.lines
    assert line[0] == line[-1]
    places = np.array([boundary.points[number].at for number in line])
    apart = np.hypot(places[:, 0] - 0.5, places[:, 1] - 0.5)
    assert np.max(np.abs(apart - 0.3)) < 1e-3
    turned = np.unwrap(np.arctan2(places[:, 1] - 0.5, places[:, 0] - 0.5))
    assert abs(abs(turned[-1] - turned[0]) - 2 * math.pi) < 1e-9


def test_other_parameters_stay_at_their_medians() -> None:
    names = [f"objects.o{index}.start_s" for index in range(3)]

    def form(values: list[float]) -> float:
        assert values[1] == 0.5
        return circle([values[2], values[0]])

    search = _section(UNIT, 3, options={"x": names[2], "y": names[0]})
    boundary, _, _ = _trace(search, form)
    assert boundary is not None
    assert (boundary.x, boundary.y) == (names[2], names[0])
    assert boundary.fixed == {names[1]: 0.5}
    assert all(circle(point.holds_at) >= 0 > circle(point.fails_at) for point in boundary.points)


def test_without_a_boundary_it_ends_with_the_grid() -> None:
    boundary, answer, ended = _trace(_section(UNIT, options={"grid": 3}), lambda _: 1.0)
    assert boundary is None
    assert answer.cases == 16
    assert answer.method.endswith("none: all places of the grid hold")
    assert ended == "the sampler has its answer"


def test_a_budget_that_ends_first_leaves_wider_brackets() -> None:
    search = _section(UNIT, options={"width": 0.001}, budget={"cases": 120})
    boundary, _, ended = _trace(search, circle)
    assert boundary is not None
    assert ended == "the budget of 120 cases is spent"
    assert all(circle(point.holds_at) >= 0 > circle(point.fails_at) for point in boundary.points)


def test_a_cell_that_is_crossed_on_all_sides_is_parted_by_its_middle() -> None:
    for middle, joined in ((0.5, [(0, 3), (1, 2)]), (-0.5, [(0, 1), (2, 3)])):
        contour = Contour(2, 0.5)
        contour.want(9)
        # Corner (0, 0) fails and (1, 1) with it; (1, 0) and (0, 1) hold.
        margins = np.array([-1.0, 1.0 + middle, 1, 1.0 + middle, -1.0, 1, 1, 1, 1])
        contour.tell(margins)
        cell = {(0, 0, 0): 0, (1, 0, 1): 1, (0, 1, 0): 2, (0, 0, 1): 3}
        numbers = [cell.get((*b.low, b.along)) for b in contour.brackets]
        pairs = {
            tuple(sorted((numbers[a], numbers[b])))
            for line in contour.lines()
            for a, b in itertools.pairwise(line)
            if numbers[a] is not None and numbers[b] is not None
        }
        assert pairs == set(joined)


def test_a_conductor_writes_the_boundary() -> None:
    search = section("boundary", budget={"cases": 400, "generation": 30}, options={"grid": 6})
    bench = Unchecked(Config())
    reply = bench.ask(submission(search))
    assert not reply.error, reply.error
    Crew(bench, 3, 4, 1, lambda values: 1.0 - math.hypot(*values)).work()
    bench.verify()
    boundary = search_file(bench.state.campaigns["searched"]).boundary
    assert boundary is not None
    for point in boundary.points:
        assert math.hypot(*point.holds_at) <= 1.0 < math.hypot(*point.fails_at)
